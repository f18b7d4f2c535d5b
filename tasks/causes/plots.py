"""Numbers for drawings: margins over an axis, and failure rates of a group over one axis or two, with intervals."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...schemas.reports.causes import CellPlot, MarginPlot, PlotCell
from ...schemas.reports.live_comparison import FEWEST_WORLDS
from ..results.rates import wilson_interval
from .evidence import AxisColumn, Evidence
from .groups import Group
from .lift import reach_between
from .regions import parts_of

_MOST_POINTS = 200
_PARTS = 8
_PARTS_OF_PAIRS = 4


def margin_plot(
    margins: NDArray[np.float64], axis: AxisColumn, requirement: str, unit: str | None
) -> MarginPlot | None:
    """Gathers the margins of a requirement over an axis; `None` if there are none.

    Args:
        margins: Margins of the trials; NaN where there is none.
        axis: An axis of numbers.
        requirement: Name of the requirement.
        unit: Unit of its margin.
    """
    values = axis.numbers
    known = np.flatnonzero(np.isfinite(values) & np.isfinite(margins))
    if not len(known):
        return None
    # Every so manieth would be of few cells, as trials are in the order of their cells.
    shown = np.sort(np.random.default_rng(0).permutation(known)[:_MOST_POINTS])
    parts = []
    for _, mask in parts_of(axis, _PARTS):
        inside = known[mask[known]]
        if len(inside):
            low, middle, high = np.quantile(margins[inside], [0.1, 0.5, 0.9])
            ends = float(values[inside].min()), float(values[inside].max())
            parts.append((*ends, float(low), float(middle), float(high)))
    points = [(float(values[row]), float(margins[row])) for row in shown.tolist()]
    return MarginPlot(requirement=requirement, axis=axis.name, unit=unit, points=points, parts=parts)


def cell_plot(evidence: Evidence, group: Group, name: str, axes: Sequence[AxisColumn]) -> CellPlot:
    """Computes the failure rates of a group over one axis or two.

    Args:
        evidence: The trials.
        group: The failures that are asked about.
        name: The group in words.
        axes: One axis, or two.
    """
    first = parts_of(axes[0], _PARTS if len(axes) == 1 else _PARTS_OF_PAIRS)
    second = parts_of(axes[1], _PARTS_OF_PAIRS) if len(axes) > 1 else [("", group.at_risk)]
    cells = [
        _cell(evidence, group.failed, mask & other_mask & group.at_risk, part, other)
        for part, mask in first
        for other, other_mask in second
        if (mask & other_mask & group.at_risk).any()
    ]
    return CellPlot(group=name, axes=[axis.name for axis in axes], cells=cells)


def _cell(evidence: Evidence, failed: NDArray[np.bool_], mask: NDArray[np.bool_], part: str, other: str) -> PlotCell:
    trials, count = int(mask.sum()), int(failed[mask].sum())
    rate = count / trials
    low, high = wilson_interval(count, trials)
    worlds = evidence.worlds[mask]
    if len(np.unique(worlds)) >= FEWEST_WORLDS:
        reach = reach_between((failed[mask] - rate) / trials, worlds, 0.95)
        low, high = min(low, max(0.0, rate - reach)), max(high, min(1.0, rate + reach))
    return PlotCell(part=part, other_part=other, failed=count, trials=trials, rate=rate, low=low, high=high)
