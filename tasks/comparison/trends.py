"""Margins that shrink from night to night: told before a requirement is missed, and seldom where they only scatter.

A straight line is fitted through the last 5, 8 and 12 nights. It is told where its slope is too steep for chance, and
where it reaches 0 within two weeks.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...schemas.reports.changes import MarginTrend
from ..results.rates import margin_units
from .compared_runs import NightRun

WINDOWS = (5, 8, 12)
"""Numbers of nights through which lines are fitted: short ones notice a new trend, long ones a slow one."""

LEVEL = 0.0015
"""Largest one-sided p-value of a slope that is told, shared by the requirements of a run.

Twenty nights are looked at with three windows each. Simulated with margins that scatter round a constant (normal, t
with 4 degrees of freedom, Gumbel; 20,000 series each), at most 4.3 % of series of 20 nights are told of anything.
"""

HORIZON = 14
"""Nights within which the line has to reach 0: a slower one gives time to see it again."""


@dataclass(frozen=True)
class Lines:
    """The told line of each series, of its longest window that tells one, as arrays with one entry for each."""

    told: NDArray[np.bool_]
    """Whether a line is told."""
    slope: NDArray[np.float64]
    """Change of the margin from night to night, in its unit; meaningless where none is told."""
    nights: NDArray[np.int64]
    """Number of nights of its window."""
    left: NDArray[np.float64]
    """Nights from the last one until the line reaches 0."""


def shrinking(margins: NDArray[np.float64], requirements: int = 1) -> Lines:
    """Tells whether margins shrink so that they will be missed, as seen at the last night.

    Args:
        margins: margins by night along the last axis, the oldest first, any unit.
        requirements: how many series are looked at in one run, which share the level.

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
    """Slope of the least-squares line, nights until it reaches 0, and the chance of such a slope without a trend."""
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

    Nights count that judged a requirement as often as the last one: the smallest of more margins is smaller.

    Args:
        runs: runs of one specification, the oldest first; at least one.

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
    """The smallest margin of a requirement in one run."""

    margin: float
    unit: str | None
    judged: int

    def alike(self, other: "_Smallest") -> bool:
        """Whether both are of as many trials, in the same unit."""
        return (self.unit, self.judged) == (other.unit, other.judged)


def _smallest(run: NightRun) -> dict[str, _Smallest]:
    """The smallest margin of each requirement that has one unit and finite margins."""
    found: dict[str, _Smallest] = {}
    for name, units in margin_units(run.results).items():
        margins = run.results.numbers(f"margin.{name}")[run.results.met(name) >= 0]
        margins = margins[np.isfinite(margins)]
        if len(units) == 1 and len(margins):
            [unit] = units
            found[name] = _Smallest(float(margins.min()), unit, len(margins))
    return found
