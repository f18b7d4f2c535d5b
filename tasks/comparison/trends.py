"""Detection of margins that shrink from run to run, before a requirement is missed and with few false alarms.

A straight line is fitted through the last 5, 8 and 12 runs. It is reported if its slope is too steep for chance, and if
it reaches 0 within the next 14 runs.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...schemas.reports.changes import MarginTrend
from ..results.rates import margin_units
from .compared_runs import NightRun

WINDOWS = (5, 8, 12)
"""Numbers of runs through which lines are fitted: short windows detect new trends, long ones slow trends."""

LEVEL = 0.0015
"""Largest one-sided p-value of a reported slope, shared by the requirements of a run.

Twenty runs are tested with three windows each. In simulations with constant margins plus noise (normal, t with 4
degrees of freedom, Gumbel; 20,000 series each), at most 4.3 % of series of 20 runs had any report.
"""

HORIZON = 14
"""Number of runs within which the line has to reach 0; a slower trend can still be reported later."""


@dataclass(frozen=True)
class Lines:
    """Reported trend line of each series, of its longest window that has one, as arrays."""

    told: NDArray[np.bool_]
    """Mask of the series with a reported line."""
    slope: NDArray[np.float64]
    """Change of the margin per run, in its unit; meaningless without a reported line."""
    nights: NDArray[np.int64]
    """Number of runs in the window."""
    left: NDArray[np.float64]
    """Number of runs after the last one until the line reaches 0."""


def shrinking(margins: NDArray[np.float64], requirements: int = 1) -> Lines:
    """Detects margins that shrink so that their requirements will be missed, as seen at the last run.

    Args:
        margins: Margins by run along the last axis, the oldest first, in any unit.
        requirements: Number of series that are tested in one run, which share the level.

    Returns:
        The line of each series, by the longest window that tells one.
    """
    shape = margins.shape[:-1]
    found = Lines(np.zeros(shape, bool), np.zeros(shape), np.zeros(shape, np.int64), np.full(shape, np.inf))
    for window in WINDOWS:
        if margins.shape[-1] < window:
            break
        slope, left, p_value = _line(margins[..., -window:])
        told = (p_value <= LEVEL / requirements) & (left <= HORIZON) & (margins[..., -1] >= 0)
        found = Lines(
            found.told | told,
            np.where(told, slope, found.slope),
            np.where(told, window, found.nights),
            np.where(told, left, found.left),
        )
    return found


def _line(margins: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Computes the slope of the least-squares line per run, the runs until it reaches 0, and the p-value of the slope.

    The number of runs is infinite where the line does not fall. The p-value is one-sided: small for falling margins.
    """
    from scipy.special import stdtr  # importing it is slow; most commands fit no lines

    count = margins.shape[-1]
    nights = np.arange(count) - (count - 1) / 2
    square = float((nights**2).sum())
    mean, slope = margins.mean(axis=-1), margins @ nights / square
    rest = margins - mean[..., None] - slope[..., None] * nights
    error = np.sqrt((rest**2).sum(axis=-1) / (count - 2) / square)
    with np.errstate(divide="ignore", invalid="ignore"):
        score = np.where(slope == 0, 0.0, slope / error)  # without scatter any slope is certain
        left = np.where(slope < 0, (mean + slope * nights[-1]) / -slope, np.inf)
    return slope, np.maximum(left, 0.0), np.asarray(stdtr(count - 2, score), dtype=np.float64)


def margin_trends(runs: Sequence[NightRun]) -> list[MarginTrend]:
    """Finds the requirements whose smallest margin shrinks steadily and that the last run still meets.

    Only runs that judged a requirement as often as the last run count: the smallest of more margins is smaller.

    Args:
        runs: Runs of one specification, the oldest first; at least one.

    Returns:
        Their trends, the soonest miss first.
    """
    last = _smallest(runs[-1])
    if not last or len(runs) < WINDOWS[0]:
        return []
    earlier = [_smallest(run) for run in runs[-max(WINDOWS) :][:-1]]
    found: list[MarginTrend] = []
    for name, now in last.items():
        alike = [each[name] for each in earlier if name in each and each[name].alike(now)]
        series = [*(each.margin for each in alike), now.margin]
        line = shrinking(np.array(series), len(last))
        if bool(line.told):
            told = series[-int(line.nights) :]
            found.append(
                MarginTrend(
                    name=name, unit=now.unit, margins=told, slope=float(line.slope), nights_left=float(line.left)
                )
            )
    return sorted(found, key=lambda each: each.nights_left)


@dataclass(frozen=True)
class _Smallest:
    """Smallest margin of a requirement in one run."""

    margin: float
    unit: str | None
    judged: int

    def alike(self, other: "_Smallest") -> bool:
        """Returns whether both are of the same number of trials, in the same unit."""
        return (self.unit, self.judged) == (other.unit, other.judged)


def _smallest(run: NightRun) -> dict[str, _Smallest]:
    """Returns the smallest margin of each requirement that has one unit and finite margins; others are left out."""
    found: dict[str, _Smallest] = {}
    for name, units in margin_units(run.results).items():
        margins = run.results.numbers(f"margin.{name}")[run.results.met(name) >= 0]
        margins = margins[np.isfinite(margins)]
        if len(units) == 1 and len(margins):
            [unit] = units
            found[name] = _Smallest(float(margins.min()), unit, len(margins))
    return found
