"""Where a piece of furniture may stand: rectangles, keep-clear zones and the ways that must stay open."""

import itertools
from collections.abc import Iterable
from math import ceil

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ...schemas.world import Floorplan, Point, Room
from .occupancy import wall_corners

Rects = NDArray[np.float64]
"""Shape (n, 4): west, south, east, north, metres."""

TALL_M = 1.1
"""Anything higher would stand before a window's glass."""

_ROBOT_M = 0.28
"""Half the width of the ways kept open: the robot's 0.2 m, a cell of the map, and some ease."""

_CELL_M = 0.05
_ORIGIN_HALF_M = 0.56
_DOOR_DEPTH_M = 0.75
_OPENING_DEPTH_M = 0.45
_WINDOW_DEPTH_M = 0.4
_LARGEST_POCKETS = 0.06
"""Share of a room's ways that furniture may cut off, such as the gap behind a sofa."""

_TOUCHING_M = 1e-6


def rect(x0: float, y0: float, x1: float, y1: float) -> Rects:
    """One rectangle, as an array of one row."""
    return np.array([[x0, y0, x1, y1]])


def overlap(some: Rects, others: Rects) -> NDArray[np.bool_]:
    """Which of `some` overlap any of `others`; touching is not overlapping."""
    a, b = some[:, None], others[None]
    hits = (a[..., 0] < b[..., 2] - _TOUCHING_M) & (b[..., 0] < a[..., 2] - _TOUCHING_M)
    hits &= (a[..., 1] < b[..., 3] - _TOUCHING_M) & (b[..., 1] < a[..., 3] - _TOUCHING_M)
    return np.asarray(hits.any(axis=1))


class RoomSpace:
    """One room while it is being furnished.

    Attributes:
      room: the room.
    """

    def __init__(self, room: Room, floorplan: Floorplan) -> None:
        self.room = room
        xs, ys = zip(*room.polygon, strict=True)
        self.bounds = (min(xs), min(ys), max(xs), max(ys))
        self._outside = _complement(room)
        self._walls = _walls_near(self.bounds, floorplan)
        self._solids = np.concatenate([self._walls, self._outside])
        passages = [passage for passage in floorplan.passages if room.name in passage.rooms]
        self._keep = np.concatenate(
            [
                rect(-_ORIGIN_HALF_M, -_ORIGIN_HALF_M, _ORIGIN_HALF_M, _ORIGIN_HALF_M),
                *(
                    _around(p.start, p.end, _DOOR_DEPTH_M if p.kind == "Doorway" else _OPENING_DEPTH_M)
                    for p in passages
                ),
            ]
        )
        windows = [window for window in floorplan.windows if window.room == room.name]
        self._glass = np.concatenate(
            [np.empty((0, 4)), *(_around(window.start, window.end, _WINDOW_DEPTH_M) for window in windows)]
        )
        self._zones: dict[str, Rects] = {}
        self._ways = _Ways(self, [self._gate(p.start, p.end) for p in passages])

    def fits(
        self, footprints: Rects, zones: Rects, *, tall: bool = False, partner: str = "", tucked: Rects | None = None
    ) -> NDArray[np.bool_]:
        """Which footprints may stand in the room, ways aside.

        Args:
          footprints: where a piece would stand.
          zones: for each, what has to stay free in front of it.
          tall: whether the piece would hide a window.
          partner: id of the piece it belongs to, whose zone it may enter.
          tucked: footprint of the piece it may be pushed under.
        """
        x0, y0, x1, y1 = self.bounds
        inside = (
            (footprints[:, 0] >= x0) & (footprints[:, 1] >= y0) & (footprints[:, 2] <= x1) & (footprints[:, 3] <= y1)
        )
        solids = self._solids
        if tucked is not None:
            solids = solids[(np.abs(solids - tucked) > _TOUCHING_M).any(axis=1)]
        closed = [solids, self._keep, *(zone for owner, zone in self._zones.items() if owner != partner)]
        if tall:
            closed.append(self._glass)
        return inside & ~overlap(footprints, np.concatenate(closed)) & ~overlap(zones, solids)

    def stays_open(self, footprint: Rects) -> bool:
        """Whether a robot still gets from every way into the room to every other with this piece in place."""
        return self._ways.with_block(footprint) is not None

    def add(self, owner: str, footprint: Rects, zone: Rects) -> None:
        """Puts a piece where `fits` and `stays_open` have been asked."""
        self._solids = np.concatenate([self._solids, footprint])
        self._zones[owner] = zone
        self._ways.block(footprint)

    def goal(self) -> Point:
        """The spot nearest to the room's middle that a robot can reach."""
        return self._ways.nearest(self.room.goal)

    def open_cells(self) -> Rects:
        """Middles of all cells a robot can reach, shape (n, 2)."""
        return self._ways.centers()

    def _gate(self, start: Point, end: Point) -> Point:
        """A point inside the room, before the middle of a way in."""
        x, y = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
        step = _OPENING_DEPTH_M
        along_x = abs(end[0] - start[0]) > abs(end[1] - start[1])
        sides = [(x, y + step), (x, y - step)] if along_x else [(x + step, y), (x - step, y)]
        return next((side for side in sides if contains(self.room, side)), sides[0])


class _Ways:
    """The cells of a room that the middle of a robot may be in."""

    def __init__(self, space: RoomSpace, gates: list[Point]) -> None:
        x0, y0, x1, y1 = space.bounds
        self._x0, self._y0 = x0, y0
        self._free = np.ones((ceil((y1 - y0) / _CELL_M), ceil((x1 - x0) / _CELL_M)), np.bool_)
        for outside in space._outside:
            self._free[self._slices(outside, 0)] = False
        for wall in space._walls:
            self._free[self._slices(wall, _ROBOT_M)] = False
        points = [*gates, *([(0.0, 0.0)] if contains(space.room, (0.0, 0.0)) else [])]
        self._gates = [self._cell(point) for point in points]
        self._open = self._component(self._free)
        cut_off = 0 if self._open is None else np.count_nonzero(self._free & ~self._open)
        self._most_lost = cut_off + _LARGEST_POCKETS * np.count_nonzero(self._free)

    def with_block(self, footprint: Rects) -> NDArray[np.bool_] | None:
        """The cells reachable with one more block, or None when it would cut the ways."""
        if self._open is None:
            return None
        free = self._free.copy()
        free[self._slices(footprint[0], _ROBOT_M)] = False
        component = self._component(free)
        if component is None:
            return None
        return component if np.count_nonzero(free & ~component) <= self._most_lost else None

    def block(self, footprint: Rects) -> None:
        self._open = self.with_block(footprint)
        self._free[self._slices(footprint[0], _ROBOT_M)] = False

    def nearest(self, point: Point) -> Point:
        centers = self.centers()
        if not len(centers):
            return point
        x, y = centers[np.argmin(((centers - np.array(point)) ** 2).sum(axis=1))]
        return round(float(x), 3), round(float(y), 3)

    def centers(self) -> Rects:
        rows, columns = np.nonzero(self._open if self._open is not None else np.zeros_like(self._free))
        return np.stack([self._x0 + (columns + 0.5) * _CELL_M, self._y0 + (rows + 0.5) * _CELL_M], axis=1)

    def _component(self, free: NDArray[np.bool_]) -> NDArray[np.bool_] | None:
        labels = np.asarray(ndimage.label(free)[0])  # pyright: ignore[reportIndexIssue]
        found = {int(labels[gate]) for gate in self._gates}
        if len(found) != 1 or 0 in found:
            return None
        return labels == found.pop()

    def _cell(self, point: Point) -> tuple[int, int]:
        rows, columns = self._free.shape
        row, column = int((point[1] - self._y0) / _CELL_M), int((point[0] - self._x0) / _CELL_M)
        return min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)

    def _slices(self, block: NDArray[np.float64], margin: float) -> tuple[slice, slice]:
        """Cells whose middle lies within `margin` of a block, as a square would measure it."""
        x0, y0, x1, y1 = ((block + margin * np.array([-1, -1, 1, 1])) - [self._x0, self._y0] * 2) / _CELL_M - 0.5
        return slice(max(0, ceil(y0)), max(0, ceil(y1))), slice(max(0, ceil(x0)), max(0, ceil(x1)))


def _complement(room: Room) -> Rects:
    """What lies inside a room's bounding box but not in the room."""
    xs, ys = (sorted({corner[axis] for corner in room.polygon}) for axis in (0, 1))
    sides = list(zip(room.polygon, [*room.polygon[1:], room.polygon[0]], strict=True))
    outside = [
        rect(x0, y0, x1, y1)
        for x0, x1 in itertools.pairwise(xs)
        for y0, y1 in itertools.pairwise(ys)
        if not _inside(((x0 + x1) / 2, (y0 + y1) / 2), sides)
    ]
    return np.concatenate([np.empty((0, 4)), *outside])


def room_rects(room: Room) -> Rects:
    """A room's floor as rectangles that do not overlap: rows of the grid its corners span."""
    xs, ys = (sorted({corner[axis] for corner in room.polygon}) for axis in (0, 1))
    sides = list(zip(room.polygon, [*room.polygon[1:], room.polygon[0]], strict=True))
    rows: list[Rects] = []
    for y0, y1 in itertools.pairwise(ys):
        start: float | None = None
        for x0, x1 in itertools.pairwise(xs):
            inside = _inside(((x0 + x1) / 2, (y0 + y1) / 2), sides)
            if inside and start is None:
                start = x0
            if start is not None and (not inside or x1 == xs[-1]):
                rows.append(rect(start, y0, x1 if inside else x0, y1))
                start = None
    return np.concatenate(rows)


def contains(room: Room, point: Point) -> bool:
    """Whether a point lies inside a room's polygon."""
    return _inside(point, zip(room.polygon, [*room.polygon[1:], room.polygon[0]], strict=True))


def _inside(point: Point, sides: Iterable[tuple[Point, Point]]) -> bool:
    """Crossing test; only upright sides cross an eastward ray."""
    x, y = point
    crossings = sum(a[0] == b[0] and x < a[0] and min(a[1], b[1]) <= y < max(a[1], b[1]) for a, b in sides)
    return crossings % 2 == 1


def _walls_near(bounds: tuple[float, float, float, float], floorplan: Floorplan) -> Rects:
    rects = np.empty((0, 4))
    for wall in floorplan.walls:
        if not wall.lintel:
            xs, ys = zip(*wall_corners(wall), strict=True)
            rects = np.concatenate([rects, rect(min(xs), min(ys), max(xs), max(ys))])
    return rects[overlap(rects, rect(bounds[0] - 0.3, bounds[1] - 0.3, bounds[2] + 0.3, bounds[3] + 0.3))]


def _around(start: Point, end: Point, depth: float) -> Rects:
    """The strip on both sides of a line along an axis."""
    x0, x1 = sorted((start[0], end[0]))
    y0, y1 = sorted((start[1], end[1]))
    if x1 - x0 > y1 - y0:
        return rect(x0, y0 - depth, x1, y1 + depth)
    return rect(x0 - depth, y0, x1 + depth, y1)
