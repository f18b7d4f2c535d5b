"""Doors as CAD programs draw them: a leaf that stands open, and the arc that it swings along."""

from collections.abc import Iterable, Iterator, Sequence
from math import dist
from typing import NamedTuple

from ....schemas.worlds.world import Point

_NEAR = 0.15
"""Share of a leaf's width within which points are the same: leaves have a thickness, and frames have rebates."""


class Swing(NamedTuple):
    """The arc of a door leaf."""

    hinge: Point
    ends: tuple[Point, Point]

    def near(self, one: Point, other: Point) -> bool:
        """Whether two points are the same one of a door of this width."""
        return dist(one, other) <= _NEAR * dist(self.hinge, self.ends[0])

    def joins(self, points: Iterable[Point], end: Point) -> bool:
        """Whether something that was drawn leads from the hinge to a point."""
        drawn = list(points)
        return all(any(self.near(point, each) for each in drawn) for point in (self.hinge, end))


class DoorError(ValueError):
    """A door whose place in a wall cannot be told."""

    def __init__(self, swing: Swing, message: str) -> None:
        super().__init__(message)
        self.swing = swing


def closed_leaf(swing: Swing, lines: Sequence[Sequence[Point]]) -> tuple[Point, Point]:
    """Line of a door's shut leaf: from its hinge to that end of its arc which no leaf leads to.

    Args:
        swing: the arc.
        lines: corners of all else that is drawn of doors.

    Raises:
        DoorError: a leaf leads to both ends, or to none.
    """
    shut = [end for end, other in (swing.ends, swing.ends[::-1]) if any(swing.joins(line, other) for line in lines)]
    if len(shut) != 1:
        found = "lines lead from its hinge to both ends" if shut else "no leaf leads from its hinge to an end"
        raise DoorError(
            swing,
            f"{found} of its arc, so which one lies in the wall cannot be told; one leaf, drawn open, or a line "
            "along the wall in place of leaf and arc, would be right",
        )
    return swing.hinge, shut[0]


def doorways(swings: Sequence[Swing], lines: Sequence[Sequence[Point]]) -> Iterator[tuple[Swing, tuple[Point, Point]]]:
    """The ways of doors; two leaves that meet are one door.

    Raises:
        DoorError: see `closed_leaf`.
    """
    leaves = [(swing, closed_leaf(swing, lines)) for swing in swings]
    while leaves:
        swing, (hinge, end) = leaves.pop(0)
        meeting = [each for each in leaves if swing.near(each[1][1], end) and not swing.near(each[1][0], hinge)]
        if meeting:
            leaves.remove(meeting[0])
            end = meeting[0][1][0]
        yield swing, (hinge, end)


def belongs(line: Sequence[Point], swings: Iterable[Swing]) -> bool:
    """Whether something that was drawn is a part of a door with a swing."""
    return any(swing.near(point, each) for swing in swings for each in (swing.hinge, *swing.ends) for point in line)
