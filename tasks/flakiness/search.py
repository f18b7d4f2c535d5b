"""Search for the factor that decides how a flaky job ends: which factors the next rerun holds, and when to stop.

1. **Nothing held.** `BASELINE` reruns as the job asked. If they are all alike, others follow, up to `QUIET` of them;
   then the job repeats.
2. **All held.** If the job flips then as well, no known factor decides, and no more reruns are spent.
3. **Some held.** The next rerun holds what tells most: of all sets of factors the one with the greatest expected
   information. When one factor is probable, its two proofs are tried: all but it, and it alone.

It ends with an answer, or when the reruns are used up.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from itertools import combinations

from ...schemas.runs.verification import Factor
from .evidence import (
    ENOUGH,
    Decision,
    Held,
    Level,
    Observation,
    Weights,
    decided,
    flipping,
    flips,
    most_telling,
    posterior,
    with_held,
)

MOST_RERUNS = 20
"""Reruns of one job: 20 of a minute are what somebody waits for."""
BASELINE = 4
"""Reruns with nothing held: a job that flips every other time is alike in one of eight such sets."""
QUIET = 8
"""Reruns that are alike before a job is said to repeat: with one that flips every other time it happens once in 128."""
ALL_HELD = 2
"""Reruns with everything held, before others hold less; those bring more evidence of the same."""

LIKELY = 0.4
"""Posterior from which the two proofs of a factor are tried in turn: it has one rival at most then."""

TryOut = Callable[[Held], Sequence[Observation]]
"""Function that runs the job again with some factors held; several reruns where jobs run beside each other."""


@dataclass(frozen=True)
class Found:
    """Reruns of a job, with the factor that they have shown to decide."""

    observations: tuple[Observation, ...]
    decision: Decision | None
    why_not: str | None = None
    """Reason why nothing was decided, as a clause; None: something was, or the job repeats."""

    @property
    def free(self) -> list[Observation]:
        """Reruns with nothing held."""
        return with_held(self.observations, frozenset())

    def held_alone(self, factor: Factor) -> list[Observation]:
        """Reruns that held one factor alone."""
        return with_held(self.observations, frozenset({factor}))

    @property
    def repeats(self) -> bool:
        """Whether all reruns with nothing held were alike to the bit."""
        return not flips(self.free, "bits")


def search(
    try_out: TryOut, weigh: Callable[[], Weights], most: int = MOST_RERUNS, first: Observation | None = None
) -> Found:
    """Runs a job again until it is clear which factor decides how it ends.

    Args:
        try_out: Runs the job again with some factors held. What could not be held is missing in its observations.
        weigh: Returns the weights of the factors that can be held, once reruns have shown which are used.
        most: Number of reruns at most.
        first: The run itself, which counts as one with nothing held, but not as a rerun; None: it is not known.
    """
    seen: list[Observation] = [first] if first is not None else []
    most += len(seen)

    nothing: Held = frozenset()
    free = with_held(seen, nothing)
    while len(seen) < most and len(free) < (BASELINE if flips(free, "verdict") else QUIET):
        seen.extend(try_out(nothing))
        free = with_held(seen, nothing)
    if not flips(free, "bits"):
        return Found(tuple(seen), None)
    weights = weigh()
    begun = len(seen)
    while len(seen) < most and len(seen) - begun < ALL_HELD:
        seen.extend(try_out(frozenset(weights)))
    # Programs that do not hold what they were asked to hold never will.
    in_fact = frozenset[Factor]().union(*(each.held for each in seen[begun:]))
    factors: Weights = {each: weight for each, weight in weights.items() if each in in_fact}
    if len(seen) > begun and flips(with_held(seen, frozenset(factors)), flipping(seen)):
        return Found(tuple(seen), None, "it flips also while everything is held that can be")
    return _look_closer(try_out, factors, most, seen)


def _look_closer(try_out: TryOut, factors: Weights, most: int, seen: list[Observation]) -> Found:
    while len(seen) < most:
        if (decision := decided(seen, factors)) is not None:
            return Found(tuple(seen), decision)
        level = _telling(seen, factors)
        if posterior(seen, level, factors)[None] >= ENOUGH and level == "verdict":
            return Found(tuple(seen), None, "no factor alone holds it")
        seen.extend(try_out(_next(seen, level, factors)))
    decision = decided(seen, factors)
    return Found(tuple(seen), decision, None if decision else f"{len(seen)} reruns did not tell")


def _telling(seen: Sequence[Observation], factors: Weights) -> Level:
    """Returns bits, unless no factor alone can hold these while the verdict flips."""
    if posterior(seen, "bits", factors)[None] < 0.5:
        return "bits"
    return flipping(seen)


def _next(seen: Sequence[Observation], level: Level, factors: Weights) -> Held:
    """Returns the factors that the next rerun holds."""
    chances = posterior(seen, level, factors)
    likely: Factor = max(factors, key=lambda each: chances[each])
    alone: Held = frozenset({likely})
    others: Held = frozenset(factors) - alone
    if chances[likely] < LIKELY:
        return most_telling(seen, level, factors, _sets(factors), (others, alone))
    # As many of both: what is seldom seen free is no contrast to what is held.
    return min((others, alone), key=lambda held: len(with_held(seen, held)))


def _sets(factors: Collection[Factor]) -> list[Held]:
    return [frozenset(each) for size in range(len(factors) + 1) for each in combinations(factors, size)]
