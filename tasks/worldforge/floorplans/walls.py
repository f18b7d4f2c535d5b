"""Walls around and between rooms, cut at passages, and windows in them.

Every wall is the box from its start to its end, `thickness_m` wide; nothing is added at the ends. Where
the outline is set back from the plan's rectangle, outer walls are as thick as inner ones. The boxes meet
at corners without overlap and without gap: at each junction one wall owns the square and the others end
at its face. In order: walls of the rectangle, then walls that pass straight through (horizontal ones
first), then, at a corner of two, the horizontal one.
"""

from collections.abc import Iterable, Sequence
from random import Random
from typing import NamedTuple

from ....schemas.worlds.world import RoomType
from .brief import EXTERIOR_WALL, HABITABLE, INTERIOR_WALL, Brief
from .connections import Way
from .partition import Contact, Partition, Side, border, contacts, in_rectangle

_WINDOW_MARGIN = 10
_WINDOW_WIDTHS = (24, 28, 32, 36, 40)
_WALL_PER_WINDOW = 90
_SECOND_SIDE_SHARE = 0.5


class Piece(NamedTuple):
    """A straight box of wall, in units, along its centre line from `start` to `end`."""

    horizontal: bool
    at: int
    start: int
    end: int
    thickness: int
    rooms: tuple[int, ...]
    lintel: bool


class Pane(NamedTuple):
    """A window, in units, along the wall's centre line."""

    horizontal: bool
    at: int
    start: int
    end: int
    room: int


Node = tuple[int, int]


def build_walls(plan: Partition, ways: list[Way]) -> list[Piece]:
    """All walls of a plan, lintels over doorways included."""
    outer = [side for side in border(plan.rooms) if in_rectangle(plan, side)]
    back = [side for side in border(plan.rooms) if not in_rectangle(plan, side)]
    pieces = [_outer_piece(plan, side, outer) for side in outer]
    inner = contacts(plan.rooms)
    along: dict[bool, dict[Node, int]] = {True: {}, False: {}}
    for line in (*inner, *back):
        for end in (line.start, line.end):
            node = (end, line.at) if line.horizontal else (line.at, end)
            along[line.horizontal][node] = along[line.horizontal].get(node, 0) + 1
    for side in back:
        start = side.start + _shortening(plan, side, side.start, along)
        end = side.end - _shortening(plan, side, side.end, along)
        if end > start:
            pieces.append(Piece(side.horizontal, side.at, start, end, INTERIOR_WALL, (side.room,), False))
    for contact in inner:
        start = contact.start + _shortening(plan, contact, contact.start, along)
        end = contact.end - _shortening(plan, contact, contact.end, along)
        rooms = (contact.low, contact.high)
        for way in sorted((way for way in ways if way.contact == contact), key=lambda way: way.start):
            if way.start > start:
                pieces.append(Piece(contact.horizontal, contact.at, start, way.start, INTERIOR_WALL, rooms, False))
            if way.kind == "Doorway":
                pieces.append(Piece(contact.horizontal, contact.at, way.start, way.end, INTERIOR_WALL, rooms, True))
            start = way.end
        if end > start:
            pieces.append(Piece(contact.horizontal, contact.at, start, end, INTERIOR_WALL, rooms, False))
    return pieces


def _outer_piece(plan: Partition, side: Side, outer: list[Side]) -> Piece:
    """Horizontal walls own the corners of the rectangle, vertical ones end at their faces."""
    half = EXTERIOR_WALL // 2 if side.horizontal else -EXTERIOR_WALL // 2
    limit = plan.width if side.horizontal else plan.height
    row = [other for other in outer if other.horizontal == side.horizontal and other.at == side.at]

    def longer(end: int) -> int:
        if end in (0, limit):
            return half
        goes_on = any(end in (other.start, other.end) for other in row if other is not side)
        # Else it is set back here, and ends where the wall across does.
        return 0 if goes_on else INTERIOR_WALL // 2

    start, end = side.start - longer(side.start), side.end + longer(side.end)
    return Piece(side.horizontal, side.at, start, end, EXTERIOR_WALL, (side.room,), False)


def _shortening(plan: Partition, line: Contact | Side, end: int, along: dict[bool, dict[Node, int]]) -> int:
    """Length by which a wall ends before (or, if negative, after) the junction at one of its ends, in units."""
    if end in (0, plan.width if line.horizontal else plan.height):
        return EXTERIOR_WALL // 2
    node = (end, line.at) if line.horizontal else (line.at, end)
    passes = along[line.horizontal][node] == 2
    across = along[not line.horizontal].get(node, 0)
    if line.horizontal:
        if passes:
            return 0
        return INTERIOR_WALL // 2 if across == 2 else -INTERIOR_WALL // 2
    return 0 if passes and across < 2 else INTERIOR_WALL // 2


def place_windows(plan: Partition, brief: Brief, dice: Random) -> list[Pane]:
    """Windows on outer walls of habitable rooms: always on the longest one, sometimes on others."""
    return windows_along(border(plan.rooms), brief.types, dice)


def windows_along(sides: Iterable[Side], types: Sequence[RoomType], dice: Random) -> list[Pane]:
    """The same for any outer walls.

    Args:
        sides: what faces the outside.
        types: types of the rooms.
        dice: the source of chance.
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
