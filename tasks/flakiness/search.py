"""Search for the factor that decides how a flaky job ends: which factors the next rerun holds, and when to stop.

1. **Nothing held.** Reruns as the job asked, until the verdict flips, or ways have differed in `BASELINE` of them. If
   `QUIET` of them are all alike, the job repeats.
2. **All held.** If the job flips then as well, no known factor decides, and no more reruns are spent.
3. **Some free.** The next rerun holds what tells most: of all sets of factors the one with the greatest expected
   information. Of a likely factor it is seen what happens when it alone is free.

It ends with an answer, or when the reruns are used up.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ...schemas.runs.verification import FACTOR_IN_WORDS, FACTORS
from .causes import VALUED, Held, Hold, Values, Weights, at_values
from .evidence import ENOUGH, Decision, Evidence, Observation, contrasts_of, sets_of

MOST_RERUNS = 20
"""Reruns of one job: 20 of a minute are what somebody waits for."""
BASELINE = 5
"""Reruns with nothing held whose ways differ, before it is asked what decides the way: of jobs whose verdict flips
every other time, one in 16 ends alike in all of them.
"""
QUIET = 10
"""Reruns that are alike before a job is said to repeat: with one that flips every other time it happens once in 512."""
ALL_HELD = 2
"""Reruns with everything held, before others hold less; those bring more evidence of the same."""
MOST_VALUES = 4
"""Values of all factors at once: of four, two at least have different ends in seven of eight cases."""
LIKELY = 0.5
"""Posterior from which a factor alone is left free: it is more probable than all else together."""
CONTRASTS = 3
"""Reruns that leave it free alone: of three, one differs from those that hold it in seven of eight cases."""
HOPELESS = 0.99
"""Posterior of "none of them" or of two factors from which no more reruns are spent; few of these say little."""

TryOut = Callable[[Hold], Sequence[Observation]]
"""Function that runs the job again with some factors held; several reruns where jobs run beside each other."""


@dataclass(frozen=True)
class Found:
    """Result of a search: the reruns of a job, and what they have decided."""

    observations: tuple[Observation, ...]
    decision: Decision | None
    why_not: str | None = None
    """Reason why nothing was decided, as a clause; None: something was, or the job repeats."""

    @property
    def repeats(self) -> bool:
        """Whether all reruns with nothing held were alike to the bit."""
        return len({each.bits for each in self.observations if not each.held}) <= 1


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
    while len(seen) < min(most, QUIET) and not _has_flipped(seen):
        seen.extend(try_out(Hold(frozenset())))
    if len({each.bits for each in seen}) <= 1:
        return Found(tuple(seen), None)
    for value in range(min(ALL_HELD, most - len(seen))):
        everything: Held = frozenset(weigh())
        seen.extend(try_out(at_values(everything, _all_at(everything, value))))
    while len(seen) < most:
        factors = _held_in_fact(weigh(), seen)
        evidence = Evidence(seen, factors)
        if not factors:
            return Found(tuple(seen), None, "none of what may decide can be held here")
        if (why := _why_none(evidence, HOPELESS)) or evidence.decision():
            return Found(tuple(seen), evidence.decision(), why)
        seen.extend(try_out(_next(seen, factors, evidence)))
    evidence = Evidence(seen, _held_in_fact(weigh(), seen))
    decision = evidence.decision()
    why = _why_none(evidence, ENOUGH) or f"{len(seen) - (first is not None)} reruns did not tell"
    return Found(tuple(seen), decision, None if decision else why)


def _held_in_fact(weights: Weights, seen: Sequence[Observation]) -> Weights:
    """Returns the weights of factors that a rerun has held: a program in another language never holds some of them."""
    held = frozenset[str]().union(*(each.held for each in seen))
    return {factor: weight for factor, weight in weights.items() if factor in held}


def _next(seen: Sequence[Observation], factors: Weights, evidence: Evidence) -> Hold:
    """Returns what the next rerun holds: what a likely factor has yet to show, else what tells most."""
    everything: Held = frozenset(factors)
    rare, other = _values(seen, everything, evidence)
    of_factors = evidence.of_factors()
    likely = max(factors, key=lambda each: of_factors[frozenset((each,))])
    moved: list[Values] = [
        {**rare, each: other.get(each, 0)} for each in everything if rare.get(each, 0) != other.get(each, 0)
    ]
    new = 1 + max((number for each in seen for _, number in each.values), default=0)
    if of_factors[frozenset((likely,))] >= LIKELY:
        others, alone = contrasts_of(likely, everything)
        is_shown = evidence.is_shown(likely)
        tried = {dict(each.values).get(likely, 0) for each in seen if each.held == everything}
        if not is_shown and likely in VALUED and (moved or len(tried) < MOST_VALUES):
            changed: Values = {**rare, likely: other.get(likely, 0) if moved else new}
            return at_values(everything, changed)
        if not is_shown and sum(each.held == others for each in seen) < CONTRASTS:
            return at_values(others, rare)
        if not evidence.is_held_alone(likely):
            return at_values(alone, rare)
        if not is_shown:
            return at_values(others, rare)
    valued = sum(probability for of, probability in of_factors.items() if of & VALUED)
    if valued >= LIKELY and rare == other and new < MOST_VALUES:
        return at_values(everything, _all_at(everything, new))
    holds = [at_values(each, rare) for each in sets_of(factors, evidence)]
    return evidence.most_telling([*holds, *(at_values(everything, each) for each in moved)])


def _all_at(factors: Held, value: int) -> Values:
    return {each: value for each in factors}  # noqa: C420 (its keys would be text)


def _values(seen: Sequence[Observation], everything: Held, evidence: Evidence) -> tuple[Values, Values]:
    """Returns the values with the rarest end, and some with another end; the same if there are none.

    An end that is rare while a factor is free tells more, if it repeats, than one that comes anyway.
    """
    free = [evidence.label(each) for each in seen if not each.held]
    held = [each for each in seen if each.held == everything]
    if not held:
        return {}, {}
    rare = min(held, key=lambda each: free.count(evidence.label(each)))
    different = [each for each in held if evidence.label(each) != evidence.label(rare)]
    other = min(different, key=lambda each: len(each.values ^ rare.values), default=rare)
    return dict(rare.values), dict(other.values)


def _has_flipped(free: Sequence[Observation]) -> bool:
    """Returns whether reruns with nothing held have told enough: another verdict, or other ways for long enough."""
    ways = len({each.bits for each in free})
    return len({each.verdict for each in free}) > 1 or (len(free) >= BASELINE and ways > 1)


def _why_none(evidence: Evidence, enough: float) -> str | None:
    """Returns why no factor alone will be found to decide, as a clause; `None` if one may be."""
    for factors, probability in evidence.of_factors().items():
        if probability < enough or len(factors) == 1:
            continue
        names = [FACTOR_IN_WORDS[each] for each in FACTORS if each in factors]
        if not names:
            return "it flips also while everything is held that can be"
        return f"two factors decide together: {names[0].lower()} and {names[1].lower()}"
    return None
