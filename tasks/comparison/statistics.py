"""Statistics of pairs: tests, confidence intervals, and how many pairs or worlds would show a difference."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr, gammaln, ndtr, ndtri, stdtrit, xlog1py, xlogy

from ..results.rates import wilson_interval


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


def mcnemar_p_value(worse: int, better: int) -> float:
    """Computes the two-sided p-value of the exact McNemar test, a sign test of the pairs that differ.

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


def holm_adjusted(p_values: Sequence[float]) -> list[float]:
    """Adjusts the p-values of several tests by Holm's method, so that all of them together have the error of one.

    Holm, "A simple sequentially rejective multiple test procedure", Scandinavian Journal of Statistics 6 (1979).

    Args:
        p_values: p-value of each test.

    Returns:
        The adjusted ones in the same order, each at least the given one and at most 1.
    """
    adjusted = [1.0] * len(p_values)
    largest = 0.0
    for rank, place in enumerate(sorted(range(len(p_values)), key=p_values.__getitem__)):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[place]))
        adjusted[place] = largest
    return adjusted


def paired_rate_difference(both: int, worse: int, better: int, neither: int, alpha: float = 0.05) -> Interval:
    """Computes the difference of two paired pass rates (after minus before) with its confidence interval.

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
    """Computes the correlation of passing before and after; a positive one with Newcombe's continuity correction."""
    margins = (both + worse) * (better + neither) * (both + better) * (worse + neither)
    if not margins:
        return 0.0
    product = float(both * neither - worse * better)
    half = (both + worse + better + neither) / 2
    return (max(product - half, 0.0) if product > 0 else product) / math.sqrt(margins)


def sign_flip_p_value(differences: Sequence[int]) -> float:
    """Computes the two-sided p-value of the permutation test that flips the signs of whole worlds' differences.

    If the runs do not differ, each world's difference is as likely with the other sign. All 2**worlds signs are
    counted, by the characteristic function of their sum, which is a product of cosines; accurate to 1e-12.

    Args:
        differences: Number of trials that got better minus number that got worse, for each world.

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
    """Computes powers by squaring, which is 50 times as fast as NumPy's power of floats."""
    found = np.ones_like(values)
    while exponent:
        if exponent & 1:
            found *= values
        values = values * values
        exponent >>= 1
    return found


def clustered_mean(sums: NDArray[np.float64], counts: NDArray[np.float64], alpha: float = 0.05) -> Interval:
    """Computes the mean over trials grouped in worlds, with a confidence interval for clustered data.

    The variance is that of a ratio estimator between worlds, with a t distribution of worlds - 1 degrees of freedom.

    Args:
        sums: sum of the values in each of at least two worlds.
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


_EXACT_UP_TO = 20_000
"""Number of pairs up to which power is computed exactly; there, Connor's formula is 0.1 % too small and falling."""
_DRAWS = 2000
"""Number of simulated comparisons for each number of worlds: the power is accurate to 2 points (two standard errors).
"""
_ENUMERATED_WORLDS = 10
"""Number of worlds up to which all signs (1,024) are tried; above, the normal approximation is accurate to 0.5 points.
"""
_SIMULATED_WORLDS = 2000


def mcnemar_power(pairs: int, discordant: float, difference: float, alpha: float) -> float:
    """Computes the power of the exact McNemar test: the probability that it detects a difference of pass rates.

    Args:
        pairs: number of pairs.
        discordant: share of pairs whose verdicts differ, above 0.
        difference: difference of the pass rates, at most `discordant`.
        alpha: error probability of the two-sided test.
    """
    reach = 8 * math.sqrt(pairs * discordant * (1 - discordant)) + 8  # what lies outside is below 1e-14
    middle = pairs * discordant
    differ = np.arange(max(0, math.floor(middle - reach)), min(pairs, math.ceil(middle + reach)) + 1)
    choose = gammaln(pairs + 1) - gammaln(differ + 1) - gammaln(pairs - differ + 1)
    chance = np.exp(choose + xlogy(differ, discordant) + xlog1py(pairs - differ, -discordant))
    most = _most_of_fewer(differ, alpha)
    share = (discordant + abs(difference)) / (2 * discordant)
    tails = bdtr(np.maximum(most, 0), differ, share) + bdtr(np.maximum(most, 0), differ, 1 - share)
    return float((chance * np.where(most >= 0, tails, 0.0)).sum())


def mcnemar_pairs_needed(discordant: float, difference: float, alpha: float = 0.05, power: float = 0.8) -> int:
    """Computes the number of pairs that the exact McNemar test needs to detect a difference of pass rates.

    Args:
        discordant: share of pairs whose verdicts differ; at least the difference.
        difference: difference of the pass rates, of either sign.
        alpha: error probability of the two-sided test.
        power: probability with which the difference is to be shown.

    Raises:
        ValueError: the difference is 0 or larger than the share of pairs that differ, or that is larger than 1.
    """
    if not 0 < abs(difference) <= discordant <= 1:
        raise ValueError(f"a difference of {difference} with {discordant} of pairs that differ cannot be")
    approximate = _connor(discordant, difference, alpha, power)
    if approximate > _EXACT_UP_TO:
        return approximate
    return first_that_holds(lambda pairs: mcnemar_power(pairs, discordant, difference, alpha) >= power, approximate)


def worlds_needed(
    differences: NDArray[np.float64],
    trials: float,
    difference: float,
    chance: np.random.Generator,
    *,
    discordant: float = 0.0,
    alpha: float = 0.05,
    power: float = 0.8,
) -> int:
    """Computes the number of worlds that the sign-flip test needs to detect a difference of pass rates.

    Comparisons are simulated: worlds are drawn from the known ones, shifted so that their mean is the difference.

    Args:
        differences: Difference of the pass rates in each known world.
        trials: Number of trials in a world.
        difference: difference of the pass rates that is to be shown, above 0.
        chance: Random generator.
        discordant: Share of pairs whose verdicts differ, at least the difference; used if nothing is known of the
            worlds.
        alpha: error probability of the two-sided test.
        power: probability with which the difference is to be shown.
    """
    spread = differences - differences.mean()
    sizes = max(1, round(trials))
    discordant = max(discordant, difference)

    def draw(worlds: int) -> NDArray[np.float64]:
        if not spread.any():  # nothing is known of how worlds differ: each trial by itself
            return changes_of_worlds(sizes, worlds, discordant, difference, chance)
        return (difference + chance.choice(spread, (_DRAWS, worlds))).astype(np.float64)

    def shows(worlds: int) -> bool:
        if worlds > _SIMULATED_WORLDS:
            deviation = max(float(spread.std()), math.sqrt(discordant / sizes))
            return float(ndtr(math.sqrt(worlds) * difference / deviation + ndtri(alpha / 2))) >= power
        return float((_sign_flip_p_values(draw(worlds)) <= alpha).mean()) >= power

    return first_that_holds(shows, 8)


def changes_of_worlds(
    trials: int, worlds: int, discordant: float, difference: float, chance: np.random.Generator
) -> NDArray[np.float64]:
    """Draws changes of pass rates in worlds whose trials are independent of each other.

    Args:
        trials: Number of trials in a world.
        worlds: number of worlds.
        discordant: share of pairs whose verdicts differ; at least the difference.
        difference: difference of the pass rates.
        chance: Random generator.

    Returns:
        Rows of 2,000 simulated comparisons with a column for each world.
    """
    better = (discordant + difference) / 2
    up = chance.binomial(trials, better, (_DRAWS, worlds))
    down = chance.binomial(trials - up, (discordant - difference) / 2 / (1 - better) if better < 1 else 0.0)
    return (up - down) / trials


def _sign_flip_p_values(drawn: NDArray[np.float64]) -> NDArray[np.float64]:
    """Computes the sign-flip p-values of comparisons: one per row, with a column for each world."""
    worlds = drawn.shape[1]
    sums = np.abs(drawn.sum(axis=1))
    if worlds <= _ENUMERATED_WORLDS:
        signs = np.array(list(product((-1.0, 1.0), repeat=worlds)))
        return (np.abs(drawn @ signs.T) >= sums[:, None] - 1e-9).mean(axis=1)
    spread = np.sqrt((drawn**2).sum(axis=1))
    return 2 * ndtr(-sums / np.where(spread > 0, spread, np.inf))


def _most_of_fewer(differ: NDArray[np.int_], alpha: float) -> NDArray[np.int_]:
    """Returns the largest number of pairs in the rarer direction at which the test is significant; -1: none."""
    most = np.minimum(np.floor(differ / 2 + ndtri(alpha / 2) * np.sqrt(differ) / 2).astype(int) + 2, differ)
    while (too_many := (most >= 0) & (2 * bdtr(np.maximum(most, 0), differ, 0.5) > alpha)).any():
        most = np.where(too_many, most - 1, most)
    return most


def _connor(discordant: float, difference: float, alpha: float, power: float) -> int:
    """Computes the number of pairs by Connor's formula, Biometrics 43 (1987), which is too small for few pairs."""
    spread = math.sqrt(max(0.0, discordant - difference**2))
    root = float(ndtri(1 - alpha / 2)) * math.sqrt(discordant) + float(ndtri(power)) * spread
    return math.ceil(round((root / difference) ** 2, 9))


def first_that_holds(holds: Callable[[int], bool], start: int) -> int:
    """Finds the smallest number from which a condition holds, by bisection; it has to hold for all larger numbers.

    Args:
        holds: Condition on a number.
        start: Number that is tried first.
    """
    low, high = 0, max(1, start)
    while not holds(high):
        low, high = high, high * 2
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high
