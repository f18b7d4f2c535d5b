"""Marked moments of a run: rooms, contacts, goals, missed requirements."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from ....schemas.runs.plan import RunResult

MarkKind = Literal["room", "contact", "goal", "violation"]


@dataclass(frozen=True)
class Mark:
    """A moment of a run that a page has a link to."""

    time_s: float
    kind: MarkKind
    text: str
    """Words after the time: `first in Kitchen`."""


def marks_of(result: RunResult) -> list[Mark]:
    """Returns the marked moments of a run in the order of their times.

    Requirements that do not count are left out, and so are those that could not be judged: they were not missed.
    """
    found = [mark for mark in _marks(result) if math.isfinite(mark.time_s)]
    return sorted(found, key=lambda mark: (mark.time_s, mark.kind, mark.text))


def first_violation(marks: list[Mark]) -> Mark | None:
    """Returns the earliest missed requirement among marks in order of time; `None` if there is none."""
    return next((mark for mark in marks if mark.kind == "violation"), None)


def _marks(result: RunResult) -> Iterator[Mark]:
    for room in result.rooms:
        if room.visited and room.first_visit_s is not None:
            yield Mark(room.first_visit_s, "room", f"first in {room.name}")
    for touch in result.collisions:
        yield Mark(touch.time_s, "contact", f"robot touches {touch.other}, {touch.max_force_N:.1f} N")
    for item in result.requirements:
        if item.kind == "goal" and item.satisfied and item.unit == "s" and item.value is not None:
            yield Mark(item.value, "goal", f"reaches {item.name}")
        elif item.counts and not item.satisfied and item.error is None and item.first_violation_s is not None:
            at = "".join(f" {word} {place}" for word, place in (("in", item.room), ("at", item.other)) if place)
            yield Mark(item.first_violation_s, "violation", f"misses {item.name}{at}")
