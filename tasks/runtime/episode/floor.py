"""Free floor of a world's occupancy map: cells that a disc-shaped robot passes over, and shortest paths."""

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.requirement_kinds.kind import Rule
from ....schemas.worlds.world import Point
from .occupancy_map import OccupancyMap, read_world_map

_SNAP_M = 0.5
"""Maximum distance in metres from a free cell at which a path may begin or end, as robots and goals may touch things.
"""
_NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1))
"""Half of the steps to neighbouring cells; knight's moves are included, so that paths are at most 2.8 % too long."""


class MapFloor:
    """Free floor of a world, from its occupancy map.

    Args:
        known: The world's map.
    """

    def __init__(self, known: OccupancyMap) -> None:
        self._map = known
        self._columns = known.free.shape[1]

    @property
    def cell_m2(self) -> float:
        """Area of a cell of the world's map, in m²."""
        return self._map.resolution_m**2

    def cells(self, polygon: Sequence[Point] | None, radius_m: float) -> frozenset[int]:
        """Returns the numbers of the map's cells that a disc can pass over, inside a polygon or anywhere.

        Args:
            polygon: Corners in metres; `None`: the whole map.
            radius_m: Radius of the disc in metres.
        """
        fitting = self._fitting(radius_m)
        if not fitting.any():
            return frozenset()
        away: NDArray[np.float64] = np.asarray(ndimage.distance_transform_edt(~fitting))
        passable = self._map.free & (away * self._map.resolution_m <= radius_m)
        if polygon is not None:
            passable &= self._inside(polygon)
        return frozenset(np.flatnonzero(passable).tolist())

    def passed(self, start: Point, end: Point, radius_m: float) -> frozenset[int]:
        """Returns the numbers of the map's cells that a disc passes over on a straight line, whether free or not.

        Args:
            start: Beginning of the line in metres.
            end: End of the line in metres.
            radius_m: Radius of the disc in metres.
        """
        resolution_m = self._map.resolution_m
        corners = np.array([start, end], dtype=np.float64)
        low, high = corners.min(axis=0) - radius_m, corners.max(axis=0) + radius_m
        (first_row, last_row), (first_column, last_column) = self._map.cells(np.stack((low, high)))
        rows, columns = np.mgrid[first_row : last_row + 1, first_column : last_column + 1]
        points = self._map.centers(rows.ravel(), columns.ravel())
        way = corners[1] - corners[0]
        length2 = float(way @ way)
        along = np.zeros(len(points)) if length2 == 0 else np.clip((points - corners[0]) @ way / length2, 0.0, 1.0)
        away = np.linalg.norm(points - corners[0] - along[:, np.newaxis] * way, axis=1)
        near = away <= radius_m + 1e-9 * resolution_m
        return frozenset((rows.ravel() * self._columns + columns.ravel())[near].tolist())

    def shortest_m(self, start: Point, target: Sequence[Point], radius_m: float) -> float | None:
        """Returns the length in metres of a disc's shortest path to a point, or into a polygon; `None`: no path.

        Steps have 16 directions, and the path is then pulled tight, so that its length is nearly exact.
        """
        fitting = self._fitting(radius_m)
        first = self._snapped(start, fitting)
        if len(target) == 1:
            last = self._snapped(target[0], fitting)
            ends = [] if last is None else [last]
        else:
            inside = self._inside(target)
            row, column = self._cell(start)
            if inside[row, column]:
                return 0.0
            ends = np.flatnonzero(inside & fitting).tolist()
        if first is None or not ends:
            return None
        away, before = csgraph.dijkstra(self._graph(fitting), indices=first, return_predecessors=True)
        end = min(ends, key=lambda cell: float(away[cell]))
        if not math.isfinite(away[end]):
            return None
        way = [end]
        while way[-1] != first:
            way.append(int(before[way[-1]]))
        points = self._map.centers(*np.divmod(np.array(way[::-1]), self._columns))
        points[0] = start
        if len(target) == 1:
            points[-1] = target[0]
        return self._tight(points, fitting)

    def _fitting(self, radius_m: float) -> NDArray[np.bool_]:
        """Returns a mask of the cells whose centre a disc can occupy: all cells within its radius are free."""
        return self._map.free & (self._room_m >= radius_m)

    @cached_property
    def _room_m(self) -> NDArray[np.float64]:
        """Distance from each cell's centre to the nearest edge of a cell that is not free, in metres."""
        known = np.pad(self._map.free, 1)  # beyond the map nothing is free
        away: NDArray[np.float64] = np.asarray(ndimage.distance_transform_edt(known))
        return (away[1:-1, 1:-1] - 0.5) * self._map.resolution_m

    def _inside(self, polygon: Sequence[Point]) -> NDArray[np.bool_]:
        """Returns a mask of the cells whose centre is inside a polygon, by the even-odd rule; corners are in metres."""
        rows, columns = np.indices(self._map.free.shape)
        points = self._map.centers(rows.ravel(), columns.ravel())
        x, y = points.T
        inside = np.zeros(len(points), np.bool_)
        for (x0, y0), (x1, y1) in zip(polygon, [*polygon[1:], polygon[0]], strict=True):
            if y0 != y1:
                inside ^= ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) / (y1 - y0) * (x1 - x0))
        return inside.reshape(self._map.free.shape)

    def _cell(self, point: Point) -> tuple[int, int]:
        (row,), (column,) = self._map.cells(np.array([point], dtype=np.float64))
        return int(row), int(column)

    def _snapped(self, point: Point, fitting: NDArray[np.bool_]) -> int | None:
        """Returns the number of the nearest cell where a disc fits, within `_SNAP_M` metres.

        Returns `None` if there is none.
        """
        rows, columns = np.nonzero(fitting)
        if not len(rows):
            return None
        away = np.linalg.norm(self._map.centers(rows, columns) - np.asarray(point), axis=1)
        nearest = int(away.argmin())
        return int(rows[nearest] * self._columns + columns[nearest]) if away[nearest] <= _SNAP_M else None

    def _graph(self, fitting: NDArray[np.bool_]) -> sparse.csr_matrix:
        """Builds the graph of steps between cells where a disc fits, weighted by length in metres.

        A step past a corner needs all cells that its straight line enters.
        """
        numbers = np.arange(fitting.size).reshape(fitting.shape)
        starts: list[NDArray[np.intp]] = []
        ends: list[NDArray[np.intp]] = []
        lengths: list[NDArray[np.float64]] = []
        padded = np.pad(fitting, 2)
        rows, columns = fitting.shape

        def moved(down: int, right: int) -> NDArray[np.bool_]:
            return padded[2 + down : 2 + down + rows, 2 + right : 2 + right + columns]

        for down, right in _NEIGHBOURS:
            free = fitting & moved(down, right)
            # All cells that the straight line between the two enters.
            for beside in {
                (down // 2, _halved(right)),
                (down - down // 2, right - _halved(right)),
                (down, 0),
                (0, right),
            }:
                if beside not in ((0, 0), (down, right)) and max(abs(beside[0]), abs(beside[1])) < 2:
                    free = free & moved(*beside)
            row, column = np.nonzero(free)
            starts.append(numbers[row, column])
            ends.append(numbers[row + down, column + right])
            lengths.append(np.full(len(row), math.hypot(down, right) * self._map.resolution_m))
        begin, end = np.concatenate(starts), np.concatenate(ends)
        length = np.concatenate(lengths)
        size = fitting.size
        one_way = sparse.csr_matrix((length, (begin, end)), shape=(size, size))
        return (one_way + one_way.T).tocsr()

    def _tight(self, points: NDArray[np.float64], fitting: NDArray[np.bool_]) -> float:
        """Returns the length in metres of a path that is pulled tight between obstacles.

        Args:
            points: The path in metres, shape (n, 2).
            fitting: Cells where the disc fits.
        """
        length_m, here = 0.0, 0
        while here < len(points) - 1:
            there = len(points) - 1
            while there > here + 1 and not self._is_free(points[here], points[there], fitting):
                there -= 1
            length_m += float(np.linalg.norm(points[there] - points[here]))
            here = there
        return length_m

    def _is_free(self, start: NDArray[np.float64], end: NDArray[np.float64], fitting: NDArray[np.bool_]) -> bool:
        count = max(2, math.ceil(float(np.linalg.norm(end - start)) / self._map.resolution_m * 2))
        rows, columns = self._map.cells(start + np.linspace(0.0, 1.0, count)[:, np.newaxis] * (end - start))
        return bool(fitting[rows, columns].all())


def floor_of(plan: RunPlan, rule: Rule[Any]) -> MapFloor | None:
    """Returns the free floor of a run's world; `None`: the run has no world.

    Raises:
        RequirementError: The world's map cannot be read.
    """
    if plan.world_dir is None:
        return None
    try:
        return MapFloor(read_world_map(plan.world_dir))
    except (OSError, ValueError) as error:
        raise rule.cannot(f"the map of the world cannot be read: {error}") from error


def _halved(number: int) -> int:
    return int(number / 2)
