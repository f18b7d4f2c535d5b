"""Permutation test that flips the signs of whole worlds' differences: its p-value, and how many worlds it needs."""

import math
from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from .bisection import first_that_holds

_DRAWS = 2000
"""Number of simulated comparisons for each number of worlds: the power is accurate to 2 points (two standard errors).
"""

_ENUMERATED_WORLDS = 10
"""Number of worlds up to which all signs (1,024) are tried; above, the normal approximation is accurate to 0.5 points.
"""

_SIMULATED_WORLDS = 2000


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
        difference: Difference of the pass rates that is to be shown, above 0.
        chance: Random generator.
        discordant: Share of pairs whose verdicts differ, at least the difference; used if nothing is known of the
            worlds.
        alpha: Error probability of the two-sided test.
        power: Probability with which the difference is to be shown.
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
        worlds: Number of worlds.
        discordant: Share of pairs whose verdicts differ; at least the difference.
        difference: Difference of the pass rates.
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
