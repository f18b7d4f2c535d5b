"""The statistics of pairs: the exact McNemar test, the test that flips worlds, and intervals of differences.

Pure functions. Of scipy only the distributions in `scipy.special` are used: `scipy.stats` takes a second to import.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr, ndtri, stdtrit

from ..results.intervals import wilson_interval


@dataclass(frozen=True)
class Interval:
    """An estimate with its interval."""

    value: float
    low: float
    high: float

    @property
    def leaves_out_zero(self) -> bool:
        """Whether 0 is not in it."""
        return self.low > 0 or self.high < 0


def mcnemar_p_value(worse: int, better: int) -> float:
    """The two-sided p-value of the exact McNemar test, which is a sign test of the pairs that differ.

    Args:
        worse: pairs that passed before and not after.
        better: pairs that passed after and not before.

    Returns:
        Twice the smaller tail of the binomial distribution with probability 1/2, at most 1; 1 when no pair differs.

    Raises:
        ValueError: a number is negative.
    """
    if min(worse, better) < 0:
        raise ValueError(f"{worse} and {better} pairs that differ; numbers from 0 were expected")
    return min(1.0, 2.0 * float(bdtr(min(worse, better), worse + better, 0.5))) if worse + better else 1.0


def paired_rate_difference(both: int, worse: int, better: int, neither: int, alpha: float = 0.05) -> Interval:
    """The difference of two pass rates of the same jobs, after minus before, with its interval.

    The interval is method 10 of Newcombe, "Improved confidence intervals for the difference between binomial
    proportions based on paired data", Statistics in Medicine 17 (1998): Wilson's intervals of both rates, put together
    with the correlation of the pairs. It has a width also when no pair differs.

    Args:
        both: pairs that passed before and after.
        worse: pairs that passed before and not after.
        better: pairs that passed after and not before.
        neither: pairs that passed neither before nor after.
        alpha: 1 minus the confidence level.

    Raises:
        ValueError: there are no pairs, or a number is negative.
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
    """The correlation of pass before and pass after; a positive one with Newcombe's correction for continuity."""
    margins = (both + worse) * (better + neither) * (both + better) * (worse + neither)
    if not margins:
        return 0.0
    product = float(both * neither - worse * better)
    half = (both + worse + better + neither) / 2
    return (max(product - half, 0.0) if product > 0 else product) / math.sqrt(margins)


def sign_flip_p_value(differences: Sequence[int]) -> float:
    """The two-sided p-value of the test that flips the sign of whole worlds.

    Where the runs do not differ, each world's difference is as likely with the other sign. All 2**worlds signs are
    counted, by the characteristic function of their sum, which is a product of cosines; right to 1e-12.

    Args:
        differences: of each world, how many trials became better, minus how many became worse.

    Returns:
        The share of signs with which the sum is at least as far from 0; 1 when no world differs.
    """
    sizes = np.abs(np.asarray([each for each in differences if each], dtype=np.int64))
    reach, found = int(sizes.sum()), abs(int(sum(differences)))
    if not found:
        return 1.0
    points = 1 << (2 * reach + 1).bit_length()  # a power of two is quickly transformed
    angles = 2 * np.pi / points * np.arange(points // 2 + 1)
    sums = np.ones(len(angles))
    for size, count in zip(*np.unique(sizes, return_counts=True), strict=True):
        sums *= _power(np.cos(size * angles), int(count))
        sums[np.abs(sums) < 1e-100] = 0.0  # numbers near the smallest ones take a hundred times as long
    chances = np.fft.irfft(sums, points)
    return float(min(1.0, max(round(2 * chances[found : reach + 1].sum(), 12), 0.0)))


def _power(values: NDArray[np.float64], exponent: int) -> NDArray[np.float64]:
    """Powers by squaring, which is 50 times as fast as those of floats."""
    found = np.ones_like(values)
    while exponent:
        if exponent & 1:
            found *= values
        values = values * values
        exponent >>= 1
    return found


def clustered_mean(sums: NDArray[np.float64], counts: NDArray[np.float64], alpha: float = 0.05) -> Interval:
    """The mean of trials in several worlds, with an interval that knows that trials of one world are alike.

    The variance is that of a ratio estimator between worlds, with a t distribution of worlds - 1 degrees of freedom.

    Args:
        sums: sum of the values in each of at least two worlds.
        counts: how many trials each of them has.
        alpha: 1 minus the confidence level.
    """
    worlds, total = len(sums), float(counts.sum())
    mean = float(sums.sum()) / total
    variance = worlds / (worlds - 1) * float(((sums - mean * counts) ** 2).sum()) / total**2
    reach = float(stdtrit(worlds - 1, 1 - alpha / 2)) * math.sqrt(variance)
    return Interval(mean, mean - reach, mean + reach)


def mean_difference(differences: Sequence[float], alpha: float = 0.05) -> Interval:
    """The mean of paired differences with the interval of the paired t test.

    Differences that are all the same have an interval without width.

    Args:
        differences: after minus before, of at least two pairs.
        alpha: 1 minus the confidence level.

    Raises:
        ValueError: there are fewer than two.
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
