"""Exact McNemar test of pairs that differ: its p-value, its power, and the number of pairs that it needs."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr, gammaln, ndtri, xlog1py, xlogy

from .bisection import first_that_holds

_EXACT_UP_TO = 20_000
"""Number of pairs up to which power is computed exactly; there, Connor's formula is 0.1 % too small and falling."""


def mcnemar_p_value(worse: int, better: int) -> float:
    """Computes the two-sided p-value of the exact McNemar test, a sign test of the pairs that differ.

    Args:
        worse: Pairs that passed before and not after.
        better: Pairs that passed after and not before.

    Returns:
        Twice the smaller tail of the binomial distribution with probability 1/2, at most 1; 1 when no pair differs.

    Raises:
        ValueError: A number is negative.
    """
    if min(worse, better) < 0:
        raise ValueError(f"{worse} and {better} pairs that differ; numbers from 0 were expected")
    return min(1.0, 2.0 * float(bdtr(min(worse, better), worse + better, 0.5))) if worse + better else 1.0


def fewest_pairs(alpha: float) -> int:
    """Returns the smallest number of pairs that can show a difference: if all of them differ the same way."""
    return math.ceil(1 - math.log2(alpha))


def mcnemar_power(pairs: int, discordant: float, difference: float, alpha: float) -> float:
    """Computes the power of the exact McNemar test: the probability that it detects a difference of pass rates.

    Args:
        pairs: Number of pairs.
        discordant: Share of pairs whose verdicts differ, above 0.
        difference: Difference of the pass rates, at most `discordant`.
        alpha: Error probability of the two-sided test.
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
        discordant: Share of pairs whose verdicts differ; at least the difference.
        difference: Difference of the pass rates, of either sign.
        alpha: Error probability of the two-sided test.
        power: Probability with which the difference is to be shown.

    Raises:
        ValueError: The difference is 0 or larger than the share of pairs that differ, or that is larger than 1.
    """
    if not 0 < abs(difference) <= discordant <= 1:
        raise ValueError(f"a difference of {difference} with {discordant} of pairs that differ cannot be")
    approximate = _connor(discordant, difference, alpha, power)
    if approximate > _EXACT_UP_TO:
        return approximate
    return first_that_holds(lambda pairs: mcnemar_power(pairs, discordant, difference, alpha) >= power, approximate)


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
