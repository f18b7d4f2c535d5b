"""Recognises meshes that are terrain: one height at each point of a regular grid, as in MuJoCo's height fields.

Hundreds of triangles in no common plane would be too many prisms, and boxes on a grid would be too coarse. A height
field has the exact surface.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...sdf.meshes import Triangles

_SAME_M = 1e-3
"""Distance of vertices below which they are the same, in metres: files have five digits or more."""
_LEAST_SIDE = 3
"""Least number of corners along a side of terrain; a face of a box has two."""
_DIAGONAL_TOLERANCE_M = 0.01
"""Largest height difference in the middle of a cell, in metres, between the mesh's diagonal and MuJoCo's."""


@dataclass(frozen=True, slots=True, eq=False)
class Terrain:
    """Surface with one height at each point of a regular grid, and the solid below it."""

    lowest: NDArray[np.float64]
    """Centre of the grid at the height of its lowest point, shape (3,), in metres."""
    heights_m: NDArray[np.float64]
    """Heights above the lowest point, in metres, shape (rows from south to north, columns from west to east)."""
    size: tuple[float, float, float]
    """Extents of terrain along x and y, and range of its heights, in metres."""
    is_closed: bool
    """Whether the mesh has a bottom, so that it is solid below the surface in the file, too."""


def terrain_of(triangles: Triangles) -> Terrain | None:
    """Returns the terrain that a mesh is; `None` if it is something else.

    Sides below the border of the grid and a bottom below its lowest spot may be there. MuJoCo cuts the cells of height
    fields from south-west to north-east: cells that are cut otherwise have to be nearly flat.

    Args:
        triangles: The mesh.
    """
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    up = normals[:, 2] > 1e-6 * np.linalg.norm(normals, axis=1)
    surface, rest = triangles[up], triangles[~up]
    if not len(surface):
        return None
    columns, rows = (_line(surface[..., axis]) for axis in (0, 1))
    if columns is None or rows is None or len(surface) != 2 * (len(columns) - 1) * (len(rows) - 1):
        return None
    column, row = (_nearest(line, surface[..., axis]) for line, axis in ((columns, 0), (rows, 1)))
    high, low = np.full((len(rows), len(columns)), -np.inf), np.full((len(rows), len(columns)), np.inf)
    np.maximum.at(high, (row, column), surface[..., 2])
    np.minimum.at(low, (row, column), surface[..., 2])
    # Spots without a corner are infinite, and differ.
    if not (high - low < _SAME_M).all() or not _covers(row, column, high):
        return None
    bottom_m = float(high.min())
    on_border = np.zeros(rest.shape[:2], np.bool_)
    for line, axis in ((columns, 0), (rows, 1)):
        for end in (line[0], line[-1]):
            on_border |= np.abs(rest[..., axis] - end) < _SAME_M
    if not (on_border | (rest[..., 2] < bottom_m + _SAME_M)).all():
        return None
    middle = np.array([(columns[0] + columns[-1]) / 2, (rows[0] + rows[-1]) / 2, bottom_m])
    size = float(columns[-1] - columns[0]), float(rows[-1] - rows[0]), float(high.max()) - bottom_m
    is_closed = bool((rest[..., 2] < bottom_m + _SAME_M).all(axis=1).any())
    return Terrain(middle, high - bottom_m, size, is_closed)


def _line(values: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Returns the grid coordinates along an axis, if they are equally spaced; else `None`."""
    ordered = np.sort(values.ravel())
    firsts = ordered[np.r_[True, np.diff(ordered) > _SAME_M]]
    if len(firsts) < _LEAST_SIDE:
        return None
    line = np.linspace(firsts[0], firsts[-1], len(firsts))
    return line if bool((np.abs(firsts - line) < _SAME_M).all()) else None


def _nearest(line: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.intp]:
    return np.round((values - line[0]) / (line[1] - line[0])).astype(np.intp)


def _covers(row: NDArray[np.intp], column: NDArray[np.intp], heights_m: NDArray[np.float64]) -> bool:
    """Whether each cell has two triangles that are cut like MuJoCo's, or in a way that makes little difference."""
    south, west = row.min(axis=1), column.min(axis=1)
    across, along = row - south[:, None], column - west[:, None]
    if (across.max(axis=1) != 1).any() or (along.max(axis=1) != 1).any():
        return False
    # The corner of its cell that a triangle does not have, as north and east of the middle or not.
    north, east = across.sum(axis=1) == 1, along.sum(axis=1) == 1
    cells = (heights_m.shape[0] - 1, heights_m.shape[1] - 1)
    counts = [np.zeros(cells, np.intp) for _ in range(4)]
    for number, found in enumerate((~north & ~east, ~north & east, north & ~east, north & east)):
        np.add.at(counts[number], (south[found], west[found]), 1)
    south_west, south_east, north_west, north_east = counts
    like_mujoco = (south_east == 1) & (north_west == 1) & (south_west == 0) & (north_east == 0)
    otherwise = (south_west == 1) & (north_east == 1) & (south_east == 0) & (north_west == 0)
    twist_m = np.abs(heights_m[:-1, :-1] + heights_m[1:, 1:] - heights_m[:-1, 1:] - heights_m[1:, :-1]) / 2
    return bool((like_mujoco | (otherwise & (twist_m < _DIAGONAL_TOLERANCE_M))).all())
