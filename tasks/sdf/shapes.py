"""Reads collisions, visuals, inertias and materials of SDF links."""

import re
import xml.etree.ElementTree as ET
from math import pi
from pathlib import Path

import numpy as np

from .frames import own_pose
from .lookup import Lookup
from .ogre_materials import OgreMaterials
from .polylines import Ring, parts_of
from .sdf_types import GRAY, Geometry, Inertia, Material, Omissions, Pose, Rgba, SdfError
from .xml_files import flag_of, number_of, numbers_of, place, text_of

MOST_FRICTION = 1.0
"""Limit of sliding friction.

MuJoCo takes the larger friction of two shapes where Gazebo takes the smaller: worlds that say 100 for floors and walls
would hold every robot fast.
"""
_LEAST_MOMENT = 1e-12
"""Smallest moment of inertia of a body, in kg m2: that of a milligram within a millimetre; MuJoCo refuses 1e-15."""
_ONES = (1.0, 1.0, 1.0)


MISSING_COLLISION_MESHES = "collision meshes that are missing"
MISSING_COLLISION_HEIGHTMAPS = "collision heightmaps that are missing or no pictures"
"""Kind of omission for which an import is refused, as a robot would drive through missing terrain."""


class ShapeReader:
    """Parses shapes, materials and inertias of SDF elements.

    Args:
        lookup: Finds files.
        left_out: The list of what was left out.
    """

    def __init__(self, lookup: Lookup, left_out: Omissions) -> None:
        self._lookup, self._left_out = lookup, left_out
        self._ogre = OgreMaterials(lookup)

    def geometry(self, parent: ET.Element, base: Path, where: str) -> Geometry | None:  # noqa: C901 (one line a shape)
        """Parses the shape of a collision or visual; `None` if there is none that can be read.

        Args:
            parent: The collision or visual.
            base: Folder that its files are named from.
            where: Path of the collision or visual, for the list of what was left out.
        """
        outer = parent.find("geometry")
        shape = next((child for child in outer if child.tag != "empty"), None) if outer is not None else None
        if shape is None:
            return None
        match shape.tag:
            case "box":
                return Geometry("box", _positive(shape, numbers_of(shape.find("size"), 3, _ONES)))
            case "sphere":
                return Geometry("sphere", _positive(shape, (number_of(shape, "radius", 1.0),)))
            case "ellipsoid":
                return Geometry("ellipsoid", _positive(shape, numbers_of(shape.find("radii"), 3, _ONES)))
            case "cylinder" | "capsule" | "cone":
                size = number_of(shape, "radius", 1.0), number_of(shape, "length", 1.0)
                return Geometry(shape.tag, _positive(shape, size))
            case "plane":
                x, y, z = numbers_of(shape.find("normal"), 3, (0.0, 0.0, 1.0))
                if not np.linalg.norm((x, y, z)) > 0:
                    raise SdfError(f"{place(shape)}: the plane's normal has no direction")
                return Geometry("plane", numbers_of(shape.find("size"), 2, (1.0, 1.0)), normal=(x, y, z))
            case "mesh":
                return self._mesh(shape, base, where, collides=parent.tag == "collision")
            case "polyline":
                return self._polylines(outer.findall("polyline") if outer is not None else [], where)
            case "heightmap":
                return self._heightmap(shape, base, where, collides=parent.tag == "collision")
            case other:
                self._left_out.add(f"shapes of kind {other[:40]}", where)
                return None

    def _mesh(self, shape: ET.Element, base: Path, where: str, *, collides: bool) -> Geometry | None:
        uri = text_of(shape, "uri")
        path = self._lookup.file(uri, base)
        if path is None:
            self._left_out.add(MISSING_COLLISION_MESHES if collides else "meshes that are missing", f"{uri} ({where})")
            return None
        x, y, z = numbers_of(shape.find("scale"), 3, _ONES)
        if 0.0 in (x, y, z):
            raise SdfError(f"{place(shape)}: the mesh's scale has a 0")
        submesh = shape.find("submesh")
        name = text_of(submesh, "name") if submesh is not None else ""
        # Without a name there is no submesh to be moved to its middle.
        is_centred = submesh is not None and bool(name) and flag_of(submesh, "center")
        return Geometry("mesh", file=path, scale=(x, y, z), submesh=name or None, is_centred=is_centred)

    def _polylines(self, shapes: list[ET.Element], where: str) -> Geometry | None:
        """Converts several polylines to one prism, as high as the first one (metres): rings inside others are holes.

        Returns None if none has three points or more; those with fewer are noted as left out.
        """
        rings: list[Ring] = []
        for shape in shapes:
            corners = [numbers_of(point, 2, (0.0, 0.0)) for point in shape.findall("point")]
            if len(corners) > 1 and corners[0] == corners[-1]:
                corners.pop()
            if len(corners) < 3:
                self._left_out.add("polylines with fewer than three points", where)
                continue
            rings.append(tuple((x, y) for x, y in corners))
        if not rings:
            return None
        height = _positive(shapes[0], (number_of(shapes[0], "height", 1.0),))
        return Geometry("prism", height, outlines=parts_of(rings))

    def _heightmap(self, shape: ET.Element, base: Path, where: str, *, collides: bool) -> Geometry | None:
        uri = text_of(shape, "uri")
        path = self._lookup.file(uri, base)
        if path is None or path.suffix.lower() not in (".png", ".jpg", ".jpeg", ".bmp"):
            what = MISSING_COLLISION_HEIGHTMAPS if collides else "heightmaps that are missing or no pictures"
            self._left_out.add(what, f"{uri} ({where})")
            return None
        x, y, z = numbers_of(shape.find("pos"), 3, (0.0, 0.0, 0.0))
        size = _positive(shape, numbers_of(shape.find("size"), 3, _ONES))
        return Geometry("heightmap", size, file=path, offset=(x, y, z))

    def friction(self, collision: ET.Element, where: str) -> float:
        """Returns the sliding friction of a collision, limited to MuJoCo's range."""
        ode = collision.find("surface/friction/ode")
        wanted = min(number_of(ode, name, 1.0, is_endless=True) for name in ("mu", "mu2")) if ode is not None else 1.0
        if wanted > MOST_FRICTION or wanted < 0:
            self._left_out.add(f"frictions that were clamped to 0 to {MOST_FRICTION:g}", f"{where} ({wanted:g})")
        return min(max(wanted, 0.0), MOST_FRICTION)

    def material(self, visual: ET.Element, base: Path, where: str) -> Material:
        """Parses the material of a visual: PBR first, then OGRE scripts, then plain colours; gray if it has none.

        Textures and materials that are not found are noted as left out.
        """
        element = visual.find("material")
        if element is None:
            return Material()
        color = _color(element.find("diffuse"))
        if color is None:
            color = _color(element.find("ambient"))
        albedo = element.find("pbr/metal/albedo_map")
        if albedo is None:
            albedo = element.find("pbr/specular/albedo_map")
        if albedo is not None and (albedo.text or "").strip():
            uri = (albedo.text or "").strip()
            texture = self._lookup.file(uri, base)
            if texture is None:
                self._left_out.add("textures that are missing", f"{uri} ({where})")
            return Material(color or (1.0, 1.0, 1.0, 1.0), texture, True)
        script = element.find("script")
        if script is not None and (name := text_of(script, "name")):
            found = self._ogre.find(name, [uri.text or "" for uri in script.findall("uri")], base)
            if found is not None:
                return found
            if color is None:
                self._left_out.add("materials that are unknown", f"{name} ({where})")
        transparency = min(max(number_of(visual, "transparency", 0.0), 0.0), 1.0)
        if color is None:
            return Material((*GRAY[:3], 1.0 - transparency), None, transparency > 0)
        return Material((*color[:3], color[3] * (1.0 - transparency)), None, True)

    def inertia(self, link: ET.Element, link_pose: Pose, where: str) -> Inertia | None:
        """Parses a link's mass (kg) and inertia (kg·m²); `None` if the file has none.

        Impossible values are noted, and replaced: the inertia by `None`, a mass that is not above 0 by 1 kg.
        """
        element = link.find("inertial")
        if element is None:
            return None
        mass = number_of(element, "mass", 1.0)
        inner = element.find("inertia")
        names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        usual = (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)
        values = [number_of(inner, name, value) for name, value in zip(names, usual, strict=True)] if inner is not None else usual  # fmt: skip # noqa: E501
        xx, yy, zz, xy, xz, yz = values
        moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        principal = np.linalg.eigvalsh(moments)
        is_possible = (
            mass > 0 and principal[0] > _LEAST_MOMENT and principal[0] + principal[1] >= principal[2] * (1 - 1e-6)
        )
        if not is_possible:
            self._left_out.add("inertias that were mended", where)
            return Inertia(mass if mass > 0 else 1.0, link_pose @ own_pose(element), None)
        return Inertia(mass, link_pose @ own_pose(element), moments)


def _positive(shape: ET.Element, values: tuple[float, ...]) -> tuple[float, ...]:
    if not all(value > 0 for value in values):
        raise SdfError(f"{place(shape)}: the sizes of <{shape.tag}> are {values}; numbers above 0 would be right")
    return values


def _color(element: ET.Element | None) -> Rgba | None:
    if element is None or not (element.text or "").strip():
        return None
    values = [float(part) for part in re.findall(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", element.text or "")[:4]]
    if len(values) < 3:
        return None
    red, green, blue = (min(max(value, 0.0), 1.0) for value in values[:3])
    return red, green, blue, min(max(values[3], 0.0), 1.0) if len(values) > 3 else 1.0


def cone_half_angle(outer_rad: float) -> float:
    """Returns half the angle of a spotlight's cone, within renderers' limits."""
    return min(max(outer_rad / 2, 0.05), pi / 2)
