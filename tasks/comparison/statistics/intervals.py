"""Confidence intervals of paired differences: of pass rates, of means, and of means over trials grouped in worlds."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from ...results.rates import wilson_interval


@dataclass(frozen=True)
class Interval:
    """An estimate with its confidence interval."""

    value: float
    low: float
    high: float

    @property
    def leaves_out_zero(self) -> bool:
        """Whether 0 is outside the confidence interval, so that the estimate is significant."""
        return self.low > 0 or self.high < 0


def paired_rate_difference(both: int, worse: int, better: int, neither: int, alpha: float = 0.05) -> Interval:
    """Computes the difference of two paired pass rates (after minus before) with its confidence interval.

    The interval is method 10 of Newcombe, "Improved confidence intervals for the difference between binomial
    proportions based on paired data", Statistics in Medicine 17 (1998): Wilson's intervals of both rates, put together
    with the correlation of the pairs. It has a width also when no pair differs.

    Args:
        both: Pairs that passed before and after.
        worse: Pairs that passed before and not after.
        better: Pairs that passed after and not before.
        neither: Pairs that passed neither before nor after.
        alpha: 1 minus the confidence level.

    Raises:
        ValueError: There are no pairs, or a number is negative.
    """
    pairs = both + worse + better + neither
    if pairs < 1 or min(both, worse, better, neither) < 0:
        raise ValueError(f"pairs are {both}, {worse}, {better}, {neither}; numbers from 0 with a sum from 1 are right")
    quantile = float(ndtri(1 - alpha / 2))
    passed_after, passed_before = both + better, both + worse
    after, before = passed_after / pairs, passed_before / pairs
    low_after, high_after = wilson_interval(passed_after, pairs, quantile)
    low_before, high_before = wilson_interval(passed_before, pairs, quantile)
    correlation = _correlation(both, worse, better, neither)

    def reach(first: float, second: float) -> float:
        return math.sqrt(max(0.0, first**2 - 2 * correlation * first * second + second**2))

    difference = after - before
    return Interval(
        difference,
        difference - reach(after - low_after, high_before - before),
        difference + reach(high_after - after, before - low_before),
    )


def _correlation(both: int, worse: int, better: int, neither: int) -> float:
    """Computes the correlation of passing before and after; a positive one with Newcombe's continuity correction."""
    margins = (both + worse) * (better + neither) * (both + better) * (worse + neither)
    if not margins:
        return 0.0
    product = float(both * neither - worse * better)
    half = (both + worse + better + neither) / 2
    return (max(product - half, 0.0) if product > 0 else product) / math.sqrt(margins)


def clustered_mean(sums: NDArray[np.float64], counts: NDArray[np.float64], alpha: float = 0.05) -> Interval:
    """Computes the mean over trials grouped in worlds, with a confidence interval for clustered data.

    The variance is that of a ratio estimator between worlds, with a t distribution of worlds - 1 degrees of freedom.

    Args:
        sums: Sum of the values in each of at least two worlds.
        counts: Number of trials in each world.
        alpha: 1 minus the confidence level.
    """
    worlds, total = len(sums), float(counts.sum())
    mean = float(sums.sum()) / total
    variance = worlds / (worlds - 1) * float(((sums - mean * counts) ** 2).sum()) / total**2
    reach = float(stdtrit(worlds - 1, 1 - alpha / 2)) * math.sqrt(variance)
    return Interval(mean, mean - reach, mean + reach)


def mean_difference(differences: Sequence[float], alpha: float = 0.05) -> Interval:
    """Computes the mean of paired differences with the confidence interval of the paired t test.

    Differences that are all the same have an interval without width.

    Args:
        differences: After minus before, of at least two pairs.
        alpha: 1 minus the confidence level.

    Raises:
        ValueError: There are fewer than two.
    """
    count = len(differences)
    if count < 2:
        raise ValueError(f"{count} differences; an interval takes at least 2")
    values = np.asarray(differences, dtype=float)
    if values.min() == values.max():  # rounding would give them a spread
        return Interval(float(values[0]), float(values[0]), float(values[0]))
    mean = float(values.mean())
    reach = float(stdtrit(count - 1, 1 - alpha / 2)) * float(values.std(ddof=1)) / math.sqrt(count)
    return Interval(mean, mean - reach, mean + reach)
