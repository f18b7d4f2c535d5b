"""How many robots of a wave did what at the same time, for fleets too large for a row of each robot."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from .scale import Scale
from .spans import PHASES, Phase, Span

COLUMNS = 120
"""Into how many columns the time is cut."""


@dataclass(frozen=True)
class Block:
    """Robots that did the same for some columns; neighbours with as many are one block."""

    phase: Phase
    column: int
    columns: int
    below: float
    """Share of the wave's robots that are drawn below it."""

    share: float
    """Share of the wave's robots that did this."""


def blocks_of(robots: Sequence[Iterable[Span]], scale: Scale) -> list[Block]:
    """Phases of the robots of a wave, as blocks on top of one another.

    Args:
        robots: the spans of each.
        scale: the time.
    """
    columns = _columns(robots, scale)
    blocks: list[Block] = []
    for phase in PHASES:
        begun, before = 0, (0, 0)
        for column in range(COLUMNS + 1):
            now = _height(columns, column, phase)
            if now == before:
                continue
            if before[1]:
                below, count = (each / len(robots) for each in before)
                blocks.append(Block(phase, begun, column - begun, below, count))
            begun, before = column, now
    return blocks


def _columns(robots: Sequence[Iterable[Span]], scale: Scale) -> list[Counter[Phase]]:
    """How many robots are in which phase in the middle of each column."""
    columns: list[Counter[Phase]] = [Counter() for _ in range(COLUMNS)]
    for spans in robots:
        for span in spans:
            first, last = (round(scale.part(at_s) * COLUMNS) for at_s in (span.from_s, span.until_s))
            for column in range(first, min(last, COLUMNS)):
                columns[column][span.phase] += 1
    return columns


def _height(columns: Sequence[Counter[Phase]], column: int, phase: Phase) -> tuple[int, int]:
    """How many robots are drawn below a phase in a column, and how many in it; none behind the last column."""
    if column == len(columns):
        return 0, 0
    counts = columns[column]
    below = 0
    for each in reversed(PHASES):  # those that are furthest lie at the bottom
        if each == phase:
            break
        below += counts[each]
    return (below, counts[phase]) if counts[phase] else (0, 0)
