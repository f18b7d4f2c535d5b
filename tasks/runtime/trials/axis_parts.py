"""Parts of an axis by which a report counts trials: the axis's values, or equally likely fifths of its range."""

from bisect import bisect_right
from collections.abc import Mapping

from ....schemas.runs.axes import AS_BUILT, value_text
from ....schemas.runs.axis_kinds.kind import Axis, NumberAxis, Value

Part = tuple[int, str]
"""Index of a part among those of its axis, and its description."""


class AxisParts:
    """Finds the part of an axis to which a value belongs.

    Args:
        axis: Axis of the trials.
    """

    def __init__(self, axis: Axis) -> None:
        self._edges = axis.edges() if isinstance(axis, NumberAxis) and axis.listed is None else None
        self._listed: Mapping[Value, int] = {value: place for place, value in enumerate(axis.listed or ())}

    def part(self, value: Value | None) -> Part:
        """Returns the part to which a value belongs.

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
