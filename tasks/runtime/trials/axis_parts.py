"""Axes of a job as its trials show them: the part of an axis that each trial lies in, and axes without an effect."""

from bisect import bisect_right
from collections.abc import Mapping

from ....schemas.runs.axes import AS_BUILT, value_text
from ....schemas.runs.axis_kinds.kind import Axis, NumberAxis, Value
from ....schemas.runs.trial_rows import TrialRow
from ....schemas.wire.common import counted

Part = tuple[int, str]
"""Index of a part among those of its axis, and its description."""

MAX_LOOKED_AT = 200
"""Number of trials that others are compared with: an axis that changes nothing in so many is told well enough."""


class AxisParts:
    """Finds the part of an axis to which a value belongs.

    Args:
        axis: Axis of the trials.
    """

    def __init__(self, axis: Axis) -> None:
        self._edges = axis.edges() if isinstance(axis, NumberAxis) and axis.listed is None else None
        self._listed: Mapping[Value, int] = {value: place for place, value in enumerate(axis.listed or ())}

    def part(self, value: Value | None) -> Part:
        """Returns the part of the axis to which a value belongs: its index and description.

        Args:
            value: Value of the axis; None: the cell has none.
        """
        if value is None:
            return len(self._listed) + len(self._edges or ()) + 1, AS_BUILT
        if self._edges is None or isinstance(value, str):
            return self._listed.get(value, len(self._listed)), value_text(value)
        low, high = self._edges[0], self._edges[-1]
        if value < low:
            return 0, f"below {low:.4g}"
        if value > high:
            return len(self._edges), f"above {high:.4g}"
        place = min(bisect_right(self._edges, value), len(self._edges) - 1)
        return place, f"{self._edges[place - 1]:.4g} to {self._edges[place]:.4g}"


class AxisEffect:
    """Finds an axis without an effect: trials that differ in it alone all went through the same states.

    It compares the first trials with those of the same seed and the same values of all other axes. Points of a spread
    design differ in all axes, so that nothing is said of them.

    Args:
        name: The axis.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._first: dict[int, str] | None = {}
        """States of the first trials, by a hash of seed and other axes, which no two trials with one value of the axis
        have in common; None: an effect was seen."""
        self._pairs = 0

    def take(self, row: TrialRow) -> None:
        """Compares one trial with an earlier one that differs in this axis only, to see if the axis has an effect.

        A difference, or a trial without a state digest, ends the comparison.
        """
        if self._first is None:
            return
        if row.state_digest is None:
            self._first = None  # nothing is known of its states
            return
        place = hash((row.seed, *((name, value) for name, value in row.axes.items() if name != self._name)))
        found = self._first.get(place)
        if found is None:
            if len(self._first) < MAX_LOOKED_AT:
                self._first[place] = row.state_digest
        elif found == row.state_digest:
            self._pairs += 1
        else:
            self._first = None

    @property
    def note(self) -> str:
        """Line about an axis that changed nothing; empty: it did, or no trials differ in it alone."""
        if self._first is None or not self._pairs:
            return ""
        pairs = counted(self._pairs, "pair")
        return (
            f"axis {self._name} changed nothing: {pairs} of trials that differ in it alone went through the same states"
        )
