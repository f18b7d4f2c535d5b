"""Path planner on an occupancy map: searches a grid, then smooths the path."""

from collections.abc import Callable, Iterable
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from ...episode.occupancy_map import OccupancyMap

STEP_M = 0.05
"""Distance between the points of a smoothed path, in metres."""

_SHORTCUT_CLEARANCE_M = 0.30
_WINDOW = 9
"""Number of points in the moving average that rounds corners."""

_ROUNDS = 2
_LONGEST_SHORTCUT = 64
"""Maximum number of grid steps that one straight line may replace."""

Clearance = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def smooth(points: NDArray[np.float64], clearance: Clearance, radius_m: float) -> NDArray[np.float64]:
    """Straightens and rounds a path, keeping clearance from obstacles.

    Args:
        points: Points of the path, shape (n, 2), metres; both ends stay.
        clearance: Function that returns the distance to the nearest obstacle for points of shape (n, 2).
        radius_m: Minimum clearance of the rounded path.

    Returns:
        Points about `STEP_M` apart, shape (m, 2), m at least 2.
    """
    path = resample(_straighten(points, clearance))
    rounded = path
    for _ in range(_ROUNDS):
        rounded = _average(rounded)
    # The first points may lie too close already: the robot stands where it stands.
    worse = clearance(rounded) < np.minimum(clearance(path), radius_m)
    return path if worse.any() else resample(rounded)


def resample(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns points evenly spaced along a polyline in metres, shape (n, 2), both ends included.

    They are about `STEP_M` apart; there are two at least.
    """
    lengths = np.hypot(*np.diff(points, axis=0).T) if len(points) > 1 else np.zeros(0)
    along = np.concatenate(([0.0], np.cumsum(lengths)))
    count = max(2, round(float(along[-1]) / STEP_M) + 1)
    where = np.linspace(0.0, along[-1], count)
    return np.stack((np.interp(where, along, points[:, 0]), np.interp(where, along, points[:, 1])), axis=1)


def _straighten(points: NDArray[np.float64], clearance: Clearance) -> NDArray[np.float64]:
    """Returns a path of fewer points, with straight lines where these do not come closer to obstacles than the path.

    Args:
        points: The path in metres, shape (n, 2).
        clearance: Measures the distance to obstacles in metres at points.
    """
    room = clearance(points)
    kept, here, last = [0], 0, len(points) - 1
    while here < last:
        span = min(_LONGEST_SHORTCUT, last - here)
        while span > 1 and not _is_no_tighter(points, room, here, here + span, clearance):
            span = max(1, span * 2 // 3)
        here += span
        kept.append(here)
    return points[kept]


def _is_no_tighter(
    points: NDArray[np.float64], room: NDArray[np.float64], first: int, last: int, clearance: Clearance
) -> bool:
    needed = min(_SHORTCUT_CLEARANCE_M, float(room[first : last + 1].min()))
    count = 2 * (last - first)
    line = points[first] + np.linspace(0.0, 1.0, count)[:, np.newaxis] * (points[last] - points[first])
    return bool(clearance(line).min() >= needed)


def _average(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns points smoothed by a moving average, which is narrower near both ends; the number of points stays."""
    count = len(points)
    index = np.arange(count)
    half = np.minimum(_WINDOW // 2, np.minimum(index, count - 1 - index))
    sums = np.concatenate((np.zeros((1, 2)), np.cumsum(points, axis=0)))
    return (sums[index + half + 1] - sums[index - half]) / (2 * half + 1)[:, np.newaxis]


COMFORT_M = 0.38
"""Clearance in metres beyond which more clearance is worth no detour."""

_LEAST_COMFORT_M = 0.1
"""Minimum comfortable clearance in addition to the required clearance, in metres, for robots of any size."""

_NARROWNESS_COST = 5.0
"""Cost factor added for a path that the robot only just fits through, relative to a comfortable one."""

_PUSHING_COST = 40.0
"""Cost factor added for a path through an obstacle that is not on the map, relative to a free one."""

_SNAP_M = 0.5
"""Maximum distance in metres by which a start or goal is moved to a cell where the robot fits."""

Path = NDArray[np.float64]
"""Points of a path, shape (n, 2), in metres."""

WayKind = Literal["free", "tight", "pushing"]
"""Kind of path: `free` has a margin, `tight` just fits, `pushing` goes through obstacles that are not on the map."""

_MARGIN_M: dict[WayKind, float] = {"free": 0.03, "tight": 0.005, "pushing": 0.005}


class Way(NamedTuple):
    """A planned path on the map: its points, and how freely the robot can pass."""

    path: Path
    kind: WayKind


class GridPlanner:
    """Path planner on a grid map with eight neighbours per cell, which prefers clearance.

    Obstacles that are not on the map can be added and removed.
    """

    def __init__(self, known: OccupancyMap, radius_m: float) -> None:
        """Computes the clearance of the map's cells, without obstacles that are not on the map.

        Args:
            known: Occupancy map.
            radius_m: Radius of the robot, as a disc.
        """
        self._map = known
        self._radius_m = radius_m
        self._known_clearance = _clearance(known.free, known.resolution_m)
        self._clearance = self._known_clearance
        self._obstacles = np.zeros((0, 2))
        self._grids: dict[WayKind, _Grid] = {}

    def set_obstacles(self, points: NDArray[np.float64]) -> None:
        """Replaces the temporary obstacles (not on the map) by points in metres, shape (n, 2); none if it is empty."""
        if len(points) == 0 and len(self._obstacles) == 0:
            return
        self._obstacles = points
        free = np.ones_like(self._map.free)
        free[self._map.cells(points)] = False
        around = _clearance(free, self._map.resolution_m) if len(points) else np.inf
        self._clearance = np.minimum(self._known_clearance, around)
        self._grids.clear()

    def known_distance(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the distance in metres from points to the nearest obstacle on the map."""
        return self._known_clearance[self._map.cells(points)]

    def plan(self, start: tuple[float, float], goal: tuple[float, float]) -> Way | None:
        """Plans a path: with a margin if possible, else just fitting, else through obstacles that are not on the map.

        Args:
            start: Position of the robot's centre, where the path begins. If the robot does not fit there, the path
                continues from the nearest cell where it does, at most 0.5 m away.
            goal: Position to reach; the path ends at the nearest cell where the robot fits, at most 0.5 m away.

        Returns:
            The path and its kind; `None` if there is no path even without the obstacles that are not on the map.
        """
        for kind in _MARGIN_M:
            path = self._path(kind, start, goal)
            if path is not None:
                return Way(path, kind)
        return None

    def prepare(self, goals: Iterable[tuple[float, float]]) -> None:
        """Computes, to be kept, the costs of free paths from everywhere to some goals (x, y in metres)."""
        grid = self._grid("free")
        for goal in goals:
            node = grid.node(goal)
            if node is not None:
                grid.tree(node)

    def distances(self, places: list[tuple[float, float]]) -> NDArray[np.float64]:
        """Returns the path costs between places (x, y in metres), shape (n, n), infinite where there is no path."""
        grid = self._grid("free")
        nodes = [grid.node(place) for place in places]
        costs = np.full((len(places), len(places)), np.inf)
        # Ways are as long as the ways back, so the first place needs no tree; the others' serve the tour later.
        for row, end in enumerate(nodes[1:], start=1):
            if end is not None:
                tree = grid.tree(end)[0]
                costs[row] = [np.inf if node is None else tree[node] for node in nodes]
        costs[0] = costs[:, 0]
        if nodes[0] is not None:
            costs[0, 0] = 0.0
        return costs

    def clearance_at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Returns the distance in metres from points to the nearest obstacle, temporary ones included."""
        return self._clearance[self._map.cells(points)]

    def _path(self, kind: WayKind, start: tuple[float, float], goal: tuple[float, float]) -> Path | None:
        if kind == "pushing" and len(self._obstacles) == 0:
            return None
        grid = self._grid(kind)
        first, last = grid.node(start), grid.node(goal)
        if first is None or last is None:
            return None
        costs, towards = grid.tree(last)
        if not np.isfinite(costs[first]):
            return None
        nodes = [first]
        while nodes[-1] != last:
            nodes.append(int(towards[nodes[-1]]))
        points = grid.centers[nodes]
        points[0] = start
        clearance = self.known_distance if kind == "pushing" else self.clearance_at
        return smooth(points, clearance, self._radius_m + _MARGIN_M[kind])

    def _grid(self, kind: WayKind) -> "_Grid":
        if kind not in self._grids:
            needed_m = self._radius_m + _MARGIN_M[kind]
            clearance = self._known_clearance if kind == "pushing" else self._clearance
            comfort_m = max(COMFORT_M, needed_m + _LEAST_COMFORT_M)
            lacking = np.clip((comfort_m - clearance) / (comfort_m - needed_m), 0.0, 1.0)
            costs = 1.0 + _NARROWNESS_COST * lacking**2
            if kind == "pushing":
                costs = costs + _PUSHING_COST * (self._clearance < self._radius_m)
            self._grids[kind] = _Grid(self._map, clearance >= needed_m, costs)
        return self._grids[kind]


class _Grid:
    """Graph of the map's cells in which the robot's disc fits, with shortest paths to goals, which are kept."""

    def __init__(self, known: OccupancyMap, fits: NDArray[np.bool_], costs: NDArray[np.float64]) -> None:
        rows, columns = np.nonzero(fits)
        self.centers = known.centers(rows, columns)
        self._known = known
        self._numbers = np.full(fits.shape, -1, np.int32)
        self._numbers[rows, columns] = np.arange(len(rows), dtype=np.int32)
        self._graph = _grid_graph(self._numbers, costs, known.resolution_m)
        self._trees: dict[int, tuple[NDArray[np.float64], NDArray[np.int32]]] = {}

    def node(self, place: tuple[float, float]) -> int | None:
        """Returns the number of the graph node nearest to a position in metres; `None` if none is near."""
        if len(self.centers) == 0:
            return None
        around = int(self._numbers[self._known.cells(np.array([place]))][0])
        if around >= 0 and np.abs(self.centers[around] - place).max() <= self._known.resolution_m / 2:
            return around
        squares = ((self.centers - place) ** 2).sum(axis=1)
        nearest = int(np.argmin(squares))
        return nearest if squares[nearest] <= _SNAP_M**2 else None

    def tree(self, end: int) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """Returns the cost from every node to an end node, and each node's successor on the shortest path.

        Where there is no path, the cost is infinite and the successor negative.
        """
        if end not in self._trees:
            self._trees[end] = csgraph.dijkstra(self._graph, indices=end, return_predecessors=True)
        return self._trees[end]


def _clearance(free: NDArray[np.bool_], resolution_m: float) -> NDArray[np.float64]:
    """Returns the distance from each cell's centre to the nearest edge of a cell that is not free, in metres."""
    distance = np.asarray(ndimage.distance_transform_edt(free, sampling=resolution_m))
    return np.maximum(distance - resolution_m / 2, 0.0)


def _grid_graph(numbers: NDArray[np.int32], costs: NDArray[np.float64], resolution_m: float) -> sparse.csr_array:
    """Builds the sparse graph of neighbouring cells, weighted by length and the cells' mean cost.

    Args:
        numbers: Node numbers of the cells, shape (rows, columns); cells with a negative number are not nodes.
        costs: Cost of the cells per metre, of the same shape.
        resolution_m: Length of a cell's side in metres.
    """
    fits = numbers >= 0
    count = int(fits.sum())
    heads, tails, weights = [], [], []
    rows, columns = fits.shape
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = (slice(0, rows - down), slice(max(0, -right), columns - max(0, right)))
        there = (slice(down, rows), slice(max(0, right), columns - max(0, -right)))
        both = fits[here] & fits[there]
        length_m = resolution_m * float(np.hypot(down, right))
        heads.append(numbers[here][both])
        tails.append(numbers[there][both])
        weights.append(length_m * (costs[here][both] + costs[there][both]) / 2)
    head, tail, weight = np.concatenate(heads), np.concatenate(tails), np.concatenate(weights)
    ends = (np.concatenate((head, tail)), np.concatenate((tail, head)))
    return sparse.csr_array((np.concatenate((weight, weight)), ends), shape=(count, count))
