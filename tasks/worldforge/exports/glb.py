"""A world as GLB, for browsers and other viewers of glTF 2.0.

One node per thing (`building`, furniture and bodies by their ids in `world.json`), its parts below
it; y points up, as glTF has it, and x east. Ceilings face downwards only, so that one looks into
the rooms from above.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from io import BytesIO
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .export_meshes import Mesh, capsule_mesh, compiled_mesh, unit_mesh
from .export_scene import Matrix, Scene, Shape, Thing, Vector, read_scene, texture_pixels, texture_png
from .glb_file import GlbFile

_TO_Y_UP = [-0.70710678, 0.0, 0.0, 0.70710678]
_LINEAR, _LINEAR_MIPMAP_LINEAR, _REPEAT = 9729, 9987, 10497
_ROUGHNESS = 0.85
_DIGITS = 5

Color = tuple[float, float, float, float]


def world_glb(bundle: Path) -> bytes:
    """The world of a bundle.

    Raises:
      FileNotFoundError: the bundle lacks `world.json` or `world.xml`.
      ValueError: one of them is none.
    """
    return scene_glb(read_scene(bundle))


def scene_glb(scene: Scene) -> bytes:
    """The scene's drawn shapes as GLB; equal scenes give equal bytes."""
    return _Writer(scene).write()


class _Writer:
    """Puts shapes into a GLB file; equal meshes and materials are stored once."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._model = scene.model
        self._file = GlbFile()
        self._attributes: dict[Any, dict[str, Any]] = {}
        self._meshes: dict[Any, int] = {}
        self._materials: dict[Any, int] = {}

    def write(self) -> bytes:
        roots = [self._thing(thing) for thing in self._scene.things]
        world = self._file.append("nodes", {"name": "world", "rotation": _TO_Y_UP, "children": roots})
        self._file.document |= {"scene": 0, "scenes": [{"nodes": [world]}]}
        return self._file.to_bytes()

    def _thing(self, thing: Thing) -> int:
        children = [self._shape(shape) for shape in thing.shapes if shape.drawn and not shape.endless]
        node = {"name": thing.name, **_placed(thing.position, thing.rotation)}
        return self._file.append("nodes", {**node, "children": children} if children else node)

    def _shape(self, shape: Shape) -> int:
        mesh, scale = self._mesh(shape)
        position = shape.position
        if shape.ceiling and shape.kind == "box":
            position = position - shape.rotation[:, 2] * shape.half[2]
        node = {"name": shape.name, "mesh": mesh, **_placed(position, shape.rotation)}
        if scale != (1.0, 1.0, 1.0):
            node["scale"] = [round(value, _DIGITS) for value in scale]
        return self._file.append("nodes", node)

    def _mesh(self, shape: Shape) -> tuple[int, tuple[float, float, float]]:
        """The mesh, and what it has to be scaled by."""
        material, textured = self._material(shape)
        fixed = textured or shape.kind in ("capsule", "mesh")
        form = "ceiling" if shape.ceiling and shape.kind == "box" else shape.kind
        key = (form, shape.half if fixed else None, shape.mesh, material)
        if key not in self._meshes:
            primitive = {**self._geometry(shape, form, textured), "material": material}
            self._meshes[key] = self._file.append("meshes", {"primitives": [primitive]})
        if fixed:
            return self._meshes[key], (1.0, 1.0, 1.0)
        flat = form in ("plane", "ceiling")
        return self._meshes[key], (*shape.half[:2], 1.0) if flat else shape.half

    def _geometry(self, shape: Shape, form: str, textured: bool) -> dict[str, Any]:
        """Accessors of the vertices and triangles."""
        fixed = textured or form == "capsule"
        key = (form, shape.half if fixed else None, shape.mesh, shape.material if textured else None)
        if key not in self._attributes:
            mesh = _mesh_of(self._model, shape, form, scaled=textured)
            attributes = {
                "POSITION": self._file.add_vectors(mesh.positions),
                "NORMAL": self._file.add_vectors(mesh.normals),
            }
            if textured:
                attributes["TEXCOORD_0"] = self._file.add_vectors(self._texture_coordinates(mesh, shape))
            self._attributes[key] = {"attributes": attributes, "indices": self._file.add_triangles(mesh.triangles)}
        return self._attributes[key]

    def _texture_coordinates(self, mesh: Mesh, shape: Shape) -> NDArray[np.float64]:
        """The picture projected along each face's normal, in the shape's own axes."""
        axis = np.abs(mesh.normals).argmax(axis=1)
        # Which two axes run along the picture's width and height, by the normal's axis.
        across, up = np.array([2, 0, 0])[axis], np.array([1, 2, 1])[axis]
        rows = np.arange(len(axis))
        u, v = mesh.positions[rows, across], mesh.positions[rows, up]
        repeat = self._model.mat_texrepeat[shape.material]
        if not self._model.mat_texuniform[shape.material]:
            half = np.maximum(np.array(shape.half), 1e-6)
            u, v = u / (2 * half[across]), v / (2 * half[up])
        return np.stack([repeat[0] * u - 0.5, -repeat[1] * v - 0.5], axis=1)

    def _material(self, shape: Shape) -> tuple[int, bool]:
        """The material, and whether there is a picture on it."""
        pixels = texture_pixels(self._model, shape.material) if shape.material >= 0 else None
        if shape.material >= 0 and pixels is not None and self._keeps_its_color(shape):
            key: Any = shape.material
        else:
            pixels, key = None, shape.color
        if key not in self._materials:
            self._materials[key] = self._add_material(shape, pixels)
        return self._materials[key], pixels is not None

    def _keeps_its_color(self, shape: Shape) -> bool:
        """Whether the shape has no colour of its own beside the material's."""
        return shape.kind not in ("sphere", "ellipsoid", "capsule", "mesh")

    def _add_material(self, shape: Shape, pixels: NDArray[np.uint8] | None) -> int:
        color: Color = shape.color
        surface: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": _ROUGHNESS}
        entry: dict[str, Any] = {"pbrMetallicRoughness": surface}
        if pixels is not None:
            entry["name"] = self._model.material(shape.material).name
            surface["baseColorTexture"] = {"index": self._add_texture(shape.material, pixels, entry["name"])}
            color = tuple(float(value) for value in self._model.mat_rgba[shape.material])  # pyright: ignore[reportAssignmentType]
        surface["baseColorFactor"] = [*(round(_linear(value), 4) for value in color[:3]), round(color[3], 4)]
        if color[3] < 1:
            entry["alphaMode"] = "BLEND"
        return self._file.append("materials", entry)

    def _add_texture(self, material: int, pixels: NDArray[np.uint8], name: str) -> int:
        if not self._file.document.get("samplers"):
            wrap = {"wrapS": _REPEAT, "wrapT": _REPEAT}
            self._file.append("samplers", {"magFilter": _LINEAR, "minFilter": _LINEAR_MIPMAP_LINEAR, **wrap})
        png = texture_png(self._scene, material) or _png(pixels)
        return self._file.append("textures", {"sampler": 0, "source": self._file.add_image(png, name)})


def _png(pixels: NDArray[np.uint8]) -> bytes:
    png = BytesIO()
    Image.fromarray(pixels.squeeze()).save(png, "PNG")
    return png.getvalue()


def _mesh_of(model: mujoco.MjModel, shape: Shape, form: str, *, scaled: bool) -> Mesh:
    if form == "capsule":
        return capsule_mesh(shape.half[0], shape.half[2])
    if form == "mesh":
        return compiled_mesh(model, shape.mesh)
    mesh = unit_mesh("plane") if form == "ceiling" else unit_mesh(shape.kind)
    if form == "ceiling":
        mesh = Mesh(mesh.positions, -mesh.normals, mesh.triangles[:, ::-1])
    return Mesh(mesh.positions * shape.half, mesh.normals, mesh.triangles) if scaled else mesh


def _placed(position: Vector, rotation: Matrix) -> dict[str, list[float]]:
    """The members of a node that place it; none for a node that stays where it is."""
    placed: dict[str, list[float]] = {}
    if position.any():
        placed["translation"] = [round(float(value), _DIGITS) + 0.0 for value in position]
    if not np.array_equal(rotation, np.eye(3)):
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, rotation.ravel())
        w, x, y, z = (round(float(value), 7) + 0.0 for value in quaternion)
        placed["rotation"] = [x, y, z, w]
    return placed


def _linear(value: float) -> float:
    """Linear intensity of a colour component as screens show it (sRGB)."""
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4
