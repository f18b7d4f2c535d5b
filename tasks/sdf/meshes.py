"""Reads COLLADA, STL, OBJ and glTF meshes: triangles in metres, texture coordinates and colours.

The up axis of COLLADA files is ignored, as Gazebo ignores it, too: many say `Y_UP` and are Z up.
"""

import io
import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ...schemas.extras import how_to_install
from .lookup import Lookup
from .sdf_types import Geometry, Material, Rgba, SdfError
from .xml_files import read_bytes

MOST_MESH_BYTES = 128 * 1024 * 1024
MOST_TRIANGLES = 1_000_000
"""Limit of the triangles of one mesh; the largest public one has 568,000."""
_MOST_COORDINATE_M = 1e5
_MOST_NAMED = 12
_SUFFIXES = (".dae", ".stl", ".obj", ".gltf", ".glb")

Triangles = NDArray[np.float64]
"""Triangle corners, shape (n, 3, 3), in metres."""


class MeshError(SdfError):
    """Raised for a mesh file that cannot be read."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"{path}: {reason}")
        self.short = f"{path.name}: {reason}"
        """Error text without the mesh file's folder, which differs from machine to machine."""


@dataclass(frozen=True, slots=True)
class MeshPart:
    """Triangles of a mesh with one material."""

    triangles: Triangles
    places: NDArray[np.float64] | None
    """Texture coordinates of the corners, shape (n, 3, 2); `None`: no texture."""
    material: Material
    picture: Image.Image | None = None
    """Texture that is embedded in the mesh file; `None`: there is none."""
    names: tuple[str, ...] = ()
    """Names of the submesh, the one that Gazebo uses first: that of the node, then that of the geometry."""


class Meshes:
    """Reads the mesh files of an SDF world, each once.

    Args:
        lookup: Finds texture files.
    """

    def __init__(self, lookup: Lookup) -> None:
        self._lookup = lookup
        self._read = lru_cache(maxsize=64)(self._parts)

    def parts(self, geometry: Geometry) -> tuple[MeshPart, ...]:
        """Returns a mesh's parts by material, scaled.

        Args:
            geometry: A mesh.

        Raises:
            MeshError: The mesh cannot be read, is empty, or is too large.
        """
        assert geometry.file is not None
        found = self._read(geometry.file, geometry.submesh is not None)
        if not found:
            raise MeshError(geometry.file, "it has no triangles")
        if geometry.submesh is not None:
            found = _submesh(found, geometry.submesh, geometry.file)
        scale = np.array(geometry.scale)
        middle = np.zeros(3)
        if geometry.is_centred:
            corners = np.concatenate([part.triangles.reshape(-1, 3) for part in found])
            middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        if not middle.any() and (scale == 1.0).all():
            return found
        # A mirrored mesh has its inside out unless its corners change places.
        order = slice(None, None, -1) if scale.prod() < 0 else slice(None)
        reach = max(float((np.abs(part.triangles - middle) * np.abs(scale)).max()) for part in found)
        if not reach < _MOST_COORDINATE_M:
            raise MeshError(
                geometry.file,
                f"in its scale it reaches {reach:.3g} m; less than {_MOST_COORDINATE_M:g} m would be right",
            )
        return tuple(
            replace(
                part,
                triangles=((part.triangles - middle) * scale)[:, order],
                places=None if part.places is None else part.places[:, order],
            )
            for part in found
        )

    def triangles(self, geometry: Geometry) -> Triangles:
        """Returns all triangles of a mesh, without materials."""
        return np.concatenate([part.triangles for part in self.parts(geometry)])

    def _parts(self, path: Path, by_name: bool) -> tuple[MeshPart, ...]:
        reader = _READERS.get(path.suffix.lower())
        if reader is None:
            raise MeshError(path, f"{', '.join(_SUFFIXES)} can be read")
        try:
            content = read_bytes(path, MOST_MESH_BYTES)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # readers warn of files and of libraries below them
                found = [_sound(part) for part in reader(content, path, by_name, self._lookup)]
        except (MeshError, ImportError):
            raise
        except SdfError as error:
            raise MeshError(path, str(error).partition(": ")[2]) from error
        # Readers of formats fail in many ways on files that are broken.
        except Exception as error:
            raise MeshError(path, f"it cannot be read: {str(error)[:160] or type(error).__name__}") from error
        found = [part for part in found if len(part.triangles)]
        count = sum(len(part.triangles) for part in found)
        if count > MOST_TRIANGLES:
            raise MeshError(path, f"it has {count:,} triangles; at most {MOST_TRIANGLES:,} are read")
        return tuple(found)


def _submesh(parts: tuple[MeshPart, ...], name: str, path: Path) -> tuple[MeshPart, ...]:
    """Returns the parts of the submesh of a name; all parts of a file without any names, such as STL.

    Raises MeshError if no part has that name.
    """
    there = [each for part in parts for each in part.names[:1] if each]
    for named in ([part for part in parts if name in part.names[:1]], [part for part in parts if name in part.names]):
        if named:
            return tuple(named)
    if not there:
        return parts
    raise MeshError(path, f"it has no submesh {name!r}; it has {', '.join(dict.fromkeys(there[:_MOST_NAMED]))}")


def _sound(part: MeshPart) -> MeshPart:
    """Returns a mesh part without triangles that have a corner that is not finite, or as far away as 100 km."""
    good = np.isfinite(part.triangles).all(axis=(1, 2)) & (np.abs(part.triangles) < _MOST_COORDINATE_M).all(axis=(1, 2))
    if good.all():
        return part
    return replace(part, triangles=part.triangles[good], places=None if part.places is None else part.places[good])


def _read_dae(content: bytes, path: Path, by_name: bool, lookup: Lookup) -> Iterator[MeshPart]:
    if b"\0" in content[:4096] or b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise MeshError(path, "it declares a DOCTYPE or is no UTF-8, which meshes do not need")
    try:
        import collada
        from collada.common import DaeBrokenRefError, DaeUnsupportedError
    except ImportError:
        raise ImportError(f"{path}: COLLADA meshes need pycollada: {how_to_install('gazebo')}") from None
    document = collada.Collada(io.BytesIO(content), ignore=[DaeUnsupportedError, DaeBrokenRefError])
    unit = float(getattr(document.assetInfo, "unitmeter", None) or 1.0)
    if document.scene is None:
        return
    del by_name
    for node, geometry in _dae_geometries(document.scene.nodes, None, ""):
        names = node, str(geometry.original.name or ""), str(geometry.original.id or "")
        for primitive in geometry.primitives():
            triangulate = getattr(primitive, "triangleset", None)
            flat = triangulate() if triangulate is not None else primitive
            if getattr(flat, "vertex_index", None) is None or flat.vertex_index.ndim != 2:
                continue  # lines
            if flat.vertex_index.shape[1:] != (3,) or not len(flat.vertex_index):
                continue
            triangles = np.asarray(flat.vertex[flat.vertex_index], np.float64) * unit
            places = None
            if len(flat.texcoordset) and len(flat.texcoord_indexset):
                places = np.asarray(flat.texcoordset[0], np.float64)[flat.texcoord_indexset[0]][..., :2]
            yield MeshPart(triangles, places, _dae_material(flat.material, path, lookup), names=names)


def _dae_geometries(nodes: Iterable[Any], matrix: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Yields the geometries in a COLLADA scene, transformed, each with the name of its nearest named node."""
    from collada.scene import Node

    for node in nodes:
        if not isinstance(node, Node):
            yield from ((name, each) for each in node.objects("geometry", matrix))
            # Meshes with bones stand as they were bound to them.
            bound = node.objects("controller", matrix)
            yield from ((name, each.geometry) for each in bound if getattr(each, "geometry", None) is not None)
            continue
        inner = node.matrix if matrix is None else np.dot(matrix, node.matrix)
        own = getattr(node, "node", node).xmlnode.get("name")  # an instance of a node has the name of that
        yield from _dae_geometries(node.children, inner, own or name)


def _dae_material(material: Any, path: Path, lookup: Lookup) -> Material:
    effect = getattr(material, "effect", None)
    diffuse = getattr(effect, "diffuse", None)
    if diffuse is None:
        return Material()
    sampler = getattr(diffuse, "sampler", None)
    if sampler is not None:
        name = unquote(str(sampler.surface.image.path))
        return Material((1.0, 1.0, 1.0, 1.0), lookup.file(name, path.parent), True)
    return Material(_rgba(diffuse), None, True)


def _rgba(values: Any) -> Rgba:
    red, green, blue, *alpha = (min(max(0.0, float(value)), 1.0) for value in values)  # what is no number is 0
    # COLLADA's transparency is told in so many ways that 0 mostly means the opposite.
    return red, green, blue, alpha[0] if alpha and alpha[0] > 0 else 1.0


def _read_trimesh(content: bytes, path: Path, by_name: bool, lookup: Lookup) -> Iterator[MeshPart]:
    import trimesh

    kind = path.suffix.lower().lstrip(".")
    resolver = None if kind in ("stl", "glb") else _files_beside(path)
    # OBJ files are taken apart by materials, unless a part is wanted that they name: an object, or a group.
    apart: dict[str, Any] = {}
    if by_name and kind == "obj":
        is_of_objects = content.startswith(b"o ") or b"\no " in content
        apart = {"split_objects" if is_of_objects else "split_groups": True, "group_material": False}
    loaded = trimesh.load(io.BytesIO(content), file_type=kind, resolver=resolver, process=False, **apart)
    meshes: list[tuple[tuple[str, ...], Any]]
    if isinstance(loaded, trimesh.Scene):
        meshes = [
            (tuple(str(each.metadata.get(key, "")) for key in ("node", "name")), each)
            for each in loaded.dump(concatenate=False)
        ]
    else:
        meshes = [((), loaded)]
    for names, mesh in meshes:
        if not hasattr(mesh, "triangles") or not len(mesh.faces):
            continue
        uv = getattr(mesh.visual, "uv", None)
        places = None if uv is None or len(uv) != len(mesh.vertices) else np.asarray(uv, np.float64)[mesh.faces]
        material, picture = _trimesh_material(mesh.visual)
        yield MeshPart(np.asarray(mesh.triangles, np.float64), places, material, picture, names)
    del lookup


def _files_beside(path: Path) -> Any:
    """Reads the files that an OBJ or glTF file names, in its folder and below: only regular files of limited size.

    Its `get` raises FileNotFoundError for others.
    """
    from trimesh.resolvers import FilePathResolver

    class Beside(FilePathResolver):
        def get(self, name: str) -> bytes:
            for each in (name.strip(), name.strip().rpartition("/")[2]):
                try:
                    found = self.absolute(each)
                except ValueError:  # outside of the folder
                    continue
                if found.exists():
                    return read_bytes(found, MOST_MESH_BYTES)
            raise FileNotFoundError(name)

    return Beside(str(path))


def _trimesh_material(visual: Any) -> tuple[Material, Image.Image | None]:
    material = getattr(visual, "material", None)
    if material is None:
        return Material(), None
    picture = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    color = getattr(material, "baseColorFactor", None)
    color = getattr(material, "diffuse", None) if color is None else color
    if color is None:
        return Material((1.0, 1.0, 1.0, 1.0), None, picture is not None), picture
    values = np.asarray(color, np.float64)
    values = values / 255 if values.max(initial=0.0) > 1 else values
    return Material(_rgba(values), None, True), picture


_Reader = Callable[[bytes, Path, bool, Lookup], Iterator[MeshPart]]
"""Function that reads a mesh file's parts; its third argument says whether parts are wanted by name."""
_READERS: dict[str, _Reader] = {
    ".dae": _read_dae, ".stl": _read_trimesh, ".obj": _read_trimesh, ".gltf": _read_trimesh, ".glb": _read_trimesh,
}  # fmt: skip
