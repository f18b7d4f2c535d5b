"""The number of pairs, or worlds, that would show a difference: from the power of the test that decides.

Pure functions; chance is passed in.
"""

import math
from collections.abc import Callable
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr, gammaln, ndtr, ndtri, xlog1py, xlogy

_EXACT_UP_TO = 20_000
"""Pairs up to which power is computed exactly; there, Connor's formula is 0.1 % too small and falling."""
_DRAWS = 2000
"""Simulated comparisons for each number of worlds: the power is right within 2 points (two standard errors)."""
_ENUMERATED_WORLDS = 10
"""Worlds up to which all signs are tried, 1,024 times; above, the normal distribution is right within 0.5 points."""
_SIMULATED_WORLDS = 2000


def mcnemar_power(pairs: int, discordant: float, difference: float, alpha: float) -> float:
    """The probability with which the exact McNemar test shows a difference of pass rates, in either direction.

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
    """The number of pairs with which the exact McNemar test shows a difference of pass rates.

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
    return _first(lambda pairs: mcnemar_power(pairs, discordant, difference, alpha) >= power, approximate)


def worlds_needed(
    differences: NDArray[np.float64],
    trials: float,
    difference: float,
    chance: np.random.Generator,
    *,
    alpha: float = 0.05,
    power: float = 0.8,
) -> int:
    """The number of worlds with which flipping the signs of whole worlds shows a difference of pass rates.

    Comparisons are simulated: worlds are drawn from those there are, moved so that their mean is the difference.

    Args:
        differences: difference of the pass rates in each world there is.
        trials: trials in a world.
        difference: difference of the pass rates that is to be shown, above 0.
        chance: what draws them.
        alpha: error probability of the two-sided test.
        power: probability with which the difference is to be shown.
    """
    spread = differences - differences.mean()

    def draw(worlds: int) -> NDArray[np.float64]:
        if not spread.any():  # nothing is known of how worlds differ: each trial by itself
            return chance.binomial(max(1, round(trials)), difference, (_DRAWS, worlds)) / max(1.0, trials)
        return (difference + chance.choice(spread, (_DRAWS, worlds))).astype(np.float64)

    def shows(worlds: int) -> bool:
        if worlds > _SIMULATED_WORLDS:
            deviation = max(float(spread.std()), math.sqrt(difference / max(1.0, trials)))
            return float(ndtr(math.sqrt(worlds) * difference / deviation + ndtri(alpha / 2))) >= power
        return float((_sign_flip_p_values(draw(worlds)) <= alpha).mean()) >= power

    return _first(shows, 8)


def _sign_flip_p_values(drawn: NDArray[np.float64]) -> NDArray[np.float64]:
    """P-values of comparisons, one a row, with a column for each world."""
    worlds = drawn.shape[1]
    sums = np.abs(drawn.sum(axis=1))
    if worlds <= _ENUMERATED_WORLDS:
        signs = np.array(list(product((-1.0, 1.0), repeat=worlds)))
        return (np.abs(drawn @ signs.T) >= sums[:, None] - 1e-9).mean(axis=1)
    spread = np.sqrt((drawn**2).sum(axis=1))
    return 2 * ndtr(-sums / np.where(spread > 0, spread, np.inf))


def _most_of_fewer(differ: NDArray[np.int_], alpha: float) -> NDArray[np.int_]:
    """The most pairs in the rarer direction with which the test shows a difference; -1: none."""
    most = np.minimum(np.floor(differ / 2 + ndtri(alpha / 2) * np.sqrt(differ) / 2).astype(int) + 2, differ)
    while (too_many := (most >= 0) & (2 * bdtr(np.maximum(most, 0), differ, 0.5) > alpha)).any():
        most = np.where(too_many, most - 1, most)
    return most


def _connor(discordant: float, difference: float, alpha: float, power: float) -> int:
    """The number of pairs by Connor's formula, Biometrics 43 (1987), which is too small where there are few pairs."""
    spread = math.sqrt(max(0.0, discordant - difference**2))
    root = float(ndtri(1 - alpha / 2)) * math.sqrt(discordant) + float(ndtri(power)) * spread
    return math.ceil(round((root / difference) ** 2, 9))


def _first(holds: Callable[[int], bool], start: int) -> int:
    """A number from which on something holds, by halving; it has to hold for all larger ones."""
    low, high = 0, max(1, start)
    while not holds(high):
        low, high = high, high * 2
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high
