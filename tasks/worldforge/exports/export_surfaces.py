"""Surfaces of shapes in mesh formats: their triangles in true size, and their picture coordinates."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import mujoco
import numpy as np
from numpy.typing import NDArray

from .export_meshes import Mesh, capsule_mesh, compiled_mesh, picture_places, unit_mesh
from .export_scene import Shape, texture_pixels


def is_pictured(model: mujoco.MjModel, shape: Shape) -> bool:
    """Whether there is a picture on it.

    Round shapes, and meshes without places on the picture, have plain colours.
    """
    if shape.material < 0 or texture_pixels(model, shape.material) is None:
        return False
    laid = shape.kind == "mesh" and picture_places(model, shape.mesh) is not None
    return laid or shape.kind in ("box", "plane", "cylinder")


def drawn_mesh(model: mujoco.MjModel, shape: Shape) -> Mesh:
    """Its triangles, in its own axes; of a ceiling those of its underside alone, through the middle."""
    if shape.kind == "capsule":
        return capsule_mesh(shape.half[0], shape.half[2])
    if shape.kind == "mesh":
        return compiled_mesh(model, shape.mesh)
    if shape.ceiling and shape.kind == "box":
        mesh = unit_mesh("plane")
        return Mesh(mesh.positions * shape.half, -mesh.normals, mesh.triangles[:, ::-1])
    mesh = unit_mesh(shape.kind)
    normals = mesh.normals / np.maximum(shape.half, 1e-9)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Mesh(mesh.positions * shape.half, normals, mesh.triangles, mesh.flat)


def picture_coordinates(model: mujoco.MjModel, shape: Shape, mesh: Mesh) -> NDArray[np.float64]:
    """Picture coordinates of the vertices of a mesh in true size: repetitions to the right, and up from the foot.

    For a flat mesh, those of the corners of its faces.
    """
    places = picture_places(model, shape.mesh) if shape.kind == "mesh" else None
    if places is None:
        return _projected(model, shape, mesh.apart())
    return places * [1.0, -1.0] + [0.0, 1.0]


def _projected(model: mujoco.MjModel, shape: Shape, mesh: Mesh) -> NDArray[np.float64]:
    """The picture projected along each face's normal, in the shape's own axes."""
    axis = np.abs(mesh.normals).argmax(axis=1)
    # Which two axes run along the picture's width and height, by the normal's axis.
    across, up = np.array([2, 0, 0])[axis], np.array([1, 2, 1])[axis]
    rows = np.arange(len(axis))
    u, v = mesh.positions[rows, across], mesh.positions[rows, up]
    repeat = model.mat_texrepeat[shape.material]
    if model.mat_texuniform[shape.material]:
        # MuJoCo lays them on two metres.
        u, v = u / 2, v / 2
    else:
        half = np.maximum(np.array(shape.half), 1e-6)
        u, v = u / (2 * half[across]), v / (2 * half[up])
    return np.stack([repeat[0] * u - 0.5, 1.5 + repeat[1] * v], axis=1)


def linear(value: float) -> float:
    """Linear intensity of a colour component as screens show it (sRGB)."""
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4
