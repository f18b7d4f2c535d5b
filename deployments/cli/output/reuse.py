"""Forecast of reuse for `--reuse`, in lines: parts with the same reason share a line."""

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ....tasks.inspection.reuse_plans import PlannedPart


def reuse_lines(parts: "Sequence[PlannedPart]") -> list[str]:
    """The lines of one step: `run    requests 2 to 4: its world is generated first`."""
    lines = []
    for (reuse, why), group in groupby(parts, key=lambda part: (part.reuse, part.why)):
        names = [part.part for part in group]
        lines.append(f"{'reuse' if reuse else 'run  '}  {_together(names)}: {why}")
    return lines


def reuse_total(parts: "Mapping[str, Sequence[PlannedPart]]") -> str:
    """How much would be taken over: `4 of 4 worlds and 3 of 4 simulation jobs are taken over`."""
    told = []
    for noun, is_it in (("worlds", True), ("simulation jobs", False)):
        these = [part for each in parts.values() for part in each if part.part.startswith("world") is is_it]
        if these:
            told.append(f"{sum(part.reuse for part in these)} of {len(these)} {noun}")
    return f"{' and '.join(told)} are taken over" if told else "nothing here can be taken over"


def why_nothing(parts: "Mapping[str, Sequence[PlannedPart]]") -> str | None:
    """Says why a run would take over nothing, the first reason of each step; None: it would, or makes no such parts.

    Jobs whose worlds are generated first have no reason of their own.
    """
    from ....tasks.inspection.reuse_plans import NEW_WORLD

    if not parts or any(part.reuse for each in parts.values() for part in each):
        return None
    first = {step: each[0].why for step, each in parts.items() if each}
    own = {step: why for step, why in first.items() if why != NEW_WORLD} or first
    reasons = "; ".join(f"{step}: {why}" for step, why in own.items())
    return f"--reuse takes nothing over: {reasons}"


def _together(names: Sequence[str]) -> str:
    first, last = names[0], names[-1]
    if len(names) == 1:
        return first
    noun, _, _ = first.rpartition(" ")
    return f"{noun}s {first.rpartition(' ')[2]} to {last.rpartition(' ')[2]}"
