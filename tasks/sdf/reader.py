"""Reads an SDF world with all included models, links and joints, and their poses in the world."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .frames import Scope, own_pose, relative_to
from .joints import JointPlace, read_joint
from .lookup import FoundModel, Lookup
from .saved_state import SavedState, read_saved_state
from .sdf_types import Collision, Geometry, Light, Link, Pose, SdfError, SdfWorld, Visual, identity
from .shapes import MISSING_COLLISION_HEIGHTMAPS, MISSING_COLLISION_MESHES, ShapeReader, cone_half_angle
from .usual_models import usual_model
from .xml_files import Element, flag_of, number_of, numbers_of, place, read_xml, text_of

_MOST_LINKS = 20_000
_MOST_INCLUDES = 20_000
_MOST_NESTED = 20
"""Limit of models inside models; public worlds have three levels."""
_VERSIONS = ("1.3", "1.12")
_GRAVITY = 0.0, 0.0, -9.8
_GRAVITY_WITHIN = 0.05
"""Difference up to which gravities count as equal, in m/s2: files say 9.8, 9.80665 and 9.81."""


@dataclass(slots=True)
class _Model:
    """Model with its nested models, while the file is read."""

    name: str
    scope: Scope
    folder: Path
    """Folder that the model's other files are relative to."""
    is_static: bool | None
    """Whether the model is static, as its own or its include's element says; `None`: neither says it."""
    nested: list["_Model"]
    kind: str
    is_merged: bool = False


def read_world(path: Path, model_paths: Sequence[Path], environment: Mapping[str, str]) -> SdfWorld:
    """Reads an SDF world file with all models that it includes.

    Args:
        path: The file, `.world` or `.sdf`; one with a model alone is a world with that model.
        model_paths: Folders of models that the user names.
        environment: Environment variables, which name further ones.

    Raises:
        SdfError: The file, or a model that it includes, cannot be read.
    """
    return _WorldReader(path, Lookup(path, model_paths, environment)).read()


class _WorldReader:
    def __init__(self, path: Path, lookup: Lookup) -> None:
        self._path, self._lookup = path, lookup
        self._roots: dict[Path, Element] = {}
        self._includes = 0
        self._found_joints: list[JointPlace] = []

    def read(self) -> SdfWorld:
        root = self._file(self._path)
        version = root.get("version", "1.6")
        element = root.find("world")
        if root.tag not in ("sdf", "gazebo") or (element is None and root.find("model") is None):
            raise SdfError(f"{self._path}: it has no <world>; a file in Gazebo's format, <sdf><world>, would be right")
        parts = [int(part) for part in version.split(".") if part.isdecimal()]
        if not (1, 3) <= tuple(parts) <= (1, 12):
            raise SdfError(f"{self._path}: SDF {version}; versions {_VERSIONS[0]} to {_VERSIONS[1]} can be read")
        element = root if element is None else element
        self._world = SdfWorld(name=element.get("name", self._path.stem), version=version)
        self._shapes = ShapeReader(self._lookup, self._world.left_out)
        state = read_saved_state(element)
        models = self._models(element, self._path.parent, 0)
        models += [
            model
            for insertion in element.findall("state/insertions")
            for model in self._models(insertion, self._path.parent, 0)
        ]
        scope = Scope(element, {model.name: model.scope for model in models if not model.is_merged})
        taken: set[str] = set()
        for model in models:
            if model.name in state.deleted:
                continue
            if model.name in taken:
                raise SdfError(f"{place(model.scope.element)}: there are two models {model.name!r}")
            taken.add(model.name)
            pose = scope.pose_of(model.scope)
            self._flatten(model, pose, (model.name,), bool(model.is_static), state)
        self._joints(element, scope, identity(), "")
        links = {link.path: link for link in self._world.links}
        self._world.joints = [read_joint(each, links, self._world.left_out) for each in self._found_joints]
        self._lights(element, identity(), state)
        self._note_saved_angles(state)
        self._note_rest(element)
        self._world.files = set(self._roots) | {each.file for each in self._world.geometries() if each.file}
        return self._world

    def _file(self, path: Path) -> Element:
        if path not in self._roots:
            self._roots[path] = read_xml(path)
        return self._roots[path]

    def _models(self, parent: ET.Element, folder: Path, depth: int) -> list[_Model]:
        """Reads the models in a world or model, in the order of the file, without included ones that are not found.

        Raises SdfError if models are nested too deeply.
        """
        if depth > _MOST_NESTED:
            raise SdfError(f"{place(parent)}: models are nested deeper than {_MOST_NESTED}, or include themselves")
        found: list[_Model] = []
        for child in parent:
            if child.tag == "model":
                found.append(self._model(child, child.get("name", ""), folder, "", depth))
            elif child.tag == "include" and (model := self._include(child, folder, depth)) is not None:
                found.append(model)
        return found

    def _model(self, element: ET.Element, name: str, folder: Path, kind: str, depth: int) -> _Model:
        nested = self._models(element, folder, depth + 1)
        static: bool | None = flag_of(element, "static") if text_of(element, "static") else None
        if static is None:
            # Included models hand theirs to the model around them.
            static = next((each.is_static for each in nested if each.is_static is not None), None)
        scope = Scope(
            element,
            {each.name: each.scope for each in nested if not each.is_merged},
            element.get("placement_frame", ""),
            merged=tuple(each.scope for each in nested if each.is_merged),
        )
        if name in ("", "world"):
            name = name or "model"
        return _Model(name, scope, folder, static, nested, kind or name)

    def _include(self, include: ET.Element, folder: Path, depth: int) -> _Model | None:
        uri = text_of(include, "uri")
        self._includes += 1
        if self._includes > _MOST_INCLUDES:
            raise SdfError(f"{place(include)}: the world includes more than {_MOST_INCLUDES:,} models")
        found = self._lookup.model(uri, folder)
        element = self._included(found) if found is not None else None
        if found is None and (own := usual_model(uri)) is not None:
            if own.tag == "light":
                self._light(own, own_pose(include if include.find("pose") is not None else own))
                return None
            found, element = FoundModel(folder, folder), own
            element.file = str(self._path)
        if found is None or element is None:
            near = self._lookup.similar(uri)
            hint = f"; there is {', '.join(near)}" if near else ""
            if self._is_other(found):
                self._world.left_out.add("actors and lights that are included", uri)
            else:
                self._world.left_out.add("models that are missing", f"{uri} ({_short_place(include)}{hint})")
            return None
        name = text_of(include, "name") or element.get("name", "") or found.folder.name
        kind = found.folder.name if found.file != found.folder else name
        model = self._model(element, name, found.folder, kind, depth)
        if include.find("pose") is not None:
            model.scope.pose_of_model, model.scope.relative_to = own_pose(include), relative_to(include)
        model.scope.placement_frame = text_of(include, "placement_frame") or model.scope.placement_frame
        if text_of(include, "static"):
            model.is_static = flag_of(include, "static")
        model.is_merged = include.get("merge", "").lower() in ("true", "1")
        self._note_inner(include, name)
        if any(child.tag.startswith("experimental:") for child in include):
            self._world.left_out.add("changes of included models (experimental:params)", name)
        if found.file != found.folder and (others := self._file(found.file).findall("model")[1:]):
            names = ", ".join(each.get("name", "model") for each in others)
            self._world.left_out.add("models after the first of a file", f"{found.file.name} of {name}: {names}")
        return model

    def _included(self, found: FoundModel) -> ET.Element | None:
        return self._file(found.file).find("model")

    def _is_other(self, found: FoundModel | None) -> bool:
        return found is not None and any(self._file(found.file).find(tag) is not None for tag in ("actor", "light"))

    def _flatten(self, model: _Model, pose: Pose, path: tuple[str, ...], is_static: bool, state: SavedState) -> None:
        """Adds the links, joints and lights of a model and its nested models to the world."""
        saved = state.models.get("::".join(path))
        if saved is not None and saved.pose is not None:
            pose = saved.pose
        self._world.model_types["::".join(path)] = model.kind if not model.is_merged else path[-1]
        scale = saved.scale if saved is not None else (1.0, 1.0, 1.0)
        for element in model.scope.element.findall("link"):
            self._link(element, model, pose, path, is_static, scale, state)
        self._joints(model.scope.element, model.scope, pose, "::".join(path))
        for inner in model.nested:
            inner_path = path if inner.is_merged else (*path, inner.name)
            self._flatten(inner, pose @ model.scope.pose_of(inner.scope), inner_path, is_static, state)
        self._note_inner(model.scope.element, "::".join(path))

    def _link(
        self,
        element: ET.Element,
        model: _Model,
        pose: Pose,
        path: tuple[str, ...],
        is_static: bool,
        scale: tuple[float, float, float],
        state: SavedState,
    ) -> None:
        if len(self._world.links) >= _MOST_LINKS:
            raise SdfError(f"{place(element)}: the world has more than {_MOST_LINKS:,} links")
        name = element.get("name", "link")
        where = "::".join((*path, name))
        placed = state.links.get(where) or pose @ model.scope.resolve(name)
        link = Link(where, path[0], placed, is_static, self._shapes.inertia(element, placed, where), [], [])
        for child in element:
            own = f"{where}::{child.get('name', child.tag)}"
            if child.tag == "collision" and _collides_with_nothing(child):
                self._world.left_out.add("collision shapes that collide with nothing, as the file says", own)
            elif child.tag == "collision":
                geometry = self._shapes.geometry(child, model.folder, own)
                if geometry is not None:
                    at = placed @ _inner_pose(child, model.scope, name)
                    friction = self._shapes.friction(child, own)
                    link.collisions.append(Collision(own, at, _scaled(geometry, scale), friction))
            elif child.tag == "visual":
                geometry = self._shapes.geometry(child, model.folder, own)
                if geometry is not None:
                    at = placed @ _inner_pose(child, model.scope, name)
                    material = self._shapes.material(child, model.folder, own)
                    link.visuals.append(Visual(own, at, _scaled(geometry, scale), material))
            elif child.tag == "light":
                self._light(child, placed @ own_pose(child))
            elif child.tag in ("sensor", "projector", "audio_source", "battery", "particle_emitter"):
                self._world.left_out.add(f"{child.tag.replace('_', ' ')}s", own)
        self._world.links.append(link)

    def _joints(self, element: ET.Element, scope: Scope, pose: Pose, prefix: str) -> None:
        """Collects the joints of a model or of the world; they are read after all links are known."""
        self._found_joints += [
            JointPlace(joint, scope, pose, prefix, self._version_of(joint)) for joint in element.findall("joint")
        ]

    def _version_of(self, element: ET.Element) -> str:
        """Returns the SDF version of the file that an element is in: included models have their own."""
        root = self._roots.get(Path(getattr(element, "file", "")))
        return self._world.version if root is None else root.get("version", "1.6")

    def _lights(self, element: ET.Element, pose: Pose, state: SavedState) -> None:
        for light in element.findall("light"):
            saved = state.lights.get(light.get("name", ""))
            self._light(light, saved if saved is not None else pose @ own_pose(light))

    def _light(self, light: ET.Element, pose: Pose) -> None:
        kind = light.get("type", "point")
        if kind not in ("point", "spot", "directional"):
            self._world.left_out.add(f"lights of type {kind[:40]}", light.get("name", "light"))
            return
        direction = np.array(numbers_of(light.find("direction"), 3, (0.0, 0.0, -1.0)))
        if not np.linalg.norm(direction) > 0:
            direction = np.array((0.0, 0.0, -1.0))
        diffuse = (light.findtext("diffuse") or "1 1 1").replace(",", " ").split()[:3]
        try:
            red, green, blue = (min(max(0.0, float(part)), 1.0) for part in diffuse)  # what is no number is 0
        except ValueError:
            raise SdfError(f"{place(light)}: the light's <diffuse> is {' '.join(diffuse)!r}") from None
        spot = light.find("spot")
        angle = number_of(spot, "outer_angle", 1.0) if spot is not None else 1.0
        self._world.lights.append(
            Light(
                name=light.get("name", "light"),
                kind=kind,
                pose=pose,
                direction=pose.rotation @ direction,
                diffuse=(red, green, blue),
                casts_shadows=flag_of(light, "cast_shadows", kind == "directional"),
                outer_angle_rad=cone_half_angle(angle),
            )
        )

    def _note_saved_angles(self, state: SavedState) -> None:
        """Lists joints whose angle is saved without the pose of their link, which Gazebo does not move either."""
        for joint in self._world.joints:
            if joint.path in state.joints and joint.child not in state.links and joint.kind != "fixed":
                self._world.left_out.add("saved angles of joints whose links have no saved pose", joint.path)

    def _note_rest(self, world: ET.Element) -> None:
        gravity = numbers_of(world.find("gravity"), 3, _GRAVITY)
        if any(abs(said - usual) > _GRAVITY_WITHIN for said, usual in zip(gravity, _GRAVITY, strict=True)):
            self._world.left_out.add(
                "gravities other than that of the earth", " ".join(f"{each:g}" for each in gravity)
            )
        for child in world:
            name = child.get("name", "") or child.get("filename", "") or child.tag
            if child.tag in ("plugin", "actor", "road", "population"):
                self._world.left_out.add(f"{child.tag}s", name)

    def _note_inner(self, element: ET.Element, where: str) -> None:
        for child in element:
            if child.tag == "plugin":
                self._world.left_out.add("plugins", f"{where}: {child.get('name', '') or child.get('filename', '')}")
            elif child.tag == "gripper":
                self._world.left_out.add("grippers", f"{where}: {child.get('name', '')}")


def _short_place(element: ET.Element) -> str:
    """Returns file name and line of an element, without the folder, which differs from machine to machine."""
    return place(element).rpartition("/")[2]


def _inner_pose(element: ET.Element, scope: Scope, link: str) -> Pose:
    """Returns the pose of a collision or visual in its link."""
    base = relative_to(element)
    if not base or base == link:
        return own_pose(element)
    return scope.resolve(link).inverse() @ scope.resolve(base) @ own_pose(element)


def _collides_with_nothing(collision: ET.Element) -> bool:
    contact = collision.find("surface/contact")
    if contact is None:
        return False
    mask = text_of(contact, "collide_bitmask", "1").lower()
    return flag_of(contact, "collide_without_contact") or mask.removeprefix("0x").strip("0") == ""


def _scaled(geometry: Geometry, scale: tuple[float, float, float]) -> Geometry:
    """Returns a shape in the size that Gazebo's window saved."""
    if scale == (1.0, 1.0, 1.0):
        return geometry
    x, y, z = scale
    if geometry.kind == "mesh":
        u, v, w = geometry.scale
        return replace(geometry, scale=(u * x, v * y, w * z))
    if geometry.kind in ("box", "ellipsoid", "heightmap"):
        return replace(geometry, size=tuple(size * by for size, by in zip(geometry.size, scale, strict=True)))
    if geometry.kind in ("cylinder", "capsule", "cone"):
        return replace(geometry, size=(geometry.size[0] * max(x, y), geometry.size[1] * z))
    if geometry.kind == "sphere":
        return replace(geometry, size=(geometry.size[0] * max(scale),))
    if geometry.kind == "prism":
        outlines = tuple(tuple((a * x, b * y) for a, b in outline) for outline in geometry.outlines)
        return replace(geometry, size=(geometry.size[0] * z,), outlines=outlines)
    return geometry


def missing_parts(world: SdfWorld) -> Iterator[str]:
    """Yields names of models and collision files that an SDF world needs and that were not found."""
    for what in ("models that are missing", MISSING_COLLISION_MESHES, MISSING_COLLISION_HEIGHTMAPS):
        yield from world.left_out.names(what)
