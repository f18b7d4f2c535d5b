"""Sensitivity of margins to axes of numbers: slopes within worlds, with intervals that respect clusters."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ...schemas.reports.causes import Sensitivity
from ...schemas.reports.live_comparison import FEWEST_WORLDS
from ...schemas.wire.common import counted
from ..results.rates import margin_units
from ..results.table import ResultTable
from .evidence import AxisColumn, Evidence
from .lift import cells_of, reach_between

FEWEST_TRIALS = 20
FEWEST_CLUSTERS = 10
"""Cells, or seeds, from which on a slope has an interval: with fewer, t intervals of skewed margins are too narrow."""
LEVEL = 0.95
"""Level at which all intervals of a kind hold together."""
MOST_VALUES = 20
"""Values of an axis of texts that are looked at; more have too few trials each."""
ROUNDING = 1e-9
"""Share of the range of an outcome below which a change is an error of rounding: sums of doubles have 1e-12 of it."""


def sensitivities(results: ResultTable, evidence: Evidence) -> tuple[list[Sensitivity], list[str]]:
    """Computes by how much margins change along axes.

    Args:
        results: The table of results.
        evidence: Its judged trials.

    Returns:
        Sensitivities, and sentences about those that were refused.
    """
    units = {name: next(iter(found)) for name, found in margin_units(results).items() if len(found) == 1}
    numbers = [axis for axis in evidence.axes if axis.is_number]
    level = joint_level(evidence, len(units))
    found: list[Sensitivity] = []
    refused: dict[str, None] = {}
    for name, unit in units.items():
        margins = judged_margins(results, evidence, name)
        for axis in numbers:
            answer = along(margins, evidence, axis.numbers, level)
            if isinstance(answer, str):
                refused[f"sensitivity of {name} to {axis.name}: {answer}"] = None
            elif answer is not None:
                start, end, change, low, high = answer
                found.append(
                    Sensitivity(
                        requirement=name,
                        axis=axis.name,
                        unit=unit,
                        start=start,
                        end=end,
                        change=change,
                        low=low,
                        high=high,
                    )
                )
    return found, list(refused)


def joint_level(evidence: Evidence, requirements: int) -> float:
    """Returns the level of each interval of a run, so that those of all axes hold together.

    It is that of the effects of axes as well: a margin's change has the same interval wherever it is told.

    Args:
        evidence: The trials.
        requirements: Number of requirements with margins; failures are one more outcome.
    """
    contrasts = sum(
        1 if axis.is_number or len(axis.values) == 2 else min(len(axis.values), MOST_VALUES) for axis in evidence.axes
    )
    return 1 - (1 - LEVEL) / max(1, (requirements + 1) * contrasts)


def judged_margins(results: ResultTable, evidence: Evidence, requirement: str) -> NDArray[np.float64]:
    """Returns the margins of judged trials; NaN where a requirement was not judged."""
    met = results.met(requirement)[evidence.rows]
    return np.where(met >= 0, results.numbers(f"margin.{requirement}")[evidence.rows], np.nan)


def along(
    margins: NDArray[np.float64], evidence: Evidence, values: NDArray[np.float64], level: float
) -> tuple[float, float, float, float, float] | str | None:
    """Computes the change of an outcome along the values of an axis, as a straight line within jobs.

    Where all clusters (seeds or cells) show the same change, they have no spread, and an interval from their spread
    would have no width. The interval is at least that of `_unseen`, which has.

    Args:
        margins: Outcome of each trial; NaN where it is unknown.
        evidence: The trials.
        values: Value of the axis of each trial; NaN where it is as built.
        level: Confidence level of the interval.

    Returns:
        The axis's value that a tenth of the trials are below, that which a tenth are above, the outcome's change
        between them and both ends of its interval; or why not; None: there are no outcomes.
    """
    known = np.isfinite(margins) & np.isfinite(values)
    if not np.isfinite(margins).any():
        return None
    count = int(known.sum())
    if count < FEWEST_TRIALS:
        return f"an interval takes {FEWEST_TRIALS} trials with a margin, and {there_are(count)}"
    x, y = (within(each[known], evidence.jobs[known]) for each in (values, margins))
    square = float((x**2).sum())
    if square <= 1e-12 * float((values[known] ** 2).sum() + 1e-12):
        return "it is the same in all trials of each job; other values in each job would do"
    clusterings = [cells_of(evidence)[known]]
    if (worlds := len(np.unique(evidence.worlds[known]))) >= FEWEST_WORLDS:
        clusterings.append(evidence.worlds[known])
    clusters = len(np.unique(clusterings[0]))
    if clusters < FEWEST_CLUSTERS:
        there = counted(worlds, "world")
        return f"an interval takes {FEWEST_CLUSTERS} seeds or cells, and in {there} there are {clusters}"
    slope = float((x * y).sum()) / square
    left = y - slope * x
    parts = x * left / square
    reaches = [reach_between(parts, each, level) for each in clusterings]
    # Few trials apart from the others may all be the same by chance; their spread is taken to be that of all.
    alike = np.abs(x) * math.sqrt(float((left**2).mean())) / square
    reach = max(*reaches, reach_between(alike, np.arange(count), level))
    start, end = (float(each) for each in np.quantile(values[known], [0.1, 0.9]))
    if start == end:
        start, end = float(values[known].min()), float(values[known].max())
    largest = float(np.ptp(margins[known]))
    change, reach = (each * (end - start) for each in (slope, reach))
    change = change if abs(change) > ROUNDING * largest else 0.0
    low, high = change - reach, change + reach
    is_binary = bool(np.isin(margins[known], (0.0, 1.0)).all())
    if is_binary or reach <= ROUNDING * largest:
        least, most = _unseen(change, largest, clusters, level)
        low, high = min(low, least), max(high, most)
    return start, end, change, low, high


def _unseen(change: float, largest: float, clusters: int, level: float) -> tuple[float, float]:
    """Returns the interval of a change that all clusters showed, which others may not show.

    If a share p of clusters behaves otherwise, none of n does so with the chance (1 - p)^n. The exact upper bound of p
    is thus 1 - (1 - level)^(1 / n), known as the rule of three, since it is about 3 / n at 95 % (Hanley and
    Lippman-Hand 1983, "If nothing goes wrong, is everything all right?"). Those clusters change by the outcome's whole
    range at most, up or down.

    Args:
        change: Change that the clusters showed, in the unit of the outcome.
        largest: Range of the outcome, in its unit; 1 for failures.
        clusters: Number of clusters.
        level: Confidence level of the interval.
    """
    share = 1 - (1 - level) ** (1 / clusters)
    reach = max(largest, abs(change))  # a straight line through few values may be steeper than the range
    return change - share * (reach + change), change + share * (reach - change)


def there_are(count: int) -> str:
    """Returns how many there are of what was just named: `there is 1`, `there are 5`."""
    return f"there {'is' if count == 1 else 'are'} {count:,}"


def within(values: NDArray[np.float64], jobs: NDArray[np.int64]) -> NDArray[np.float64]:
    """Returns the values less the mean of the values of the same job."""
    numbers = np.unique(jobs, return_inverse=True)[1]
    return values - (np.bincount(numbers, weights=values) / np.bincount(numbers))[numbers]


def varying(evidence: Evidence) -> Iterator[AxisColumn]:
    """Yields the axes that have several values in some job."""
    for axis in evidence.axes:
        pairs = np.unique(np.stack([evidence.jobs, axis.codes]), axis=1)[0]
        if (np.bincount(pairs) > 1).any():
            yield axis
