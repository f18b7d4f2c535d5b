"""Triangle meshes of unit shapes, for formats and simulators that do not have the shape itself."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from dataclasses import dataclass
from functools import cache
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from trimesh import creation

from .export_scene import Kind, Shape, texture_pixels

_SEGMENTS = 24
_RINGS = 12
_NO_AREA_M2 = 1e-12
"""Limit of twice the area below which a triangle is degenerate and has no normal, in square metres."""
_LEVEL = 0.9
"""Upward part of a normal from which on a face is an end of a cylinder and not its side."""


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangle mesh for world exports; triangles are counter-clockwise seen from outside."""

    positions: NDArray[np.float64]
    """Positions of the vertices, shape (vertices, 3)."""
    normals: NDArray[np.float64]
    """Normals, shape (vertices, 3); of a flat-shaded mesh one per triangle, shape (triangles, 3)."""
    triangles: NDArray[np.int64]
    """Vertex indices of each triangle, shape (triangles, 3)."""
    flat: bool = False
    """Whether the mesh is flat-shaded: one normal per triangle instead of one per vertex."""

    def apart(self) -> "Mesh":
        """Returns the mesh with a normal at each vertex; faces of a flat-shaded mesh get their own vertices."""
        if not self.flat:
            return self
        corners = self.positions[self.triangles.ravel()]
        return Mesh(corners, np.repeat(self.normals, 3, axis=0), np.arange(len(corners)).reshape(-1, 3))


@cache
def unit_mesh(kind: Kind) -> Mesh:
    """Returns the mesh of a shape with half sizes of 1: a cube of edge 2, a ball of radius 1.

    Raises:
        ValueError: The shape has no unit, such as a capsule, whose ends change with its proportions.
    """
    if kind == "box":
        box = creation.box((2.0, 2.0, 2.0))
        return Mesh(np.array(box.vertices), np.array(box.face_normals), np.array(box.faces), flat=True)
    if kind == "plane":
        corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        return Mesh(corners, np.tile([0.0, 0, 1], (4, 1)), np.array([[0, 1, 2], [0, 2, 3]]))
    if kind in ("sphere", "ellipsoid"):
        up = np.linspace(-np.pi / 2, np.pi / 2, _RINGS + 1)
        ball = creation.revolve(np.column_stack([np.cos(up), np.sin(up)]), sections=_SEGMENTS)
        return Mesh(np.array(ball.vertices), np.array(ball.vertices), np.array(ball.faces))
    if kind == "cylinder":
        solid = creation.cylinder(1.0, 2.0, sections=_SEGMENTS)
        mesh = Mesh(np.array(solid.vertices), np.array(solid.face_normals), np.array(solid.faces), flat=True).apart()
        on_end = np.abs(mesh.normals[:, 2:]) > _LEVEL
        return Mesh(mesh.positions, np.where(on_end, mesh.normals, mesh.positions * [1, 1, 0]), mesh.triangles)
    raise ValueError(f"kind {kind!r}: has no unit mesh")


def capsule_mesh(radius: float, half_length: float) -> Mesh:
    """Returns the mesh of a capsule along z; `half_length` is that of its straight part."""
    solid = creation.capsule(2 * half_length, radius, count=[_RINGS, _SEGMENTS])
    positions = np.array(solid.vertices)
    middle = np.clip(positions, -half_length, half_length) * [0, 0, 1]
    return Mesh(positions, (positions - middle) / radius, np.array(solid.faces))


def compiled_mesh(model: mujoco.MjModel, mesh: int) -> Mesh:
    """Returns a mesh of the compiled MuJoCo model, flat-shaded."""
    start, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    first, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    vertices = model.mesh_vert[start : start + count].astype(np.float64)
    triangles = model.mesh_face[first : first + faces].astype(np.int64)
    one, two, three = (vertices[triangles[:, corner]] for corner in range(3))
    normals = np.cross(two - one, three - one)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    # A face without an area has no normal.
    return Mesh(
        vertices, np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0), triangles, flat=True
    )


def terrain_mesh(model: mujoco.MjModel, field: int) -> Mesh:
    """Returns the surface of a height field of the MuJoCo model, with the sides and the bottom of the solid below it.

    The triangles of the surface are those that MuJoCo collides with, their normals are smooth.

    Args:
        model: The compiled model.
        field: Index of the height field.
    """
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    start = int(model.hfield_adr[field])
    half_x, half_y, top, base = (float(value) for value in model.hfield_size[field])
    heights = model.hfield_data[start : start + rows * columns].astype(np.float64) * top
    x, y = np.meshgrid(np.linspace(-half_x, half_x, columns), np.linspace(-half_y, half_y, rows))
    surface = np.column_stack([x.ravel(), y.ravel(), heights])
    corner = np.arange(rows * columns).reshape(rows, columns)
    south_west, south_east, north_west, north_east = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
    # MuJoCo cuts each cell from its south-western to its north-eastern corner.
    halves = [(south_west, south_east, north_east), (south_west, north_east, north_west)]
    triangles = np.concatenate([np.stack(half, axis=-1).reshape(-1, 3) for half in halves])
    sides = [_side(surface, edge, -base) for edge in (corner[0], corner[:, -1], corner[-1, ::-1], corner[::-1, 0])]
    bottom = surface[[0, columns - 1, -1, -columns]] * [1, 1, 0] - [0, 0, base]
    flat = np.concatenate([*sides, bottom[[[0, 2, 1], [0, 3, 2]]]])
    crossed = np.cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0])
    away = crossed / np.maximum(np.linalg.norm(crossed, axis=1, keepdims=True), _NO_AREA_M2)
    return Mesh(
        np.concatenate([surface, flat.reshape(-1, 3)]),
        np.concatenate([_smooth(surface, triangles), np.repeat(away, 3, axis=0)]),
        np.concatenate([triangles, len(surface) + np.arange(3 * len(flat)).reshape(-1, 3)]),
    )


def _side(surface: NDArray[np.float64], edge: NDArray[np.int64], bottom_m: float) -> NDArray[np.float64]:
    """Returns the triangles of a terrain's side wall.

    The wall goes from an edge of the surface, given counter-clockwise, down to a height.
    """
    high = surface[edge]
    low = high * [1, 1, 0] + [0, 0, bottom_m]
    return np.concatenate([
        np.stack([low[:-1], low[1:], high[1:]], axis=1), np.stack([low[:-1], high[1:], high[:-1]], axis=1)
    ])  # fmt: skip


def _smooth(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    """Computes smooth vertex normals: the area-weighted mean of the normals of the triangles around each vertex."""
    one, two, three = (points[triangles[:, corner]] for corner in range(3))
    normals = np.zeros_like(points)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], np.cross(two - one, three - one))
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def picture_places(model: mujoco.MjModel, mesh: int) -> NDArray[np.float64] | None:
    """Returns the texture coordinates of a mesh in the MuJoCo model; `None` if the mesh has none."""
    start = int(model.mesh_texcoordadr[mesh])
    if start < 0:
        return None
    first, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    return model.mesh_texcoord[start + model.mesh_facetexcoord[first : first + faces].ravel()].astype(np.float64)


def obj_text(mesh: Mesh, places: NDArray[np.float64] | None = None, look: str = "", *, digits: int = 5) -> str:
    """Formats a mesh as a Wavefront OBJ file.

    Args:
        mesh: The mesh.
        places: On a picture, of its vertices, or of the corners of its faces where it is flat: repetitions to the
            right and up; without, it has none.
        look: Name of its material, and of the `.mtl` file beside it that has that.
        digits: Number of digits of each coordinate.
    """
    head = [f"mtllib {look}.mtl", f"usemtl {look}"] if look else []
    corners = mesh.triangles + 1
    normals = np.repeat(np.arange(1, len(corners) + 1), 3).reshape(-1, 3) if mesh.flat else corners
    spots = np.arange(1, corners.size + 1).reshape(-1, 3) if mesh.flat else corners
    parts = [
        _lines(" ".join(["v", *[f"%.{digits}g"] * 3]), mesh.positions + 0.0),
        _lines("vn %.4g %.4g %.4g", mesh.normals + 0.0),
    ]
    if places is None:
        parts.append(_lines("f %d//%d %d//%d %d//%d", np.stack([corners, normals], axis=2)))
    else:
        parts.append(_lines("vt %.5g %.5g", places + 0.0))
        parts.append(_lines("f %d/%d/%d %d/%d/%d %d/%d/%d", np.stack([corners, spots, normals], axis=2)))
    return "\n".join([*head, *parts, ""])


def _lines(line: str, rows: NDArray[Any]) -> str:
    """Formats many rows of numbers at once with one line format, as meshes have a hundred thousand numbers."""
    return "\n".join([line] * len(rows)) % tuple(rows.ravel().tolist())


def is_pictured(model: mujoco.MjModel, shape: Shape) -> bool:
    """Whether a shape has a texture image.

    Round shapes, and meshes without places on the picture, have plain colours.
    """
    if shape.material < 0 or texture_pixels(model, shape.material) is None:
        return False
    laid = shape.kind == "mesh" and picture_places(model, shape.mesh) is not None
    return laid or shape.kind in ("box", "plane", "cylinder")


def drawn_mesh(model: mujoco.MjModel, shape: Shape) -> Mesh:
    """Returns the triangles of a shape in its own frame; of a ceiling, those of its underside."""
    if shape.kind == "capsule":
        return capsule_mesh(shape.half[0], shape.half[2])
    if shape.kind == "mesh":
        return compiled_mesh(model, shape.mesh)
    if shape.kind == "terrain":
        return terrain_mesh(model, shape.mesh)
    if shape.ceiling and shape.kind == "box":
        mesh = unit_mesh("plane")
        return Mesh(mesh.positions * shape.half, -mesh.normals, mesh.triangles[:, ::-1])
    mesh = unit_mesh(shape.kind)
    normals = mesh.normals / np.maximum(shape.half, 1e-9)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Mesh(mesh.positions * shape.half, normals, mesh.triangles, mesh.flat)


def picture_coordinates(model: mujoco.MjModel, shape: Shape, mesh: Mesh) -> NDArray[np.float64]:
    """Returns the texture coordinates of a shape's vertices, in repetitions to the right and up.

    For a flat mesh, those of the corners of its faces.
    """
    places = picture_places(model, shape.mesh) if shape.kind == "mesh" else None
    if places is None:
        return _projected(model, shape, mesh.apart())
    return places * [1.0, -1.0] + [0.0, 1.0]


def _projected(model: mujoco.MjModel, shape: Shape, mesh: Mesh) -> NDArray[np.float64]:
    """Computes texture coordinates by projecting the picture along each face's normal, in the shape's own axes.

    The result has shape (vertices, 2).
    """
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
    """Converts an sRGB colour component to linear intensity, both from 0 to 1."""
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4
