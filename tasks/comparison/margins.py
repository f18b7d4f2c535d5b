"""Non-inferiority test on pairs ("not worse by more than a margin"), its exact power, and the required numbers.

Tango, "Equivalence test and confidence interval for the difference in proportions for the paired-sample design",
Statistics in Medicine 17 (1998), has the score test. Its level was computed exactly for 20 to 400 pairs, margins of 5,
10 and 20 percentage points and all shares of differing pairs: at most 3.3 % with 20 pairs and 2.9 % from 40 on, for a
nominal level of 2.5 %.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, ndtr, ndtri, stdtrit, xlogy

from .statistics.bisection import first_that_holds
from .statistics.sign_flips import changes_of_worlds

_ENUMERATED_PAIRS = 3000
"""Number of pairs up to which power is summed over all tables (0.3 s); above, the normal approximation is accurate to a
point.
"""
_DRAWS = 2000
"""Number of simulated comparisons for each number of worlds: the power is accurate to 2 points (two standard errors).
"""
_SIMULATED_WORLDS = 2000


def score(pairs: int, worse: NDArray[np.float64], better: NDArray[np.float64], margin: float) -> NDArray[np.float64]:
    """Computes Tango's score of the hypothesis that the pass rate fell by the margin; large values speak against it.

    Args:
        pairs: Number of pairs.
        worse: Numbers of pairs that passed before and not after, any shape.
        better: Numbers of pairs that passed after and not before, of the same shape.
        margin: Relevant decrease of the pass rate, above 0 and below 1.

    Returns:
        Scores of that shape, standard normal where the pass rate fell by exactly the margin.
    """
    linear = -(worse + better) - (2 * pairs - better + worse) * margin
    root = np.sqrt(np.maximum(linear**2 - 8 * pairs * worse * margin * (1 + margin), 0.0))
    # The most likely share of pairs that got worse, if the pass rate fell by the margin.
    share = (root - linear) / (4 * pairs)
    variance = np.maximum(pairs * (2 * share - margin * (1 + margin)), np.finfo(float).tiny)
    return (better - worse + pairs * margin) / np.sqrt(variance)


def margin_p_value(pairs: int, worse: int, better: int, margin: float) -> float:
    """Computes the one-sided p-value of the test that the pass rate did not fall by the margin or more.

    Raises:
        ValueError: The margin is not between 0 and 1, or the numbers cannot be.
    """
    if not 0 < margin < 1 or min(worse, better) < 0 or worse + better > pairs or pairs < 1:
        raise ValueError(f"a margin of {margin} with {worse} and {better} of {pairs} pairs cannot be")
    return float(ndtr(-score(pairs, np.array(float(worse)), np.array(float(better)), margin)))


def margin_power(pairs: int, discordant: float, margin: float, alpha: float) -> float:
    """Computes the power of the margin test if the true pass rates are equal.

    Args:
        pairs: Number of pairs.
        discordant: Share of pairs whose verdicts differ, half of them in each direction; from 0 to 1.
        margin: Relevant decrease of the pass rate.
        alpha: Two-sided error probability; the test has half of it.
    """
    needed, half = -float(ndtri(alpha / 2)), discordant / 2
    if pairs > _ENUMERATED_PAIRS:
        spread = math.sqrt(max(discordant, margin * (1 - margin)) / pairs)
        return float(ndtr(margin / spread - needed))
    reach = 7 * math.sqrt(pairs * half * (1 - half)) + 7  # what lies outside is below 1e-11
    counts = np.arange(max(0, math.floor(pairs * half - reach)), min(pairs, math.ceil(pairs * half + reach)) + 1.0)
    worse, better = np.meshgrid(counts, counts)
    possible = worse + better <= pairs
    worse, better = worse[possible], better[possible]
    same = pairs - worse - better
    ways = gammaln(pairs + 1) - gammaln(worse + 1) - gammaln(better + 1) - gammaln(same + 1)
    chance = np.exp(ways + xlogy(worse + better, half) + xlogy(same, 1 - discordant))
    return float(chance[score(pairs, worse, better, margin) >= needed].sum())


def margin_pairs_needed(discordant: float, margin: float, alpha: float = 0.05, power: float = 0.8) -> int:
    """Computes the number of pairs that show, if nothing changed, that nothing got worse by more than the margin.

    Args:
        discordant: Share of pairs whose verdicts differ; from 0 to 1.
        margin: The fall of the pass rate that would matter.
        alpha: Two-sided error probability; the test has half of it.
        power: Probability with which it is to be shown.

    Raises:
        ValueError: The margin is not between 0 and 1, or the share not between 0 and 1.
    """
    if not 0 < margin < 1 or not 0 <= discordant <= 1:
        raise ValueError(f"a margin of {margin} with {discordant} of pairs that differ cannot be")
    start = math.ceil(max(discordant, margin) * ((float(ndtri(power)) - float(ndtri(alpha / 2))) / margin) ** 2)
    return first_that_holds(lambda pairs: margin_power(pairs, discordant, margin, alpha) >= power, start)


def shown_between_worlds(
    mean: NDArray[np.float64], error: NDArray[np.float64], worlds: int, margin: float, alpha: float
) -> NDArray[np.bool_]:
    """Tests whether the pass rate has fallen by less than the margin, from its mean change over several worlds.

    A few worlds with equal changes have no variance, but say nothing about other worlds: if one in ten fails
    completely, that is a decrease by 10 points. So the standard error counts as at least that of such a decrease,
    `sqrt(margin * (1 - margin) / worlds)`.

    Args:
        mean: Mean change of the pass rate, any shape.
        error: Standard error of the mean between worlds, of the same shape.
        worlds: Number of worlds, at least 2.
        margin: The fall of the pass rate that would matter.
        alpha: Two-sided error probability; the test has half of it.
    """
    least = math.sqrt(margin * (1 - margin) / worlds)
    return mean - float(stdtrit(worlds - 1, 1 - alpha / 2)) * np.maximum(error, least) > -margin


def margin_worlds_needed(
    differences: NDArray[np.float64],
    trials: float,
    margin: float,
    chance: np.random.Generator,
    *,
    discordant: float,
    alpha: float = 0.05,
    power: float = 0.8,
) -> int:
    """Computes the number of worlds that show, if nothing changed, that nothing got worse by more than the margin.

    Comparisons are simulated, and each is decided by the interval between worlds.

    Args:
        differences: Difference of the pass rates in each known world; if all are equal, their variance is unknown.
        trials: Number of trials in a world.
        margin: The fall of the pass rate that would matter.
        chance: Random generator.
        discordant: Share of pairs whose verdicts differ, used if nothing is known of the worlds.
        alpha: 1 minus the confidence level of the interval.
        power: Probability with which it is to be shown.
    """
    spread = differences - differences.mean()
    sizes = max(1, round(trials))

    def draw(worlds: int) -> NDArray[np.float64]:
        if not spread.any():
            return changes_of_worlds(sizes, worlds, discordant, 0.0, chance)
        return chance.choice(spread, (_DRAWS, worlds)).astype(np.float64)

    def shows(worlds: int) -> bool:
        if worlds < 2:
            return False  # there is no spread between worlds
        if worlds > _SIMULATED_WORLDS:
            deviation = max(float(spread.std()), math.sqrt(discordant / sizes), math.sqrt(margin * (1 - margin)))
            return float(ndtr(math.sqrt(worlds) * margin / deviation + ndtri(alpha / 2))) >= power
        drawn = draw(worlds)
        error = drawn.std(axis=1, ddof=1) / math.sqrt(worlds)
        return float(shown_between_worlds(drawn.mean(axis=1), error, worlds, margin, alpha).mean()) >= power

    return first_that_holds(shows, 8)
