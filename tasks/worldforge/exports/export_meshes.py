"""Triangle meshes of unit shapes, for formats and simulators that do not have the shape itself."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np
from numpy.typing import NDArray
from trimesh import Trimesh, creation

from .export_scene import Kind

_SEGMENTS = 24
_RINGS = 12
_LEVEL = 0.9
"""Upward part of the normal from which a face is an end of a cylinder."""


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles with a normal at each vertex, counter-clockwise seen from outside."""

    positions: NDArray[np.float64]
    """Shape (vertices, 3)."""
    normals: NDArray[np.float64]
    """Shape (vertices, 3)."""
    triangles: NDArray[np.int64]
    """Shape (triangles, 3)."""


@cache
def unit_mesh(kind: Kind) -> Mesh:
    """The shape with half extents of 1: a cube of edge 2, a ball of radius 1.

    Raises:
        ValueError: the shape has no unit, such as a capsule, whose ends change with its proportions.
    """
    if kind == "box":
        return _flat(creation.box((2.0, 2.0, 2.0)))
    if kind == "plane":
        corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        return Mesh(corners, np.tile([0.0, 0, 1], (4, 1)), np.array([[0, 1, 2], [0, 2, 3]]))
    if kind in ("sphere", "ellipsoid"):
        up = np.linspace(-np.pi / 2, np.pi / 2, _RINGS + 1)
        ball = creation.revolve(np.column_stack([np.cos(up), np.sin(up)]), sections=_SEGMENTS)
        return Mesh(np.array(ball.vertices), np.array(ball.vertices), np.array(ball.faces))
    if kind == "cylinder":
        mesh = _flat(creation.cylinder(1.0, 2.0, sections=_SEGMENTS))
        on_end = np.abs(mesh.normals[:, 2:]) > _LEVEL
        return Mesh(mesh.positions, np.where(on_end, mesh.normals, mesh.positions * [1, 1, 0]), mesh.triangles)
    raise ValueError(f"kind {kind!r}: has no unit mesh")


def capsule_mesh(radius: float, half_length: float) -> Mesh:
    """A capsule along z; `half_length` is that of its straight part."""
    solid = creation.capsule(2 * half_length, radius, count=[_RINGS, _SEGMENTS])
    positions = np.array(solid.vertices)
    middle = np.clip(positions, -half_length, half_length) * [0, 0, 1]
    return Mesh(positions, (positions - middle) / radius, np.array(solid.faces))


def compiled_mesh(model: mujoco.MjModel, mesh: int) -> Mesh:
    """A mesh of the compiled MJCF, flat-shaded."""
    start, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    first, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    vertices, triangles = model.mesh_vert[start : start + count], model.mesh_face[first : first + faces]
    return _flat(Trimesh(vertices, triangles, process=False))


def picture_places(model: mujoco.MjModel, mesh: int) -> NDArray[np.float64] | None:
    """Places on a picture of the vertices that `compiled_mesh` gives: repetitions to the right and down.

    None for a mesh that has none.
    """
    start = int(model.mesh_texcoordadr[mesh])
    if start < 0:
        return None
    first, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    return model.mesh_texcoord[start + model.mesh_facetexcoord[first : first + faces].ravel()].astype(np.float64)


def obj_text(mesh: Mesh, places: NDArray[np.float64] | None = None, look: str = "") -> str:
    """The mesh as a Wavefront OBJ file.

    Args:
        mesh: the mesh.
        places: of its vertices on a picture, repetitions to the right and up; without, it has none.
        look: name of its material, and of the `.mtl` file beside it that has that.
    """
    lines = [f"mtllib {look}.mtl", f"usemtl {look}"] if look else []
    lines += [f"v {x:.5g} {y:.5g} {z:.5g}" for x, y, z in mesh.positions + 0.0]
    lines += [f"vn {x:.4g} {y:.4g} {z:.4g}" for x, y, z in mesh.normals + 0.0]
    if places is None:
        lines += [f"f {a}//{a} {b}//{b} {c}//{c}" for a, b, c in mesh.triangles + 1]
    else:
        lines += [f"vt {right:.5g} {up:.5g}" for right, up in places + 0.0]
        lines += [f"f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}" for a, b, c in mesh.triangles + 1]
    return "\n".join([*lines, ""])


def _flat(solid: Trimesh) -> Mesh:
    """The mesh with each face's corners for itself, so that it has edges."""
    normals = np.repeat(solid.face_normals, 3, axis=0)
    return Mesh(solid.triangles.reshape(-1, 3), normals, np.arange(len(normals)).reshape(-1, 3))
