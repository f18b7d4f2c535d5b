"""Walls around and between rooms of any rectilinear shapes.

The boxes of walls meet at corners without overlap and without gap: at each junction the thickest wall, or one that
passes straight through, owns the square, and the others end at its face.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from ..floorplans.brief import EXTERIOR_WALL, INTERIOR_WALL
from ..floorplans.connections import Way
from ..floorplans.partition import Contact, Corners, Side, border, contacts
from ..floorplans.walls import Node, Piece


class Run(NamedTuple):
    """A straight stretch of wall between two junctions, in units, along its centre line."""

    horizontal: bool
    at: int
    start: int
    end: int
    rooms: tuple[int, ...]

    @property
    def thickness(self) -> int:
        """Thickness of an outer or an inner wall, in units."""
        return EXTERIOR_WALL if len(self.rooms) == 1 else INTERIOR_WALL

    def node(self, at: int) -> Node:
        """The junction at one of its ends."""
        return (at, self.at) if self.horizontal else (self.at, at)


class Walls:
    """The walls of some rooms.

    Attributes:
        contacts: what two rooms share.
        sides: what faces the outside.
        around: the same from end to end, each with its room to the left.
    """

    def __init__(self, rooms: Sequence[Corners]) -> None:
        self.contacts = contacts(rooms)
        self.sides = border(rooms)
        self.around = [_step(side) for side in self.sides]
        self._runs = [Run(*side[:4], (side.room,)) for side in self.sides]
        self._runs += [
            Run(each.horizontal, each.at, each.start, each.end, (each.low, each.high)) for each in self.contacts
        ]
        self._arms: dict[Node, dict[tuple[bool, bool], int]] = {}
        for run in self._runs:
            for at, ahead in ((run.start, True), (run.end, False)):
                self._arms.setdefault(run.node(at), {})[run.horizontal, ahead] = run.thickness

    def pieces(self, ways: Sequence[Way]) -> list[Piece]:
        """All walls, cut at ways, lintels over doorways included."""
        return [piece for run in self._runs for piece in self._cut(run, ways)]

    def clear_span(self, contact: Contact) -> tuple[int, int]:
        """The part of a shared wall between the faces of the walls at its ends."""
        ends = []
        for at, inward in ((contact.start, 1), (contact.end, -1)):
            node = (at, contact.at) if contact.horizontal else (contact.at, at)
            across = [self._arms[node].get((not contact.horizontal, ahead), 0) for ahead in (True, False)]
            ends.append(at + inward * max(across) // 2)
        return ends[0], ends[1]

    def _cut(self, run: Run, ways: Sequence[Way]) -> Iterator[Piece]:
        start = run.start + self._inset(run, run.start, ahead=True)
        end = run.end - self._inset(run, run.end, ahead=False)
        mine = [way for way in ways if len(run.rooms) == 2 and _is_of(run, way.contact)]
        for way in sorted(mine, key=lambda way: way.start):
            if way.start > start:
                yield Piece(run.horizontal, run.at, start, way.start, run.thickness, run.rooms, False)
            if way.kind == "Doorway":
                yield Piece(run.horizontal, run.at, way.start, way.end, run.thickness, run.rooms, True)
            start = max(start, way.end)
        if end > start:
            yield Piece(run.horizontal, run.at, start, end, run.thickness, run.rooms, False)

    def _inset(self, run: Run, at: int, *, ahead: bool) -> int:
        """Length by which a run ends before the junction at one of its ends, in units; negative: after it."""
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
    """Whether the walls along an axis own a junction: the thickest, then those that pass, then the level ones."""
    mine, others = (
        (max(arms), min(arms) == max(arms), level) for arms, level in ((along, horizontal), (across, not horizontal))
    )
    return mine > others


def _step(side: Side) -> tuple[Node, Node]:
    ends = [(along, side.at) if side.horizontal else (side.at, along) for along in (side.start, side.end)]
    return (ends[0], ends[1]) if side.forward else (ends[1], ends[0])


def _is_of(run: Run, contact: Contact) -> bool:
    return (run.horizontal, run.at, run.start, run.end) == (contact.horizontal, contact.at, contact.start, contact.end)
