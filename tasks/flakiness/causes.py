"""Causes that are thought of before any rerun: which holds make the verdicts of a job repeat, and which its ways.

A factor that brings chance into a way is noise, and leaves the verdict to another: a robot that is fast or slow by the
order of its hashes may also draw unseeded numbers on its way. Ways repeat only while all noise is held.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

from ...schemas.runs.verification import Factor

Held = frozenset[Factor]
Covers = frozenset[Held]
"""Sets of factors each of which, held as a whole, makes ends repeat; empty: nothing does."""
Weights = Mapping[Factor, float]
"""Weights of the factors that can be held, before any rerun."""

NONE = 0.25
"""Weight of "none of them", where that of a factor is 1: most flaky tests of software are put down to one of these."""
UNUSED = 0.05
"""Weight of a factor that no program was seen to use: not zero, as watching misses what other languages do."""
UNWATCHED = 0.15
"""Weight of hashes and addresses where hashes are fixed: no look shows whether a program asks for an address."""
BOTH = 0.1
"""Weight of two factors that both bring chance to the verdict, relative to the product of theirs."""
EITHER = 0.05
"""Weight of two that only act together, so that holding either of them is enough; a race that needs both is rarer."""
NOISE = 0.2
"""Chance that a factor that is used is noise of another one's ways."""
ENDLESS = 0.05
"""Chance that ways have noise that nothing holds, though the verdict can be held."""
BESIDE_NETWORK: Held = frozenset(("order", "files"))
"""Factors that a held network holds as well, at least partly: its box has ports and temporary files of its own."""


VALUED: Held = frozenset(("seed", "time", "hash"))
"""Factors that can be held at one value or another: another seed, moment, or order."""


class Hold(NamedTuple):
    """Factors that a rerun holds, and the numbers of the values of those of `VALUED` that are not held at 0."""

    held: Held
    values: frozenset[tuple[Factor, int]] = frozenset()

    def only(self, factors: Held) -> "Hold":
        """Returns this hold without the values of other factors."""
        return Hold(self.held, frozenset(each for each in self.values if each[0] in factors))


Values = Mapping[Factor, int]
"""Numbers of the values at which factors are held; 0 for those that are missing."""


def at_values(held: Held, values: Values) -> Hold:
    """Returns a hold of factors at some values; those of others are ignored."""
    return Hold(held, frozenset((each, values[each]) for each in held & VALUED if values.get(each, 0)))


@dataclass(frozen=True)
class Cause:
    """Hypothesis about a job: which holds make its ways repeat, and which its verdicts."""

    ways: Covers
    verdict: Covers

    @property
    def factors(self) -> Held:
        """All factors that the verdict depends on."""
        return union(self.verdict)


def union(sets: Iterable[Held]) -> Held:
    """Returns the factors of some sets."""
    return frozenset[Factor]().union(*sets)


def causes_of(factors: Weights) -> dict[Cause, float]:
    """Returns all causes that are thought of, with their weights before any rerun."""
    nothing: Covers = frozenset()
    causes = {Cause(nothing, nothing): NONE}
    for verdict, weight in _verdicts(factors):
        causes[Cause(nothing, verdict)] = weight * ENDLESS
        for noise, chance in _noises(factors, union(verdict)):
            ways: Covers = frozenset((union((*verdict, noise)),)) if noise or len(verdict) == 1 else verdict
            causes[Cause(ways, verdict)] = weight * chance * (1.0 - ENDLESS)
    return causes


def _verdicts(factors: Weights) -> Iterable[tuple[Covers, float]]:
    for each, weight in factors.items():
        yield frozenset((frozenset((each,)),)), weight
    for one, other in combinations(factors, 2):
        weight = factors[one] * factors[other]
        yield frozenset((frozenset((one, other)),)), weight * BOTH
        # A held network holds these as well, so that no rerun could tell that both are needed.
        if not ("network" in (one, other) and BESIDE_NETWORK & {one, other}):
            yield frozenset((frozenset((one,)), frozenset((other,)))), weight * EITHER


def _noises(factors: Weights, verdict: Held) -> Iterable[tuple[Held, float]]:
    """Returns all sets of factors that may be noise beside those of the verdict, with their chances."""
    others: list[Factor] = [each for each in factors if each not in verdict]
    chances = [NOISE * factors[each] for each in others]
    for number in range(1 << len(others)):
        chance = 1.0
        noise: Held = frozenset()
        for place, (each, own) in enumerate(zip(others, chances, strict=True)):
            is_noise = bool(number >> place & 1)
            chance *= own if is_noise else 1.0 - own
            if is_noise:
                noise |= frozenset((each,))
        yield noise, chance
