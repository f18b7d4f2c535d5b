"""Walls around and between rooms, cut at passages, and windows in them.

Every wall is the box from its start to its end, `thickness_m` wide; nothing is added at the ends. The
boxes meet at corners without overlap and without gap: at each junction one wall owns the square and
the others end at its face. In order: walls of the outline, then walls that pass straight through
(horizontal ones first), then, at a corner of two, the horizontal one.
"""

from collections.abc import Iterator
from random import Random
from typing import NamedTuple

from .brief import EXTERIOR_WALL, HABITABLE, INTERIOR_WALL, Brief
from .connections import Way
from .partition import Contact, Partition, contacts, lines

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
    pieces = [_outer_piece(plan, *side) for side in _outer_sides(plan)]
    inner = contacts(plan.rooms)
    along: dict[bool, dict[Node, int]] = {True: {}, False: {}}
    for contact in inner:
        for end in (contact.start, contact.end):
            node = (end, contact.at) if contact.horizontal else (contact.at, end)
            along[contact.horizontal][node] = along[contact.horizontal].get(node, 0) + 1
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


def _outer_sides(plan: Partition) -> Iterator[tuple[bool, int, int, int, int]]:
    """(horizontal, coordinate, start, end, room) of every side of a room that faces the outside."""
    for (horizontal, at), (below, above) in lines(plan.rooms).items():
        if at in (0, plan.height if horizontal else plan.width):
            for start, end, room in (*below, *above):
                yield horizontal, at, start, end, room


def _outer_piece(plan: Partition, horizontal: bool, at: int, start: int, end: int, room: int) -> Piece:
    """Horizontal outer walls own the corners of the outline, vertical ones end at their faces."""
    half = EXTERIOR_WALL // 2 if horizontal else -EXTERIOR_WALL // 2
    limit = plan.width if horizontal else plan.height
    start = start - half if start == 0 else start
    end = end + half if end == limit else end
    return Piece(horizontal, at, start, end, EXTERIOR_WALL, (room,), False)


def _shortening(plan: Partition, contact: Contact, end: int, along: dict[bool, dict[Node, int]]) -> int:
    """By how much a wall ends before (or, if negative, after) the junction at one of its ends."""
    if end in (0, plan.width if contact.horizontal else plan.height):
        return EXTERIOR_WALL // 2
    node = (end, contact.at) if contact.horizontal else (contact.at, end)
    passes = along[contact.horizontal][node] == 2
    across = along[not contact.horizontal].get(node, 0)
    if contact.horizontal:
        if passes:
            return 0
        return INTERIOR_WALL // 2 if across == 2 else -INTERIOR_WALL // 2
    return 0 if passes and across < 2 else INTERIOR_WALL // 2


def place_windows(plan: Partition, brief: Brief, dice: Random) -> list[Pane]:
    """Windows on outer walls of habitable rooms: always on the longest one, sometimes on others."""
    panes: list[Pane] = []
    lit: set[int] = set()
    for horizontal, at, start, end, room in sorted(_outer_sides(plan), key=lambda side: side[2] - side[3]):
        low, high = start + _WINDOW_MARGIN, end - _WINDOW_MARGIN
        skipped = room in lit and dice.random() > _SECOND_SIDE_SHARE
        if brief.types[room] not in HABITABLE or high - low < _WINDOW_WIDTHS[0] or skipped:
            continue
        lit.add(room)
        number = max(1, round((high - low) / _WALL_PER_WINDOW))
        bay = (high - low) // number
        width = min(dice.choice(_WINDOW_WIDTHS), bay)
        for index in range(number):
            first = low + index * bay + (bay - width) // 2
            panes.append(Pane(horizontal, at, first, first + width, room))
    return panes
