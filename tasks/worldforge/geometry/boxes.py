"""Axis-aligned rectangles, and poses of furniture that is parallel to the walls.

These are plain tuples: rooms hold dozens of rectangles, not thousands, and arrays would cost more than they save.
`room_rects` alone gives an array, since pictures compare thousands of points with it.
"""

import itertools
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....schemas.worlds.world import Furniture, Point, Room, bounds, contains

Box = tuple[float, float, float, float]
"""Rectangle: west, south, east, north, in metres."""

Rects = NDArray[np.float64]
"""Rectangles, shape (n, 4): west, south, east, north, in metres."""

FRONTS: tuple[tuple[int, int], ...] = ((1, 0), (0, 1), (-1, 0), (0, -1))
"""Unit vectors of the facing directions, by quarter turns from +x."""

_TOUCHING_M = 1e-6
_HALF_PI = 1.5707963267948966


class Pose(NamedTuple):
    """Candidate pose of a piece of furniture: centre in metres, direction, and a score."""

    x: float
    y: float
    quarter: int
    """Facing direction of a furniture pose in quarter turns from +x, 0 to 3."""
    score: float = 0.0
    """Rating of a furniture pose; higher is better."""

    def box(self, back: float, front: float, right: float, left: float) -> Box:
        """Returns the rectangle between two distances forward and two sideways from a furniture pose."""
        x, y, quarter, _ = self
        if quarter == 0:
            return x + back, y + right, x + front, y + left
        if quarter == 1:
            return x - left, y + back, x - right, y + front
        if quarter == 2:
            return x - front, y - left, x - back, y - right
        return x + right, y - front, x + left, y - back

    def moved(self, forward: float, left: float, turn: int = 0, score: float = 0.0) -> "Pose":
        """Returns a pose given relative to this one."""
        front, side = FRONTS[self.quarter], FRONTS[(self.quarter + 1) % 4]
        x = self.x + forward * front[0] + left * side[0]
        y = self.y + forward * front[1] + left * side[1]
        return Pose(x, y, (self.quarter + turn) % 4, score)


def pose_of(item: Furniture) -> Pose:
    """Returns the pose of an axis-aligned piece of furniture."""
    return Pose(item.x, item.y, round(item.yaw / _HALF_PI) % 4)


def box_of(item: Furniture) -> Box:
    """Returns the rectangle that an axis-aligned piece of furniture covers."""
    return footprint(pose_of(item), item.width_m, item.depth_m)


def footprint(pose: Pose, width_m: float, depth_m: float) -> Box:
    """Returns the rectangle that a piece of furniture would cover at a pose, rounded to millimetres."""
    pose = Pose(round(pose.x, 3), round(pose.y, 3), pose.quarter)
    return pose.box(-depth_m / 2, depth_m / 2, -width_m / 2, width_m / 2)


def strip(start: Point, end: Point, depth_m: float) -> Box:
    """Returns the rectangle on both sides of an axis-aligned line."""
    x0, y0, x1, y1 = bounds((start, end))
    if x1 - x0 > y1 - y0:
        return x0, y0 - depth_m, x1, y1 + depth_m
    return x0 - depth_m, y0, x1 + depth_m, y1


def hits(box: Box, others: Iterable[Box]) -> bool:
    """Whether a rectangle overlaps any of the others; touching is not overlapping."""
    x0, y0, x1, y1 = box
    x0, y0, x1, y1 = x0 + _TOUCHING_M, y0 + _TOUCHING_M, x1 - _TOUCHING_M, y1 - _TOUCHING_M
    if x0 >= x1 or y0 >= y1:
        return False
    # A plain loop: this is where the time goes, and any() over a generator takes twice as long.
    for west, south, east, north in others:  # noqa: SIM110
        if west < x1 and x0 < east and south < y1 and y0 < north:
            return True
    return False


def left_over(low: float, high: float, taken: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Returns the parts of an interval that remain after removing other intervals, in order; empty if none remains."""
    spans: list[tuple[float, float]] = []
    at = low
    for start, end in sorted(taken):
        if start > at:
            spans.append((at, min(start, high)))
        at = max(at, end)
        if at >= high:
            return spans
    spans.append((at, high))
    return spans


def room_rects(room: Room) -> Rects:
    """Divides a room's floor into rectangles that do not overlap.

    Each row of the result is one rectangle: west, south, east and north in metres.
    """
    xs, ys = (sorted({corner[axis] for corner in room.polygon}) for axis in (0, 1))
    rows: list[Box] = []
    for y0, y1 in itertools.pairwise(ys):
        start: float | None = None
        for x0, x1 in itertools.pairwise(xs):
            inside = contains(room.polygon, (x0 + x1) / 2, (y0 + y1) / 2)
            if inside and start is None:
                start = x0
            if start is not None and (not inside or x1 == xs[-1]):
                rows.append((start, y0, x1 if inside else x0, y1))
                start = None
    return np.array(rows)
