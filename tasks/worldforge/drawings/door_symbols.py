"""Finds doors and windows among the shapes of a floor plan drawing.

It looks for frames in the wall, open leaves, and the arcs of their swings.
"""

from collections.abc import Iterable, Iterator, Sequence
from math import dist
from typing import NamedTuple

import numpy as np
from scipy.sparse.csgraph import connected_components

from ....schemas.worlds.world import Point, bounds
from .drawn_shapes import Line, Shape

_NEAR = 0.15
"""Share of a door leaf's width within which two points of a drawing are the same.

Leaves have a thickness, frames have rebates.
"""
_TOUCH = 0.02
"""Largest gap between parts of one door symbol, as a share of their size: programs round coordinates."""
_FLAT = 0.6
"""Largest thickness of a door frame in a wall, as a share of its width.

The square around a leaf's swing has 1; doors of 0.8 m in walls of 0.4 m have 0.5.
"""
_FRAME = 0.5
"""Smallest width of a door frame, as a share of its symbol's size: posts and leaves' edges have a tenth."""

MOST_PARTS = 2_000
"""Limit of the shapes of one group that are compared with one another: 50 MB of memory.

Offices have some hundred doors.
"""


class Swing(NamedTuple):
    """Arc of a door leaf in a drawing."""

    hinge: Point
    ends: tuple[Point, Point]

    def near(self, one: Point, other: Point) -> bool:
        """Whether two points are the same at the scale of this door leaf."""
        return dist(one, other) <= _NEAR * dist(self.hinge, self.ends[0])

    def joins(self, points: Iterable[Point], end: Point) -> bool:
        """Whether a drawn line connects a door's hinge to a given point."""
        drawn = list(points)
        return all(any(self.near(point, each) for each in drawn) for point in (self.hinge, end))


class Doorway(NamedTuple):
    """Lines along which a door that is drawn with a swing may be closed; the wall decides which of them it is."""

    swing: Swing
    lines: tuple[Line, ...]
    """Lines from the hinge to an end of the arc; the likeliest is first if `told`."""
    told: bool
    """Whether exactly one leaf is drawn, which says which line is likelier: leaves are mostly drawn open."""


class SymbolPart(NamedTuple):
    """One of the shapes that together draw a door, an opening or a window."""

    shape: Shape
    direct: bool
    """Whether the shape is directly in the symbol's own group, and not in a nested group."""
    swings: tuple[Swing, ...] = ()
    lines: tuple[Line, ...] = ()
    """Straight lines of a drawn door symbol's shape; door leaves are among them."""


def doorways(swings: Sequence[Swing], lines: Sequence[Sequence[Point]]) -> Iterator[Doorway]:
    """Yields the doorways of drawn doors; two leaves that meet form one door.

    Args:
        swings: The arcs.
        lines: Corners of all else that is drawn of doors.
    """
    left = [_doorway(swing, lines) for swing in swings]
    while left:
        door = left.pop(0)
        meeting = next((each for each in left if _pair(door, each)), None)
        if meeting is None:
            yield door
        else:
            left.remove(meeting)
            yield Doorway(door.swing, ((door.swing.hinge, meeting.swing.hinge),), True)


def _doorway(swing: Swing, lines: Sequence[Sequence[Point]]) -> Doorway:
    ends = swing.ends
    leaves = [end for end in ends if any(swing.joins(line, end) for line in lines)]
    if leaves == [ends[0]]:
        ends = ends[::-1]
    return Doorway(swing, tuple((swing.hinge, end) for end in ends), len(leaves) == 1)


def _pair(one: Doorway, other: Doorway) -> bool:
    """Whether two leaves meet in one doorway: their closed ends are one point between their hinges."""
    near, hinge = one.swing.near, other.swing.hinge
    closed = one.lines[:1] if one.told else one.lines
    facing = other.lines[:1] if other.told else other.lines
    return any(
        near(end, shut) and near(end, _between(start, hinge)) for start, end in closed for _, shut in facing
    ) and not near(one.swing.hinge, hinge)


def _between(one: Point, other: Point) -> Point:
    return (one[0] + other[0]) / 2, (one[1] + other[1]) / 2


def belongs(line: Sequence[Point], swings: Iterable[Swing]) -> bool:
    """Whether a drawn line touches the hinge or an arc's end of a drawn door, and so is a part of it."""
    return any(swing.near(point, each) for swing in swings for each in (swing.hinge, *swing.ends) for point in line)


def symbols(parts: Sequence[SymbolPart]) -> Iterator[Shape]:
    """Yields one shape for each door, opening or window that a group draws.

    A group may be a symbol of one door or a layer of all: parts that touch draw one.

    Args:
        parts: Shapes of the group, those of groups inside of it included.
    """
    for cluster in _touching(parts):
        if len(cluster) == 1 and not cluster[0].swings:
            yield cluster[0].shape
        else:
            yield from _joined(cluster)


def _joined(cluster: Sequence[SymbolPart]) -> Iterator[Shape]:
    """Yields the doors that touching shapes draw.

    A door comes from a frame in the wall, else from a swing, else from the longest extent of lines.
    """
    named = next((part.shape for part in cluster if part.shape.name), cluster[0].shape)
    own = [part for part in cluster if part.direct] or list(cluster)
    size = max(max(_lengths(part.shape.box)) for part in own)
    solid = [part for part in own if part.shape.closed and not part.shape.curved]
    frames = [boxes for group in _touching(solid) if (boxes := _frames(group, _FRAME * size))]
    if frames:
        for boxes in frames:
            yield _framed(named, boxes)
        return
    swings = [swing for part in cluster for swing in part.swings]
    if swings:
        for door in doorways(swings, [line for part in cluster for line in part.lines]):
            yield named._replace(points=door.lines[0], closed=False, curved=False, ways=door.lines, told=door.told)
        return
    box = _extent(cluster)
    lines = tuple(line for part in own for line in part.lines)
    if _is_flat(box) or not lines:
        yield _boxed(named, box)
    else:  # a leaf that stands open beside its line in the wall
        yield named._replace(points=lines[0], closed=False, curved=False, ways=lines, told=None)


Box = tuple[float, float, float, float]


def _frames(group: Sequence[SymbolPart], least: float) -> list[Box]:
    """Returns the extents of shapes that may be a door's frame, thickest first.

    A leaf that is drawn open at its frame is not part of it.
    """
    boxes = [_extent(group)]
    if not _is_flat(boxes[0]):
        across = [part for part in group if _lengths(part.shape.box)[0] > _lengths(part.shape.box)[1]]
        up = [part for part in group if part not in across]
        boxes = [_extent(side) for parts in (across, up) for side in _touching(parts)]
    wide = [box for box in boxes if _is_flat(box) and max(_lengths(box)) >= least]
    return sorted(wide, key=lambda box: -min(_lengths(box)))


def _framed(shape: Shape, boxes: Sequence[Box]) -> Shape:
    """Returns a door shape with its frame: the thickest of the boxes, as the others are leaves."""
    made = _boxed(shape, boxes[0])
    return made if len(boxes) == 1 else made._replace(ways=tuple(map(_middle_line, boxes)), told=True)


def _middle_line(box: Box) -> Line:
    (west, south, east, north), (x, y) = box, _between(box[:2], box[2:])
    return ((west, y), (east, y)) if east - west > north - south else ((x, south), (x, north))


def _touching(parts: Sequence[SymbolPart]) -> list[list[SymbolPart]]:
    """Groups parts of a drawing whose extents touch, in the order of each group's first part."""
    boxes = np.array([part.shape.box for part in parts])
    if len(parts) < 2:
        return [[*parts]] if parts else []
    sizes = np.max(boxes[:, 2:] - boxes[:, :2], axis=1)
    slack = _TOUCH * np.maximum(sizes[:, None], sizes[None, :])[..., None]
    reach = boxes[:, None, :2] <= boxes[None, :, 2:] + slack
    touch = (reach & reach.transpose(1, 0, 2)).all(axis=2)
    _, labels = connected_components(touch, directed=False)
    groups: dict[int, list[SymbolPart]] = {}
    for part, label in zip(parts, labels.tolist(), strict=True):
        groups.setdefault(label, []).append(part)
    return list(groups.values())


def _lengths(box: Box) -> tuple[float, float]:
    return box[2] - box[0], box[3] - box[1]


def _is_flat(box: Box) -> bool:
    return min(_lengths(box)) <= _FLAT * max(_lengths(box))


def _extent(parts: Sequence[SymbolPart]) -> Box:
    return bounds(point for part in parts for point in part.shape.points)


def _boxed(shape: Shape, box: Box) -> Shape:
    west, south, east, north = box
    corners = ((west, south), (east, south), (east, north), (west, north))
    return shape._replace(points=corners, closed=True, curved=False)
