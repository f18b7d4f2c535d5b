"""Plans ways for a disc over an occupancy map, away from walls where there is room."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from .occupancy_map import OccupancyMap
from .path_smoothing import smooth

COMFORT_M = 0.38
"""Clearance from which more clearance is worth no detour."""

_NARROWNESS_COST = 5.0
"""How many times more a way costs that just fits, added to one that is comfortable."""

_SNAP_M = 0.5
"""How far a start or a goal may lie from a cell where the disc fits."""

Path = NDArray[np.float64]
"""Points of shape (n, 2), metres."""


class GridPlanner:
    """Shortest comfortable ways on a map's cells, eight neighbours each.

    Obstacles that the map does not know can be added and taken back.
    """

    def __init__(self, known: OccupancyMap, radius_m: float, margin_m: float = 0.01) -> None:
        """Prepares the map as it is.

        Args:
          known: the map.
          radius_m: the disc's radius.
          margin_m: what has to be free around it besides.
        """
        self._map = known
        self._radius_m = radius_m + margin_m
        distance = np.asarray(ndimage.distance_transform_edt(known.free, sampling=known.resolution_m))
        # From the middle of a cell to the face of the nearest one that is not free.
        self.known_clearance = np.maximum(distance - known.resolution_m / 2, 0.0)
        self._obstacles = np.zeros((0, 2))
        self._rebuild()

    def set_obstacles(self, points: NDArray[np.float64]) -> None:
        """Replaces the obstacles besides the map by points of shape (n, 2)."""
        if len(points) == 0 and len(self._obstacles) == 0:
            return
        self._obstacles = points
        self._rebuild()

    def known_distance(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance of points from what the map shows, metres, to half a cell."""
        return self.known_clearance[self._map.cells(points)]

    def plan(self, start: tuple[float, float], goal: tuple[float, float]) -> Path | None:
        """Finds a way.

        Args:
          start: where the disc's middle is; when the disc does not fit there, the way begins at the
            nearest place where it does.
          goal: where it should be, likewise.

        Returns:
          The way, or nothing when there is none.
        """
        first, last = self._node(start), self._node(goal)
        if first is None or last is None:
            return None
        costs, towards = self._tree(last)
        if not np.isfinite(costs[first]):
            return None
        nodes = [first]
        while nodes[-1] != last:
            nodes.append(int(towards[nodes[-1]]))
        points = self._map.centers(self._rows[nodes], self._columns[nodes])
        points[0] = start
        return smooth(points, self.clearance_at, self._radius_m)

    def distances(self, places: list[tuple[float, float]]) -> NDArray[np.float64]:
        """Costs of the ways between places, shape (n, n), infinite where there is none."""
        nodes = [self._node(place) for place in places]
        costs = np.full((len(places), len(places)), np.inf)
        for row, end in enumerate(nodes):
            if end is not None:
                tree = self._tree(end)[0]
                costs[row] = [np.inf if node is None else tree[node] for node in nodes]
        return costs

    def clearance_at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Clearance around points of shape (n, 2), obstacles included; metres."""
        return self._clearance[self._map.cells(points)]

    def _rebuild(self) -> None:
        self._clearance = self._with_obstacles()
        fits = self._clearance >= self._radius_m
        self._rows, self._columns = np.nonzero(fits)
        self._graph = _grid_graph(fits, self._cell_costs(), self._map.resolution_m)
        self._trees: dict[int, tuple[NDArray[np.float64], NDArray[np.int32]]] = {}

    def _tree(self, end: int) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """Costs to a node from every other one, and the next node on the way there; kept until the map changes."""
        if end not in self._trees:
            self._trees[end] = csgraph.dijkstra(self._graph, indices=end, return_predecessors=True)
        return self._trees[end]

    def _with_obstacles(self) -> NDArray[np.float64]:
        if len(self._obstacles) == 0:
            return self.known_clearance
        free = np.ones_like(self._map.free)
        free[self._map.cells(self._obstacles)] = False
        distance = np.asarray(ndimage.distance_transform_edt(free, sampling=self._map.resolution_m))
        return np.minimum(self.known_clearance, np.maximum(distance - self._map.resolution_m / 2, 0.0))

    def _cell_costs(self) -> NDArray[np.float64]:
        lacking = np.clip((COMFORT_M - self._clearance) / (COMFORT_M - self._radius_m), 0.0, 1.0)
        return 1.0 + _NARROWNESS_COST * lacking**2

    def _node(self, place: tuple[float, float]) -> int | None:
        """The node nearest to a place, if one is near."""
        if len(self._rows) == 0:
            return None
        centers = self._map.centers(self._rows, self._columns)
        squares = ((centers - place) ** 2).sum(axis=1)
        nearest = int(np.argmin(squares))
        return nearest if squares[nearest] <= _SNAP_M**2 else None


def _grid_graph(fits: NDArray[np.bool_], costs: NDArray[np.float64], resolution_m: float) -> sparse.csr_array:
    """Joins neighbouring cells; nodes are the cells that fit, row by row."""
    numbers = np.full(fits.shape, -1, np.int32)
    count = int(fits.sum())
    numbers[fits] = np.arange(count, dtype=np.int32)
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
