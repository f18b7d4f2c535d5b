"""Computes walls around and between rooms of any rectilinear shape, cut at doorways, and windows in them.

Every wall is the box from its start to its end, `thickness_m` wide; nothing is added at the ends. The boxes meet at
corners without overlap and without gap: at each junction the thickest wall owns the square, then one that passes
straight through, then the horizontal one, and the others end at its face.
"""

from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from random import Random
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....schemas.worlds.world import RoomType
from .brief import EXTERIOR_WALL, HABITABLE, INTERIOR_WALL, Brief
from .connections import Way, floor_areas, floor_ratios
from .partition import Contact, Corners, Partition, Side, border, contacts, extent

_WINDOW_MARGIN = 10
_WINDOW_WIDTHS = (24, 28, 32, 36, 40)
_WALL_PER_WINDOW = 90
_SECOND_SIDE_SHARE = 0.5


class Piece(NamedTuple):
    """A straight wall segment in grid units, along its centre line from `start` to `end`."""

    horizontal: bool
    at: int
    start: int
    end: int
    thickness: int
    rooms: tuple[int, ...]
    lintel: bool


class Pane(NamedTuple):
    """A window in grid units, along the wall's centre line."""

    horizontal: bool
    at: int
    start: int
    end: int
    room: int


Node = tuple[int, int]


class Run(NamedTuple):
    """A straight stretch of wall between two junctions, in grid units, along its centre line."""

    horizontal: bool
    at: int
    start: int
    end: int
    rooms: tuple[int, ...]
    thickness: int

    def node(self, at: int) -> Node:
        """Returns the wall junction at one end of the stretch of wall."""
        return (at, self.at) if self.horizontal else (self.at, at)


class Walls:
    """Computes the walls of a floor plan from its rooms.

    Args:
        rooms: Corners of the rooms.

    Attributes:
        contacts: Shared walls of two rooms.
        sides: Walls to the outside.
        around: Walls to the outside from corner to corner, each with its room to the left.
    """

    def __init__(self, rooms: Sequence[Corners]) -> None:
        self.contacts = contacts(rooms)
        self.sides = border(rooms)
        self.around = [_step(side) for side in self.sides]
        self._runs = [Run(*side[:4], (side.room,), EXTERIOR_WALL) for side in self.sides]
        self._runs += [Run(*each[2:], (each.low, each.high), INTERIOR_WALL) for each in self.contacts]
        self._arms: dict[Node, dict[tuple[bool, bool], int]] = {}
        for run in self._runs:
            for at, ahead in ((run.start, True), (run.end, False)):
                self._arms.setdefault(run.node(at), {})[run.horizontal, ahead] = run.thickness

    def pieces(self, ways: Sequence[Way]) -> list[Piece]:
        """Returns all wall segments, cut at doorways and openings, with lintels over doorways."""
        return [piece for run in self._runs for piece in self._cut(run, ways)]

    def clear_span(self, contact: Contact) -> tuple[int, int]:
        """Returns the part of a shared wall that is free between the walls at its ends, in grid units."""
        ends = []
        for at, inward in ((contact.start, 1), (contact.end, -1)):
            node = (at, contact.at) if contact.horizontal else (contact.at, at)
            across = [self._arms[node].get((not contact.horizontal, ahead), 0) for ahead in (True, False)]
            ends.append(at + inward * max(across) // 2)
        return ends[0], ends[1]

    def _cut(self, run: Run, ways: Sequence[Way]) -> Iterator[Piece]:
        start = run.start + self._inset(run, run.start, ahead=True)
        end = run.end - self._inset(run, run.end, ahead=False)
        mine = [way for way in ways if len(run.rooms) == 2 and way.contact[2:] == run[:4]]
        for way in sorted(mine, key=lambda way: way.start):
            if way.start > start:
                yield Piece(run.horizontal, run.at, start, way.start, run.thickness, run.rooms, False)
            if way.kind == "Doorway":
                yield Piece(run.horizontal, run.at, way.start, way.end, run.thickness, run.rooms, True)
            start = max(start, way.end)
        if end > start:
            yield Piece(run.horizontal, run.at, start, end, run.thickness, run.rooms, False)

    def _inset(self, run: Run, at: int, *, ahead: bool) -> int:
        """Returns the length by which a wall ends before the junction at one of its ends, in grid units.

        It is negative if the wall ends after the junction.
        """
        arms = self._arms[run.node(at)]
        along = {each: arms.get((run.horizontal, each), 0) for each in (True, False)}
        across = [arms.get((not run.horizontal, each), 0) for each in (True, False)]
        mine, other = along[ahead], along[not ahead]
        if not _owns(run.horizontal, list(along.values()), across):
            return max(across) // 2
        if mine == other:
            return 0
        # The thickest wall goes on to the far side of the square, or to its middle where none stands across.
        return -(max(across) // 2) if mine > other else max(across) // 2


def _owns(horizontal: bool, along: Sequence[int], across: Sequence[int]) -> bool:
    """Whether walls along one axis fill a junction's square.

    The thickest walls do, then those that pass through, then horizontal ones.
    """
    mine, others = (
        (max(arms), min(arms) == max(arms), level) for arms, level in ((along, horizontal), (across, not horizontal))
    )
    return mine > others


def _step(side: Side) -> tuple[Node, Node]:
    ends = [(along, side.at) if side.horizontal else (side.at, along) for along in (side.start, side.end)]
    return (ends[0], ends[1]) if side.forward else (ends[1], ends[0])


def build_walls(plan: Partition, ways: Sequence[Way]) -> list[Piece]:
    """Returns all wall segments of a floor plan."""
    return Walls(plan.rooms).pieces(ways)


class FloorShape(NamedTuple):
    """Size and shape of a room's floor, inside the walls."""

    area: float
    """Floor area of a room in square grid units."""
    ratio: float
    """Length over width of a room's floor."""


@lru_cache(maxsize=16)
def floor_shapes(plan: Partition) -> tuple[FloorShape, ...]:
    """Measures area (in square grid units) and aspect ratio of the floors of all rooms, without what walls cover."""
    if plan.is_full:
        return tuple(map(FloorShape, floor_areas(plan), floor_ratios(plan)))
    pieces = build_walls(plan, [])
    areas = [float(floor_cells(corners, pieces).sum()) for corners in plan.rooms]
    return tuple(
        FloorShape(area, max(sides) / min(sides)) for area, sides in zip(areas, _floor_sides(plan), strict=True)
    )


def _floor_sides(plan: Partition) -> list[tuple[float, float]]:
    """Returns the extents of the floors of rectangular rooms along x and y, in grid units.

    A side that is partly an outer wall counts as shorter by the floor area lost there, as in the search for plans.
    """
    boxes = [extent(corners) for corners in plan.rooms]
    taken = [[float(INTERIOR_WALL), float(INTERIOR_WALL)] for _ in boxes]
    for side in border(plan.rooms):
        box = boxes[side.room]
        whole = box.x1 - box.x0 if side.horizontal else box.y1 - box.y0
        taken[side.room][side.horizontal] += (EXTERIOR_WALL - INTERIOR_WALL) / 2 * (side.end - side.start) / whole
    return [(box.x1 - box.x0 - x, box.y1 - box.y0 - y) for box, (x, y) in zip(boxes, taken, strict=True)]


def room_units(corners: Corners) -> NDArray[np.bool_]:
    """Returns a mask of the grid cells inside a room, rows from south to north."""
    box = extent(corners)
    inside = np.zeros((box.y1 - box.y0, box.x1 - box.x0), np.bool_)
    for (x0, y0), (x1, y1) in zip(corners, [*corners[1:], corners[0]], strict=True):
        if x0 == x1:  # only upright edges cross an eastward ray
            inside[min(y0, y1) - box.y0 : max(y0, y1) - box.y0, x0 - box.x0 :] ^= True
    return inside


def floor_cells(corners: Corners, pieces: Sequence[Piece]) -> NDArray[np.bool_]:
    """Returns a mask of a room's grid cells that no wall covers.

    It covers the room's bounding box; rows run along y, columns along x.
    """
    box, cells = extent(corners), room_units(corners)
    for piece in pieces:
        if not piece.lintel:
            half = piece.thickness // 2
            along, across = (piece.start, piece.end), (piece.at - half, piece.at + half)
            (x0, x1), (y0, y1) = (along, across) if piece.horizontal else (across, along)
            cells[max(0, y0 - box.y0) : max(0, y1 - box.y0), max(0, x0 - box.x0) : max(0, x1 - box.x0)] = False
    return cells


def place_windows(plan: Partition, brief: Brief, dice: Random) -> list[Pane]:
    """Places windows in outer walls of habitable rooms."""
    return windows_along(border(plan.rooms), brief.types, dice)


def windows_along(sides: Iterable[Side], types: Sequence[RoomType], dice: Random) -> list[Pane]:
    """Places windows in given outer walls.

    Args:
        sides: Outer walls.
        types: Types of the rooms.
        dice: The source of chance.
    """
    panes: list[Pane] = []
    lit: set[int] = set()
    for horizontal, at, start, end, room, _ in sorted(sides, key=lambda side: side.start - side.end):
        low, high = start + _WINDOW_MARGIN, end - _WINDOW_MARGIN
        skipped = room in lit and dice.random() > _SECOND_SIDE_SHARE
        if types[room] not in HABITABLE or high - low < _WINDOW_WIDTHS[0] or skipped:
            continue
        lit.add(room)
        number = max(1, round((high - low) / _WALL_PER_WINDOW))
        bay = (high - low) // number
        width = min(dice.choice(_WINDOW_WIDTHS), bay)
        for index in range(number):
            first = low + index * bay + (bay - width) // 2
            panes.append(Pane(horizontal, at, first, first + width, room))
    return panes
