"""A world as GLB, for browsers and other viewers of glTF 2.0; trimesh writes the file.

One node per thing (`building`, furniture and bodies by their ids in `world.json`), its parts and the bodies that hang
on it below it; y points up, as glTF has it, and x east. Ceilings face downwards only, so that one looks into
the rooms from above.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from pathlib import Path
from typing import Any, BinaryIO

import mujoco
import numpy as np

from ..held_signals import held_signals

with held_signals():
    import trimesh
    from trimesh.exchange.gltf import export_glb
    from trimesh.visual import TextureVisuals
    from trimesh.visual.material import PBRMaterial

from .export_meshes import Mesh, drawn_mesh, is_pictured, linear, picture_coordinates, unit_mesh
from .export_scene import Matrix, Scene, Shape, Thing, Vector, material_png, read_scene, texture_name, with_hung

_TO_Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
_ROUGHNESS = 0.85
_DIGITS = 7
_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963
_STRIDES = {"VEC2": 8, "VEC3": 12}
_APART = "\n"
"""Separator between the prefix that makes a name unique in trimesh's scene and the part's own name."""


def world_glb(bundle: Path) -> bytes:
    """Converts a world's files to a GLB (binary glTF) model.

    Raises:
        FileNotFoundError: The bundle lacks `world.json` or `world.xml`.
        ValueError: A file of the world is invalid.
    """
    return scene_glb(read_scene(bundle))


def scene_glb(scene: Scene) -> bytes:
    """Converts a scene's visible shapes to GLB (binary glTF); equal scenes give equal bytes."""
    return _Writer(scene).write()


class _Picture:
    """PNG file with the interface of a picture that trimesh expects.

    Its bytes are written unchanged and not encoded again.
    """

    format = "PNG"

    def __init__(self, png: bytes) -> None:
        self._png = png

    def save(self, file: BinaryIO, **_: Any) -> None:
        """Writes the texture file's content to an open file."""
        file.write(self._png)

    def tobytes(self) -> bytes:
        """Returns bytes by which trimesh distinguishes textures."""
        return self._png

    def __len__(self) -> int:
        return len(self._png)


class _Writer:
    """Builds trimesh's scene; equal meshes and materials are stored once."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._model = scene.model
        self._built = trimesh.Scene(base_frame=_APART)
        self._materials: dict[str, PBRMaterial] = {}
        self._colors: dict[str, list[float]] = {}
        self._pictures: dict[str, _Picture] = {}

    def write(self) -> bytes:
        graph = self._built.graph
        world = f"{_APART}world"
        graph.update(world, _APART, matrix=_matrix(np.zeros(3), _TO_Y_UP))
        things: list[Thing] = []
        for outermost in self._scene.things:
            for placed in with_hung(outermost, outermost.position, outermost.rotation):
                thing, above = placed.thing, world if placed.above is None else placed.above.thing.name
                graph.update(thing.name, above, matrix=_matrix(thing.position, thing.rotation))
                things.append(thing)
        for thing in things:
            for shape in thing.shapes:
                if shape.drawn and not shape.endless:
                    mesh, matrix = self._shape(shape)
                    graph.update(f"{thing.name}{_APART}{shape.name}", thing.name, matrix=matrix, geometry=mesh)
        return export_glb(self._built, include_normals=True, tree_postprocessor=self._finish)

    def _finish(self, document: dict[str, Any]) -> None:
        """Restores the values that trimesh changes: names (unique in a file), 8-bit colours, padded picture lengths.

        trimesh stores equal arrays once, such as places and normals of a ball; glTF then asks for their stride.
        """
        document["asset"]["generator"] = "prefect-robomaker"
        for accessor in document.get("accessors", ()):
            view = document["bufferViews"][accessor["bufferView"]]
            view["target"] = _ARRAY_BUFFER if accessor["type"] in _STRIDES else _ELEMENT_ARRAY_BUFFER
            if accessor["type"] in _STRIDES:
                view["byteStride"] = _STRIDES[accessor["type"]]
        for node in document["nodes"]:
            node["name"] = node["name"].partition(_APART)[2] or node["name"]
        for material in document.get("materials", ()):
            surface, name = material["pbrMetallicRoughness"], material["name"]
            surface["baseColorFactor"] = self._colors[name]
            if "baseColorTexture" in surface:
                image = document["images"][surface["baseColorTexture"]["index"]]
                image["name"] = name
                view = document["bufferViews"][image["bufferView"]]
                view["byteLength"] = len(self._pictures[name])

    def _shape(self, shape: Shape) -> tuple[str, Matrix]:
        """Adds a shape's mesh to the scene; returns the mesh's name and the shape's pose."""
        position = shape.position
        ceiling = shape.ceiling and shape.kind == "box"
        if ceiling:
            position = position - shape.rotation[:, 2] * shape.half[2]
        material, textured = self._material(shape)
        form = "ceiling" if ceiling else shape.kind
        fixed = textured or form in ("capsule", "mesh", "terrain")
        key = f"{form} {shape.half if fixed else ''} {shape.mesh} {material}"
        if key not in self._built.geometry:
            mesh = _mesh_of(self._model, shape, form, scaled=textured).apart()
            uv = picture_coordinates(self._model, shape, mesh) if textured else None
            self._built.geometry[key] = trimesh.Trimesh(
                mesh.positions,
                mesh.triangles,
                vertex_normals=mesh.normals,
                visual=TextureVisuals(uv=uv, material=self._materials[material]),
                process=False,
            )
        scale = np.array(
            [1.0, 1, 1] if fixed else [*shape.half[:2], 1.0 if form in ("plane", "ceiling") else shape.half[2]]
        )
        return key, _matrix(position, shape.rotation * scale)

    def _material(self, shape: Shape) -> tuple[str, bool]:
        """Adds a shape's material; returns its name, and whether it has a texture."""
        textured = is_pictured(self._model, shape)
        name = texture_name(self._model, shape.material) if textured else "#" + " ".join(map(str, shape.color))
        if name not in self._materials:
            picture, color = None, np.array(shape.color)
            if textured:
                picture = self._pictures[name] = _Picture(material_png(self._scene, shape.material))
                color = self._model.mat_rgba[shape.material]
            self._colors[name] = [round(linear(float(value)), 4) for value in color[:3]] + [round(float(color[3]), 4)]
            self._materials[name] = PBRMaterial(
                name=name,
                metallicFactor=0.0,
                roughnessFactor=_ROUGHNESS,
                baseColorTexture=picture,
                baseColorFactor=self._colors[name],
                alphaMode="BLEND" if color[3] < 1 else None,
            )
        return name, textured


def _mesh_of(model: mujoco.MjModel, shape: Shape, form: str, *, scaled: bool) -> Mesh:
    if form in ("capsule", "mesh", "terrain"):
        return drawn_mesh(model, shape)
    mesh = unit_mesh("plane") if form == "ceiling" else unit_mesh(shape.kind)
    if form == "ceiling":
        mesh = Mesh(mesh.positions, -mesh.normals, mesh.triangles[:, ::-1])
    return Mesh(mesh.positions * shape.half, mesh.normals, mesh.triangles, mesh.flat) if scaled else mesh


def _matrix(position: Vector, rotation: Matrix) -> Matrix:
    """Returns the 4×4 transformation matrix of a position and a rotation."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, position
    return np.round(matrix, _DIGITS)
