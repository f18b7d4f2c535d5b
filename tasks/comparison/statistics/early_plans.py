"""Number of pairs with which a run beside an earlier one (`run --against`) is decided, by the evidence that decides it.

With single pairs the evidence depends on how many got better and how many worse, and on nothing else. So the chance
that it was ever enough is computed exactly, pair by pair. Where whole worlds decide, runs are simulated.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, xlog1py, xlogy

from .e_processes import fewest_pairs, fewest_worlds, mixed, sign_wealth, threshold

Numbers = NDArray[np.float64]

MOST_EXACT = 20_000
"""Pairs up to which chances are computed: time grows with their square."""
_MOST_WORLDS = 4_000
_RUNS, _RUNS_AT_ONCE = 2_000, 200
_SEED = 38  # the same question gets the same answer
_HALF = 0.5
_SPREAD = 8.0
"""Standard deviations of the number of differing pairs, beyond which it is not looked at: less than one in 10^14."""


@dataclass(frozen=True)
class EarlyPlan:
    """Pairs, or worlds, after which a run beside an earlier one is decided with a given chance, and in the median."""

    needed: int
    median: int


def pairs_until_decided(difference: float, discordant: float, alpha: float, power: float) -> EarlyPlan | None:
    """Computes after how many single pairs a run is rightly decided; None: after too many, or mostly never.

    Args:
        difference: Difference of the pass rates, a share above 0.
        discordant: Share of pairs whose verdicts differ, at least the difference.
        alpha: Error probability of all answers together.
        power: Chance that it is decided by then.
    """
    pairs, gains = fewest_pairs(alpha), (discordant + difference) / (2 * discordant)
    up, down = (sign_wealth(np.array([sign]))[0] for sign in (1.0, -1.0))
    if (gains * up + (1 - gains) * down).max() <= 0:
        return None  # each bet loses in the long run
    while pairs <= MOST_EXACT:
        most = min(pairs, math.ceil(discordant * pairs + _SPREAD * math.sqrt(pairs * discordant) + _SPREAD))
        decided = _decided_by(most, gains, alpha)
        if _chance(pairs, discordant, decided) >= power:
            return EarlyPlan(*(_fewest(pairs, discordant, decided, each) for each in (power, _HALF)))
        pairs *= 2
    return None


def _decided_by(most: int, gains: float, alpha: float) -> Numbers:
    """Returns the chance that the evidence was enough by each number of differing pairs, from 0 to the most.

    Args:
        most: Largest number of differing pairs.
        gains: Share of them that get better.
        alpha: Error probability of all answers together.
    """
    enough = threshold(alpha)
    up, down = (sign_wealth(np.array([sign]))[0] for sign in (1.0, -1.0))
    waiting = np.zeros(most + 1)
    waiting[0] = 1.0  # by number of gains
    decided = np.zeros(most + 1)
    for differ in range(1, most + 1):
        waiting[1 : differ + 1] = waiting[1 : differ + 1] * (1 - gains) + waiting[:differ] * gains
        waiting[0] *= 1 - gains
        better = np.arange(differ + 1)[:, None]
        worse = differ - better
        is_better = mixed(better * up + worse * down) >= enough
        is_worse = mixed(worse * up + better * down) >= enough
        alive = waiting[: differ + 1]
        decided[differ] = decided[differ - 1] + alive[is_better].sum()
        alive[is_better | is_worse] = 0.0
    return decided


def _chance(pairs: int, discordant: float, decided: Numbers) -> float:
    """Returns the chance of a decision by a number of pairs, of which a binomial number differ."""
    differ = np.arange(min(pairs + 1, len(decided)))
    logs = gammaln(pairs + 1) - gammaln(differ + 1) - gammaln(pairs - differ + 1)
    logs += xlogy(differ, discordant) + xlog1py(pairs - differ, -discordant)
    return float(np.exp(logs) @ decided[: len(differ)])


def _fewest(enough: int, discordant: float, decided: Numbers, chance: float) -> int:
    """Returns the smallest number of pairs whose chance of a decision is at least the given one; `enough` has to do."""
    low, high = 0, enough
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if _chance(middle, discordant, decided) >= chance else (middle, high)
    return high


def worlds_until_decided(
    difference: float, discordant: float, each: float, alpha: float, power: float
) -> EarlyPlan | None:
    """Simulates after how many worlds a run is rightly decided, whose trials are no more alike than others.

    Args:
        difference: Difference of the pass rates, a share above 0.
        discordant: Share of pairs whose verdicts differ, at least the difference.
        each: Trials in each world.
        alpha: Error probability of all answers together.
        power: Chance that it is decided by then; two standard errors of the simulation come on top.

    Returns:
        Worlds, at least as many as make whole worlds decide; None: there are too many to be simulated.
    """
    chance, worlds = np.random.default_rng(_SEED), 4 * fewest_worlds(alpha)
    safe = power + 2 * math.sqrt(power * (1 - power) / _RUNS)
    shares = [(discordant + difference) / 2, (discordant - difference) / 2, 1 - discordant]
    while worlds <= _MOST_WORLDS:
        stops: list[NDArray[np.int64]] = []
        for _ in range(_RUNS // _RUNS_AT_ONCE):
            drawn = chance.multinomial(max(1, round(each)), shares, (_RUNS_AT_ONCE, worlds))
            nets = (drawn[..., 0] - drawn[..., 1]).astype(np.float64)
            enough = mixed(sign_wealth(nets)) >= threshold(alpha)
            stops.append(np.where(enough.any(axis=1), enough.argmax(axis=1) + 1, worlds + 1))
        found = np.sort(np.concatenate(stops))
        needed, median = (int(found[math.ceil(share * _RUNS) - 1]) for share in (safe, _HALF))
        if needed <= worlds:
            return EarlyPlan(max(needed, fewest_worlds(alpha)), max(median, fewest_worlds(alpha)))
        worlds *= 2
    return None
