"""Number of pairs with which a run beside an earlier one (`run --against`) is decided, by the evidence that decides it.

With single pairs the evidence depends on how many got better and how many worse, and on nothing else. So the chance
that it was ever enough is computed exactly, pair by pair. Where whole worlds decide, or a margin is asked for, whose
evidence depends on the order of the pairs, runs are simulated.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, xlog1py, xlogy

from .e_processes import fewest_pairs, fewest_worlds, margin_wealth, mixed, sign_wealth, threshold

Numbers = NDArray[np.float64]

MOST_EXACT = 20_000
"""Pairs up to which chances are computed: time grows with their square."""
_MOST_WORLDS = 4_000
_RUNS, _RUNS_AT_ONCE = 2_000, 200
_FEWEST_SIMULATED, _MOST_STEPS = 2, 512
"""Steps of simulated pairs: a margin of nearly all trials is shown by two at the earliest; where 512 are not enough, a
step is of more pairs, and a plan is exact to less than half a percent.
"""
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
    shares = [(discordant + difference) / 2, (discordant - difference) / 2, 1 - discordant]
    enough = threshold(alpha)

    def stops(chance: np.random.Generator, runs: int, worlds: int) -> NDArray[np.int64]:
        return _first(mixed(sign_wealth(_nets(chance, shares, each, runs, worlds))) >= enough)

    return _simulated(stops, fewest_worlds(alpha), _MOST_WORLDS, power)


def until_not_worse(
    margin: float, discordant: float, each: float | None, alpha: float, power: float
) -> EarlyPlan | None:
    """Simulates after how many pairs, or worlds, a run with the same pass rate is shown not to be worse by a margin.

    A run that is decided to be better or worse before is wrongly decided, as neither is true.

    Args:
        margin: Fall of the pass rate that would matter, a share above 0 and below 1.
        discordant: Share of pairs whose verdicts differ, half of them in each direction.
        each: Trials in each world, no more alike than others; None: single pairs decide.
        alpha: Error probability of all answers together.
        power: Chance that it is decided by then; two standard errors of the simulation come on top.

    Returns:
        Pairs, or worlds; None: there are too many to be simulated, or such a run is mostly never decided.
    """
    shares, enough = [discordant / 2, discordant / 2, 1 - discordant], threshold(alpha)
    trials = 1 if each is None else max(1, round(each))

    def stops(chance: np.random.Generator, runs: int, steps: int) -> NDArray[np.int64]:
        nets = _nets(chance, shares, trials, runs, steps)
        return _rightly(margin_wealth(nets / trials, margin), sign_wealth(nets), sign_wealth(-nets), enough)

    if each is not None:
        return _simulated(stops, fewest_worlds(alpha), _MOST_WORLDS, power)
    # The evidence of single pairs depends on their numbers alone, so that many may be drawn at once.
    better, same, worse = (margin_wealth(np.array([change]), margin)[0] for change in (1.0, 0.0, -1.0))
    up, down = (sign_wealth(np.array([sign]))[0] for sign in (1.0, -1.0))
    pairs_a_step = 1

    def stops_of_pairs(chance: np.random.Generator, runs: int, steps: int) -> NDArray[np.int64]:
        drawn = chance.multinomial(pairs_a_step, shares, (runs, steps)).cumsum(axis=1)[..., None, :]
        gains, losses, others = drawn[..., 0], drawn[..., 1], drawn[..., 2]
        kept = gains * better + losses * worse + others * same
        return _rightly(kept, gains * up + losses * down, losses * up + gains * down, enough)

    while pairs_a_step * _MOST_STEPS <= MOST_EXACT:
        found = _simulated(stops_of_pairs, _FEWEST_SIMULATED, _MOST_STEPS, power)
        if found is not None:
            return EarlyPlan(found.needed * pairs_a_step, found.median * pairs_a_step)
        pairs_a_step *= 2
    return None


def _rightly(kept: Numbers, better: Numbers, worse: Numbers, enough: float) -> NDArray[np.int64]:
    """Returns the step with which each run is decided not to be worse, by the wealth of bets on all three answers."""
    right = _first(mixed(kept) >= enough)
    wrong = np.minimum(_first(mixed(better) >= enough), _first(mixed(worse) >= enough))
    return np.where(right <= wrong, right, kept.shape[1] + 1)


def _nets(
    chance: np.random.Generator, shares: Sequence[float], each: float, runs: int, steps: int
) -> NDArray[np.float64]:
    """Draws changes of runs: gains minus losses of the pairs of each step, by the shares of both and of none."""
    drawn = chance.multinomial(max(1, round(each)), shares, (runs, steps))
    return (drawn[..., 0] - drawn[..., 1]).astype(np.float64)


def _first(enough: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Returns the number of the step with which each run is decided, from 1; one more than there are: with none."""
    return np.where(enough.any(axis=1), enough.argmax(axis=1) + 1, enough.shape[1] + 1)


def _simulated(
    stops: Callable[[np.random.Generator, int, int], NDArray[np.int64]], fewest: int, most: int, power: float
) -> EarlyPlan | None:
    """Finds the number of steps by which enough of some simulated runs are decided; `None`: it is above a limit.

    Args:
        stops: Function that simulates some runs of so many steps, and returns the steps with which they are decided.
        fewest: Least number of steps that a plan says.
        most: Limit of the steps.
        power: Share of the runs; two standard errors come on top.
    """
    chance, steps = np.random.default_rng(_SEED), 4 * fewest
    safe = power + 2 * math.sqrt(power * (1 - power) / _RUNS)
    while steps <= most:
        found = np.sort(stops(chance, _RUNS_AT_ONCE, steps))
        if found[math.ceil(power * len(found)) - 1] <= steps:  # else so many more runs would say the same
            batches = [stops(chance, _RUNS_AT_ONCE, steps) for _ in range(_RUNS // _RUNS_AT_ONCE)]
            found = np.sort(np.concatenate(batches))
            needed, median = (int(found[math.ceil(share * _RUNS) - 1]) for share in (safe, _HALF))
            if needed <= steps:
                return EarlyPlan(max(needed, fewest), max(median, fewest))
        steps *= 2
    return None
