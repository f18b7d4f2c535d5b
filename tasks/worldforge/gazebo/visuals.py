"""Visual shapes of an imported world: meshes as OBJ files, textures as PNG files of at most 512 pixels, materials."""

import hashlib
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ...sdf.meshes import MeshError, Meshes, MeshPart
from ...sdf.sdf_types import GRAY, Geometry, Link, Material, Omissions, Pose, Rgba, SdfError
from ...sdf.xml_files import read_bytes
from .prisms import COMPOSED, prism_triangles
from .solids import primitive
from .terrain import Terrain

MOST_PIXELS = 512
"""Limit of a texture's side in a bundle, in pixels; 1,024 made a world of 241 models 46 MB."""
_MOST_PICTURE_BYTES = 64 * 1024 * 1024
_MOST_SOURCE_PIXELS = 16384 * 16384 // 4
_MOST_DRAWN = 40_000
"""Limit of the triangles of one visual mesh; a page in a browser shows some millions."""
_MOST_TERRAIN = 257
"""Limit of a heightmap's samples along a side."""
_FORMATS = ("PNG", "JPEG", "BMP", "TGA", "TIFF", "GIF", "DDS", "WEBP", "PPM")
"""Allowed texture file formats; reading others, such as PostScript, starts programs."""
_LEAST_AREA_M2 = 1e-7
"""Surface area of a mesh below which MuJoCo may refuse it, in square metres."""
_PLAIN_REPEAT = 'texrepeat="1 1"'


@dataclass(frozen=True, slots=True)
class SeenGeom:
    """A visual shape of an imported Gazebo world."""

    kind: str
    pose: Pose
    size: tuple[float, ...]
    mesh: str | None
    material: str | None
    rgba: Rgba = GRAY


class Visuals:
    """Collects meshes, textures and materials of an imported Gazebo world, each once.

    Args:
        meshes: Meshes of the world.
        left_out: The list of what was left out.
    """

    def __init__(self, meshes: Meshes, left_out: Omissions) -> None:
        self._meshes, self._left_out = meshes, left_out
        self.files: dict[str, bytes] = {}
        """Content of the bundle's mesh and texture files, by path."""
        self._lines: dict[str, str] = {}
        self._drawn: dict[Geometry, list[tuple[str | None, MeshPart]]] = {}
        self._pictures: dict[str, str | None] = {}

    def asset_lines(self) -> list[str]:
        """Returns textures, materials and meshes of a Gazebo world as MJCF."""
        return sorted(self._lines.values(), key=lambda line: ("<texture" not in line, "<material" not in line, line))

    def seen(self, link: Link) -> list[SeenGeom]:
        """Returns the visual shapes of a Gazebo link.

        Transparent ones are left out. Meshes that they need are added to `files`.
        """
        found: list[SeenGeom] = []
        for visual in link.visuals:
            geometry, pose = visual.geometry, visual.pose
            if visual.material.color[3] <= 0:
                continue
            if geometry.kind in COMPOSED:
                for name, part in self._parts(geometry):
                    if name is not None:
                        stated = visual.material if visual.material.is_stated else part.material
                        picture = None if visual.material.is_stated else part.picture
                        found.append(
                            SeenGeom("mesh", pose, (), name, self._material(stated, picture, part.places is not None))
                        )
            elif geometry.kind == "heightmap":
                # The shape that collides is drawn.
                if not any(each.geometry.kind == "heightmap" for each in link.collisions):
                    self._left_out.add("heightmaps that are drawn only", visual.name)
            else:
                solid = primitive(geometry, pose, 0.0)
                size = (*solid.size, 1.0) if solid.kind == "plane" else solid.size
                material = self._material(visual.material, None, True)
                found.append(SeenGeom(solid.kind, solid.pose, size, None, material))
        return found

    def _parts(self, geometry: Geometry) -> list[tuple[str | None, MeshPart]]:
        if geometry not in self._drawn:
            try:
                if geometry.kind != "mesh":
                    parts = (MeshPart(prism_triangles(geometry), None, Material()),)
                else:
                    parts = self._meshes.parts(geometry)
            except MeshError as error:
                self._left_out.add("meshes that cannot be read", error.short)
                parts = ()
            self._drawn[geometry] = [(self._mesh(part, geometry), part) for part in parts]
        return self._drawn[geometry]

    def _mesh(self, part: MeshPart, geometry: Geometry) -> str | None:
        """Adds a visual mesh to `files` in OBJ format and returns its name; `None` if it is too small.

        A mesh of too many triangles is thinned, and counted among what is left out.
        """
        triangles, places = part.triangles, part.places
        if len(triangles) > _MOST_DRAWN:
            triangles, places = _thinned(triangles, places)
            name = geometry.file.name if geometry.file else geometry.said
            self._left_out.add(f"visual meshes drawn with fewer than {_MOST_DRAWN:,} triangles", name)
        text = _obj(triangles, places)
        if text is None:
            return None
        stem = "".join(letter if letter.isalnum() else "_" for letter in geometry.file.stem)[:40] if geometry.file else geometry.said  # fmt: skip # noqa: E501
        name = f"{stem}_{hashlib.sha256(text).hexdigest()[:10]}"
        path = f"meshes/{name}.obj"
        self.files[path] = text
        self._lines[path] = f'    <mesh name="{name}" file="{path}" inertia="shell"/>'
        return name

    def _material(self, material: Material, picture: Image.Image | None, has_places: bool) -> str:
        texture = self._texture(material.texture, picture) if has_places else None
        red, green, blue, alpha = (round(value, 3) for value in material.color)
        if texture is not None:
            name, look = f"{texture}_{_hex(material.color)}", f'texture="{texture}" {_PLAIN_REPEAT}'
        else:
            name, look = f"color_{_hex(material.color)}", ""
        rgba = f"{red:g} {green:g} {blue:g} {alpha:g}"
        self._lines[name] = f'    <material name="{name}" {look} rgba="{rgba}" specular="0.1"/>'.replace(
            "  rgba", " rgba"
        )
        return name

    def _texture(self, path: Path | None, picture: Image.Image | None) -> str | None:
        if path is None and picture is None:
            return None
        key = str(path) if path is not None else f"{id(picture)}"
        if key not in self._pictures:
            try:
                self._pictures[key] = self._written(path, picture)
            # Readers of formats fail in many ways on files that are broken.
            except Exception as error:
                self._left_out.add(
                    "textures that cannot be read",
                    f"{path.name if path else 'picture in a mesh'}: {type(error).__name__}",
                )
                self._pictures[key] = None
        return self._pictures[key]

    def _written(self, path: Path | None, picture: Image.Image | None) -> str:
        if path is not None:
            picture = Image.open(BytesIO(read_bytes(path, _MOST_PICTURE_BYTES)), formats=_FORMATS)
        assert picture is not None
        if picture.format not in (None, *_FORMATS):  # None: it is none of a file
            raise SdfError(f"it is {picture.format}")
        if picture.width * picture.height > _MOST_SOURCE_PIXELS:
            raise SdfError(f"it has {picture.width} x {picture.height} pixels")
        picture.draft("RGB", (MOST_PIXELS, MOST_PIXELS))  # JPEG decodes at a fraction of its size, ten times faster
        small = picture.convert("RGB")
        if max(small.size) > MOST_PIXELS:
            small.thumbnail((MOST_PIXELS, MOST_PIXELS), Image.Resampling.BOX)
        # A palette of 256 colours is a fifth of the file, and no difference at this size.
        content = BytesIO()
        small.quantize(256, method=Image.Quantize.FASTOCTREE).save(content, "PNG", compress_level=6)
        stem = "".join(letter if letter.isalnum() else "_" for letter in (path.stem if path else "picture"))[:40]
        name = f"{stem}_{hashlib.sha256(content.getvalue()).hexdigest()[:10]}"
        self.files[f"textures/{name}.png"] = content.getvalue()
        self._lines[f"textures/{name}"] = f'    <texture name="{name}" type="2d" file="textures/{name}.png"/>'
        return name


def _hex(color: Rgba) -> str:
    return "".join(f"{round(value * 255):02x}" for value in color)


def _thinned(
    triangles: NDArray[np.float64], places: NDArray[np.float64] | None
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Returns fewer triangles of a mesh: corners snap to a grid that gets coarser until few enough are left.

    The second value has the texture coordinates of the triangles that are left; `None` if there are none.
    """
    extent = float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    pitch = max(extent / 400, 1e-6)
    while True:
        snapped = np.round(triangles / pitch)
        good = ~(
            (snapped[:, 0] == snapped[:, 1]).all(axis=1)
            | (snapped[:, 1] == snapped[:, 2]).all(axis=1)
            | (snapped[:, 2] == snapped[:, 0]).all(axis=1)
        )
        _, corner = np.unique(snapped[good].reshape(-1, 3), axis=0, return_inverse=True)
        keys = np.sort(corner.reshape(-1, 3), axis=1)
        _, once = np.unique(keys, axis=0, return_index=True)
        if len(once) <= _MOST_DRAWN:
            kept = np.flatnonzero(good)[np.sort(once)]
            return snapped[kept] * pitch, None if places is None else places[kept]
        pitch *= 1.3


def _obj(triangles: NDArray[np.float64], places: NDArray[np.float64] | None) -> bytes | None:
    """Formats a mesh as an OBJ file with each corner once; `None` if no triangle is left."""
    points, corner = np.unique(np.round(triangles.reshape(-1, 3), 4), axis=0, return_inverse=True)
    faces = corner.reshape(-1, 3) + 1
    spread = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    if len(points) < 4 or not spread.any() or np.ptp(points, axis=0).max() < 1e-3:
        return None  # MuJoCo reads no mesh of fewer than four corners
    a, b, c = (points[faces[:, corner] - 1] for corner in range(3))
    if np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 < _LEAST_AREA_M2:
        return None  # nor one that is a line
    if places is not None:
        places = np.nan_to_num(places, nan=0.0, posinf=0.0, neginf=0.0)
    lines = ["v " + " ".join(map(_short, point)) for point in points.tolist()]
    if places is None:
        lines += [f"f {a} {b} {c}" for a, b, c in faces[spread].tolist()]
    else:
        spots, spot = np.unique(np.round(places.reshape(-1, 2), 4), axis=0, return_inverse=True)
        lines += ["vt " + " ".join(map(_short, each)) for each in spots.tolist()]
        pairs = np.stack([faces, spot.reshape(-1, 3) + 1], axis=2)[spread].reshape(-1, 6)
        lines += [f"f {a}/{u} {b}/{v} {c}/{w}" for a, u, b, v, c, w in pairs.tolist()]
    return ("\n".join(lines) + "\n").encode()


def _short(value: float) -> str:
    return f"{value:.4f}".rstrip("0").rstrip(".") or "0"


def _hfield(name: str, heights_m: NDArray[np.float64], extents: tuple[float, ...]) -> str:
    """Formats a height field that begins at its lowest point as a line of MJCF."""
    top = max(float(heights_m.max()), 1e-3)
    # MuJoCo stretches heights to 0 to 1 itself, whatever they are; the first row of the text is the northernmost.
    shares = " ".join(f"{value:.6g}" for value in np.flipud(heights_m / top).ravel())
    rows, columns = heights_m.shape
    sizes = f"{extents[0] / 2:.7g} {extents[1] / 2:.7g} {top:.7g} 0.1"
    return f'    <hfield name="{name}" nrow="{rows}" ncol="{columns}" size="{sizes}" elevation="{shares}"/>'


class Heightmaps:
    """Terrain of an imported Gazebo world, as MuJoCo height fields."""

    def __init__(self) -> None:
        self._read: dict[Geometry, tuple[str, NDArray[np.float64]]] = {}

    def heights(self, geometry: Geometry) -> NDArray[np.float64]:
        """Returns the terrain's heights in its own frame in metres, rows from south to north.

        As in Gazebo, the brightest spot is as high as the terrain's size says.

        Raises:
            SdfError: The picture cannot be read.
        """
        return self._of(geometry)[1]

    def asset(self, geometry: Geometry) -> tuple[str, str]:
        """Returns the name and MJCF line of a terrain's height field, which begins at its lowest point."""
        name, heights = self._of(geometry)
        return name, _hfield(name, heights - heights.min(), geometry.size[:2])

    def asset_of(self, terrain: Terrain) -> tuple[str, str]:
        """Returns the name and MJCF line of the height field of a mesh that is terrain."""
        content = np.append(np.round(terrain.heights_m, 4), terrain.size).tobytes()
        name = f"terrain_{hashlib.sha256(content).hexdigest()[:10]}"
        return name, _hfield(name, terrain.heights_m, terrain.size[:2])

    def _of(self, geometry: Geometry) -> tuple[str, NDArray[np.float64]]:
        if geometry not in self._read:
            assert geometry.file is not None
            try:
                picture = Image.open(BytesIO(read_bytes(geometry.file, _MOST_PICTURE_BYTES)), formats=_FORMATS)
                if picture.width * picture.height > _MOST_SOURCE_PIXELS:
                    raise SdfError(f"{geometry.file}: it has {picture.width} x {picture.height} pixels")
                gray = picture.convert("I") if picture.mode.startswith("I") else picture.convert("L")
                if max(gray.size) > _MOST_TERRAIN:
                    gray = gray.resize((min(gray.width, _MOST_TERRAIN), min(gray.height, _MOST_TERRAIN)))
            except SdfError:
                raise
            except Exception as error:
                raise SdfError(f"{geometry.file}: the heightmap cannot be read: {error}") from error
            shares = np.asarray(gray, np.float64)
            shares /= max(float(shares.max()), 1.0)
            self._read[geometry] = f"terrain_{len(self._read)}", np.flipud(shares) * geometry.size[2]
        return self._read[geometry]
