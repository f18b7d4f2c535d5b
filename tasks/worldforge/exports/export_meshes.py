"""Triangle meshes of unit shapes, for formats and simulators that do not have the shape itself."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from .export_scene import Kind

_SEGMENTS = 24
_RINGS = 12


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
        return _box()
    if kind == "plane":
        corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        return Mesh(corners, np.tile([0.0, 0, 1], (4, 1)), np.array([[0, 1, 2], [0, 2, 3]]))
    if kind in ("sphere", "ellipsoid"):
        return _sphere(0.0)
    if kind == "cylinder":
        return _cylinder()
    raise ValueError(f"kind {kind!r}: has no unit mesh")


def capsule_mesh(radius: float, half_length: float) -> Mesh:
    """A capsule along z; `half_length` is that of its straight part."""
    ball = _sphere(1.0)
    shift = np.where(ball.positions[:, 2:] > 0, 1.0, -1.0) * [0, 0, 1]
    return Mesh((ball.positions - shift) * radius + shift * half_length, ball.normals, ball.triangles)


def compiled_mesh(model: mujoco.MjModel, mesh: int) -> Mesh:
    """A mesh of the compiled MJCF, flat-shaded."""
    start, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    first, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    corners = model.mesh_vert[start : start + count][model.mesh_face[first : first + faces]].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return Mesh(corners.reshape(-1, 3), np.repeat(normals, 3, axis=0), np.arange(3 * faces).reshape(-1, 3))


def obj_text(mesh: Mesh) -> str:
    """The mesh as a Wavefront OBJ file."""
    lines = [f"v {x:.5g} {y:.5g} {z:.5g}" for x, y, z in mesh.positions + 0.0]
    lines += [f"vn {x:.4g} {y:.4g} {z:.4g}" for x, y, z in mesh.normals + 0.0]
    lines += [f"f {a}//{a} {b}//{b} {c}//{c}" for a, b, c in mesh.triangles + 1]
    return "\n".join([*lines, ""])


def _box() -> Mesh:
    positions, normals, triangles = [], [], []
    for axis in range(3):
        for side in (1.0, -1.0):
            normal = np.eye(3)[axis] * side
            across = np.eye(3)[(axis + 1) % 3] * side
            up = np.eye(3)[(axis + 2) % 3]
            first = len(positions)
            positions += [normal + a * across + b * up for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            normals += [normal] * 4
            triangles += [[first, first + 1, first + 2], [first, first + 2, first + 3]]
    return Mesh(np.array(positions), np.array(normals), np.array(triangles))


def _sphere(half_length: float) -> Mesh:
    """A ball of radius 1, with its two halves moved apart by `half_length` each."""
    down = np.linspace(0, np.pi, _RINGS + 1)
    if half_length:
        down = np.insert(down, _RINGS // 2, np.pi / 2)
    around = np.linspace(0, 2 * np.pi, _SEGMENTS + 1)
    theta, phi = np.meshgrid(down, around, indexing="ij")
    normals = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    shift = np.zeros_like(normals)
    shift[..., 2] = np.where(np.arange(len(down))[:, np.newaxis] <= _RINGS // 2, half_length, -half_length)
    return Mesh((normals + shift).reshape(-1, 3), normals.reshape(-1, 3), _grid_triangles(len(down), _SEGMENTS + 1))


def _grid_triangles(rows: int, columns: int) -> NDArray[np.int64]:
    row, column = np.meshgrid(np.arange(rows - 1), np.arange(columns - 1), indexing="ij")
    first = (row * columns + column).ravel()
    below = first + columns
    both = np.concatenate(
        [np.stack([first, below, below + 1], axis=1), np.stack([first, below + 1, first + 1], axis=1)]
    )
    # At the poles one of two triangles has no area.
    top, bottom = first < columns, first >= (rows - 2) * columns
    return both[np.concatenate([~bottom, ~top])]


def _cylinder() -> Mesh:
    around = np.linspace(0, 2 * np.pi, _SEGMENTS + 1)
    ring = np.stack([np.cos(around), np.sin(around), np.zeros_like(around)], axis=1)
    up = np.array([0.0, 0, 1])
    count = _SEGMENTS + 1
    positions, normals, triangles = [ring + up, ring - up], [ring, ring], [_wall_triangles(count)]
    for side in (1.0, -1.0):
        first = sum(len(each) for each in positions)
        positions.append((ring + side * up)[:-1])
        normals.append(np.tile(side * up, (_SEGMENTS, 1)))
        fan = np.stack([np.zeros(_SEGMENTS - 2, int), np.arange(1, _SEGMENTS - 1), np.arange(2, _SEGMENTS)], axis=1)
        triangles.append(first + (fan if side > 0 else fan[:, ::-1]))
    return Mesh(np.concatenate(positions), np.concatenate(normals), np.concatenate(triangles))


def _wall_triangles(count: int) -> NDArray[np.int64]:
    """Triangles between a ring of `count` vertices and the one below it."""
    top = np.arange(count - 1)
    low = top + count
    return np.concatenate([np.stack([top, low, low + 1], axis=1), np.stack([top, low + 1, top + 1], axis=1)])
