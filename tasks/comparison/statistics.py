"""The statistics of pairs: the exact McNemar test, intervals of differences, and how many pairs it takes.

Pure functions. Of scipy only the distributions in `scipy.special` are used: `scipy.stats` takes a second to import.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import bdtr, ndtri, stdtrit

from ..reporting import wilson_interval


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


def pairs_needed(discordant: float, difference: float, alpha: float = 0.05, power: float = 0.8) -> int:
    """How many pairs show a difference of pass rates, by the formula of Connor.

    n = (z_(1-alpha/2) √ψ + z_power √(ψ - δ²))² / δ², with ψ the share of pairs that differ and δ the difference of the
    rates; Connor, "Sample size for testing differences in proportions for the paired-sample design", Biometrics 43
    (1987). It is an approximation: the exact test asks for somewhat more where few pairs differ.

    Args:
        discordant: share of pairs whose verdicts differ, ψ; at least the difference.
        difference: difference of the pass rates, δ, of either sign.
        alpha: error probability of the two-sided test.
        power: probability with which the difference is to be shown.

    Raises:
        ValueError: the difference is 0 or larger than the share of pairs that differ, or that is larger than 1.
    """
    if not 0 < abs(difference) <= discordant <= 1:
        raise ValueError(f"a difference of {difference} with {discordant} of pairs that differ cannot be")
    spread = math.sqrt(max(0.0, discordant - difference**2))
    root = float(ndtri(1 - alpha / 2)) * math.sqrt(discordant) + float(ndtri(power)) * spread
    # Without the last digits, which are rounding, 100 would become 101.
    return math.ceil(round((root / difference) ** 2, 9))


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
