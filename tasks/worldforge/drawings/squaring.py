"""Aligns the drawn outlines of rooms: moves their edges onto the wall centre lines of the floor plan grid.

Drawings have rooms as areas with gaps for walls between them, or as areas that touch. Edges that face each other across
a wall become one line in the middle between them.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ....schemas.wire.errors import ConfigurationError
from ....schemas.worlds.world import Point
from ..floorplans.brief import EXTERIOR_WALL
from ..floorplans.partition import UNITS_PER_M, Corners, area, extent, turns
from ..floorplans.walls import room_units

THICKEST_M = 0.5
"""Largest gap between two rooms that is a wall, in metres."""

_SQUARE_M = 0.05
"""Largest deviation of a room's edge from an axis, in metres between its ends."""
_SAME_M = 0.04
"""Distance up to which parallel edges of rooms are moved onto one line, in metres."""
_BESIDE_M = 0.05
_OVERLAP_M = 0.06

Outlines = list[tuple[Point, ...]]


class Edge(NamedTuple):
    """A horizontal or vertical edge of a room's outline."""

    room: int
    number: int
    """Number of the edge in its room: the edge ends at the corner of this number."""
    at: float
    low: float
    high: float
    side: int
    """Side of a room's edge on which the room is: 1 for larger coordinates, else -1."""


class Squared(NamedTuple):
    """Rooms of a drawing moved to a common grid, so that their outlines meet."""

    rooms: list[Corners]
    """Corners, counter-clockwise, in units; the south-west corner of all of them together is at 0, 0."""
    moved: tuple["Lines", "Lines"]
    """Coordinates of the drawing and the grid units they were moved to, along x and along y."""
    on_faces: bool
    """Whether outlines of rooms were drawn along the faces of walls."""


class Lines(NamedTuple):
    """Drawn coordinates along one axis in metres, and the grid units they became, in order."""

    drawn: list[float]
    made: list[int]

    def place(self, at: float) -> float:
        """Converts a coordinate in metres to grid units, keeping its distance from the nearest line."""
        nearest = min(range(len(self.drawn)), key=lambda index: abs(self.drawn[index] - at))
        return self.made[nearest] + (at - self.drawn[nearest]) * UNITS_PER_M

    @property
    def start_m(self) -> float:
        """Coordinate in the drawing, in metres, of grid unit 0."""
        first, last = (self.drawn[end] - self.made[end] / UNITS_PER_M for end in (0, -1))
        return (first + last) / 2


def upright(points: Sequence[Point], what: str, drawn: Sequence[Point]) -> tuple[Point, ...]:
    """Returns the corners of an axis-parallel outline, counter-clockwise.

    Args:
        points: The outline, in metres.
        what: Name of the outline in error messages.
        drawn: The same points in the numbers of the drawing, for error messages.

    Raises:
        ConfigurationError: An edge runs at an angle.
    """
    lines: list[tuple[bool, float]] = []
    for number, ((x0, y0), (x1, y1)) in enumerate(zip(points, [*points[1:], points[0]], strict=True)):
        across, up = abs(x1 - x0), abs(y1 - y0)
        if max(across, up) <= _SQUARE_M / 5:
            continue
        if min(across, up) > _SQUARE_M:
            raise ConfigurationError(
                f"{what}: its edge from {_told(drawn[number])} to {_told(drawn[(number + 1) % len(drawn)])}, in metres "
                f"with y up from {_told((x0, y0))} to {_told((x1, y1))}, runs at an angle; rooms with "
                "level and upright edges are taken, such as the rectangle or the L around this one"
            )
        level = across >= up
        at = (y0 + y1) / 2 if level else (x0 + x1) / 2
        if not lines or lines[-1][0] != level:
            lines.append((level, at))
    if len(lines) > 1 and lines[0][0] == lines[-1][0]:
        lines.pop()
    if len(lines) < 4:
        raise ConfigurationError(f"{what}: its outline has no area")
    corners = [
        (one[1], other[1]) if other[0] else (other[1], one[1])
        for one, other in zip([lines[-1], *lines[:-1]], lines, strict=True)
    ]
    return tuple(corners) if area(corners) > 0 else tuple(reversed(corners))


def _told(point: Point) -> str:
    x, y = (at + 0.0 for at in point)  # -0.0 becomes 0.0
    return f"({x:.6g}, {y:.6g})"


def square(outlines: Outlines, on_faces: bool | None) -> Squared:
    """Moves room edges onto common grid lines, so that neighbouring rooms share walls.

    Args:
        outlines: Corners of the rooms, of `upright`, in metres.
        on_faces: Whether they were drawn along the faces of walls; None: they were if there are gaps between them.
    """
    edges = [list(_edges(outlines, axis)) for axis in (0, 1)]
    gaps = [max(0.0, gap) for axis in (0, 1) for _, _, gap in _facing(edges[axis])]
    faces = on_faces if on_faces is not None else any(gap > _SAME_M / 2 for gap in gaps)
    across, up = (_targets(edges[axis], faces) for axis in (0, 1))
    rooms = []
    for room, corners in enumerate(outlines):
        leading = [(room, number) for number in range(len(corners))]
        # One edge at each corner is upright, the other level.
        ends = zip(leading, [*leading[1:], leading[0]], strict=True)
        rooms.append(
            tuple((across.get(one, across.get(other, 0)), up.get(one, up.get(other, 0))) for one, other in ends)
        )
    moved = (_went(edges[0], across), _went(edges[1], up))
    return Squared([turns(corners) for corners in rooms], moved, faces)


def _edges(outlines: Outlines, axis: int) -> list[Edge]:
    """Returns the edges of room outlines that are perpendicular to an axis."""
    found: list[Edge] = []
    for room, corners in enumerate(outlines):
        for number, (one, other) in enumerate(zip([corners[-1], *corners[:-1]], corners, strict=True)):
            if one[axis] == other[axis]:
                low, high = sorted((one[1 - axis], other[1 - axis]))
                # Counter-clockwise: the room lies to the left of every edge.
                ahead = other[1 - axis] > one[1 - axis]
                found.append(Edge(room, number, one[axis], low, high, -1 if ahead == (axis == 0) else 1))
    return found


def _facing(edges: Sequence[Edge]) -> list[tuple[int, int, float]]:
    """Returns pairs of edges of two rooms with a wall between them: both indices, and the wall's thickness in metres.

    The first edge is that with the lower coordinate. Rooms may overlap a little: the thickness is then negative.
    """
    return [
        (one, other, edges[other].at - edges[one].at)
        for one in range(len(edges))
        for other in range(len(edges))
        if edges[one].side < 0 < edges[other].side
        and edges[one].room != edges[other].room
        and -_BESIDE_M <= edges[other].at - edges[one].at <= THICKEST_M
        and min(edges[one].high, edges[other].high) - max(edges[one].low, edges[other].low) > _OVERLAP_M
    ]


def _targets(edges: list[Edge], on_faces: bool) -> dict[tuple[int, int], int]:
    """Computes the grid line that each edge across an axis is moved to, in units, by room and edge number."""
    group = list(range(len(edges)))

    def root(index: int) -> int:
        while group[index] != index:
            index = group[index]
        return index

    paired: set[int] = set()
    for one, other, _ in _facing(edges):
        group[root(other)] = root(one)
        paired |= {one, other}
    order = sorted(range(len(edges)), key=lambda index: edges[index].at)
    for one, other in pairwise(order):
        if edges[other].at - edges[one].at <= _SAME_M and edges[one].side == edges[other].side:
            group[root(other)] = root(one)
    outward = EXTERIOR_WALL / 2 / UNITS_PER_M if on_faces else 0.0
    target: dict[int, float] = {}
    for index in {root(index) for index in range(len(edges))}:
        members = [each for each in range(len(edges)) if root(each) == index]
        between = [edges[each].at for each in members if each in paired]
        target[index] = (
            (min(between) + max(between)) / 2
            if between
            else sum(edges[each].at - edges[each].side * outward for each in members) / len(members)
        )
    first = min(target.values())
    return {
        (edge.room, edge.number): round((target[root(index)] - first) * UNITS_PER_M) for index, edge in enumerate(edges)
    }


def _went(edges: Sequence[Edge], targets: dict[tuple[int, int], int]) -> Lines:
    went = sorted((edge.at, targets[edge.room, edge.number]) for edge in edges)
    return Lines([at for at, _ in went], [made for _, made in went])


def outline_area(corners: Sequence[Point]) -> float:
    """Returns the area of an outline in square metres."""
    return abs(area(corners))


def units_area(corners: Corners) -> float:
    """Returns the area in square metres of a room given in grid units."""
    return area(corners) / UNITS_PER_M**2


Node = tuple[int, int]
Step = tuple[Node, Node]


def overlaps(rooms: Sequence[Corners]) -> Iterator[tuple[int, int, float]]:
    """Yields pairs of rooms that overlap: their numbers, and the area in square metres."""
    boxes = [extent(corners) for corners in rooms]
    owner = np.full((max(box.y1 for box in boxes), max(box.x1 for box in boxes)), -1)
    for number, corners in enumerate(rooms):
        box, units = boxes[number], room_units(corners)
        part = owner[box.y0 : box.y1, box.x0 : box.x1]
        others, counts = np.unique(part[units & (part >= 0)], return_counts=True)
        for other, count in zip(others, counts, strict=True):
            yield int(other), number, int(count) / UNITS_PER_M**2
        part[units & (part < 0)] = number


def outline_of(around: Sequence[Step]) -> Corners:
    """Returns the corners of a building's outline, counter-clockwise.

    Args:
        around: Sides of rooms that face the outside, each from end to end with its room to the left.
    """
    steps: dict[Node, list[Node]] = {}
    for one, other in around:
        steps.setdefault(one, []).append(other)
    best: list[Node] = []
    while steps:
        start = next(iter(steps))
        loop = [start]
        while (following := steps[loop[-1]].pop()) != start:
            if not steps[loop[-1]]:
                del steps[loop[-1]]
            loop.append(following)
        if not steps[loop[-1]]:
            del steps[loop[-1]]
        if area(loop) > area(best):
            best = loop
    return turns(best)
