"""Evidence of reruns: how probable it is, after some reruns, that one factor decides how a job ends.

Each rerun holds some factors and leaves the others free, and a `Cause` says what of it then repeats.

- Held, an end is what it was in a rerun that held the same. In one that held others as well or less, it is only likely
  so (`ALIKE`): a robot without a network finds other things, and code that holds the clock changes addresses.
- Free, the verdict is drawn with one unknown chance, and the way is drawn among those of its verdict: one that was seen
  `c` times in `n` draws is drawn next with `c / (n + 1)`, a new one with `1 / (n + 1)` (a Pólya urn).

Ends that differ where a cause would hold them all but rule that cause out (`SLIP`); equal ends only make it more
probable. A factor is named where it has `ENOUGH` and where reruns have shown both sides: the job ends otherwise while
this factor alone is free or has another value, and alike while it alone is held.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from ...schemas.runs.verification import Factor
from .causes import BESIDE_NETWORK, Covers, Held, Hold, Weights, causes_of, union

ENOUGH = 0.96
"""Posterior from which a factor is named: of such answers one in twenty may be wrong, if the model holds."""
SURE = 0.99
"""Posterior of "no other factor changes the ways" from which it takes the place of another verdict."""
ALIKE = 0.99
"""Chance that holding others of what does not concern a held end does not change it."""
ALIKE_ADDRESSES = 0.8
"""The same for held addresses, which each line of code can move, and for what robots find around them."""
ALIKE_VALUES = 0.3
"""The same for another value: a robot may take each clock that is held for a slow one, say."""
SLIP = 1e-5
"""Chance that what is held goes another way nevertheless, as on a machine that is too busy for it."""
SLIP_OF_THREADS = 0.05
"""The same for threads: the kernel goes on to choose who follows one that waits."""
SKEW = 0.5
"""Weight of each verdict before any is drawn (Jeffreys): a job may flip every other time, or seldom."""
ALONE_HELD = 3
"""Reruns with only this factor held: one that another must be held for, too, flips in seven of eight such sets."""
_FOUND_BY_ROBOTS: Held = frozenset(("order", "files", "network"))
"""Factors that, held, change what a robot finds, and so may change how all reruns end."""


@dataclass(frozen=True)
class Observation:
    """End of one rerun, and what was held in it."""

    held: Held
    verdict: str
    """Verdict, or failure code of a job that failed."""
    bits: str
    """Hash of commands and states, with the verdict."""
    values: frozenset[tuple[Factor, int]] = frozenset()
    """Values other than 0 at which factors were held."""

    @property
    def hold(self) -> Hold:
        """Factors that were held, with their values."""
        return Hold(self.held, self.values)


@dataclass(frozen=True)
class Decision:
    """The factor that decides, and how probable that is."""

    factor: Factor
    probability: float


_End = tuple[str, str]
"""Label that is asked for, usually the verdict, and the bits of the way."""


@dataclass
class _Ends:
    """Labels of one kind, as covers let them be: those of held reruns, and those drawn, by verdict for ways."""

    covers: Covers
    verdicts: int
    """Number of verdicts that are known; 0: labels are ways, of which there may be any number."""
    fixed: dict[Hold, _End] = field(default_factory=dict[Hold, _End])
    drawn: Counter[_End] = field(default_factory=Counter[_End])
    totals: Counter[str] = field(default_factory=Counter[str])

    def chance(self, hold: Hold, end: _End) -> float:
        """Returns the probability (0 to 1) of a label in the next rerun: a verdict, or, of its verdict, a way."""
        drawn = self._drawn(end)
        if not self.fixed or not self.holds(hold):
            return drawn
        hold = self._own(hold)
        if (known := self.fixed.get(hold)) is not None:
            if self._is_told(end, known):
                return drawn
            slip = SLIP_OF_THREADS if any("threads" in each for each in self.covers) else SLIP
            return (1.0 - slip) * (known == end) + slip * drawn
        found = hold.held & _FOUND_BY_ROBOTS
        same_value = {other: each for other, each in self.fixed.items() if other.values == hold.values}
        similar = [each for other, each in same_value.items() if other.held & _FOUND_BY_ROBOTS == found]
        is_certain = similar and not any("hash" in each for each in self.covers)
        alike = ALIKE if is_certain else ALIKE_ADDRESSES
        if not same_value:
            alike, same_value = ALIKE_VALUES, self.fixed
        values = [each for each in similar or same_value.values() if not self._is_told(end, each)]
        return alike * values.count(end) / len(values) + (1.0 - alike) * drawn if values else drawn

    def add(self, hold: Hold, end: _End) -> None:
        if self.holds(hold):
            own = self._own(hold)
            if own in self.fixed:
                return
            is_drawn = end not in self.fixed.values() or own.values not in {each.values for each in self.fixed}
            self.fixed[own] = end
            if not is_drawn:
                return
        self.drawn[end] += 1
        self.totals[end[0]] += 1

    def holds(self, hold: Hold) -> bool:
        return any(each <= hold.held for each in self.covers)

    def log_of(self, ends: Iterable[tuple[Hold, _End]]) -> float:
        """Adds the labels of reruns to those known, one by one, and returns the natural logarithm of their probability.

        The probability is that of all together: each is judged by those before it.
        """
        log = 0.0
        for hold, end in ends:
            log += math.log(self.chance(hold, end))
            self.add(hold, end)
        return log

    def _own(self, hold: Hold) -> Hold:
        """Returns a hold without the value of others than these factors."""
        return hold.only(union(self.covers))

    def _is_told(self, end: _End, known: _End) -> bool:
        """Returns whether a way differs from another in its verdict, whose chance counts already."""
        return not self.verdicts and end[0] != known[0]

    def _drawn(self, end: _End) -> float:
        if self.verdicts:
            return (self.drawn[end] + SKEW) / (self.totals.total() + SKEW * self.verdicts)
        return (self.drawn[end] or 1) / (self.totals[end[0]] + 1)


class Evidence:
    """Posterior of all causes after some reruns.

    Args:
        observations: Reruns, in the order in which they were made.
        factors: Factors that can be held, with their weights.
    """

    def __init__(self, observations: Sequence[Observation], factors: Weights) -> None:
        self._observations = observations
        self._factors: Held = frozenset(factors)
        self._labels = sorted({each.verdict for each in observations})
        self._flips = len(self._labels) > 1
        # Where the verdict stays, it is asked what decides the way.
        causes = {
            cause: weight for cause, weight in causes_of(factors).items() if self._flips or cause.ways == cause.verdict
        }
        self._verdicts = {each: _Ends(each, len(self._labels)) for each in {cause.verdict for cause in causes}}
        self._ways = {each: _Ends(each, 0) for each in {cause.ways for cause in causes}}
        verdicts = [(each.hold, (each.verdict, "")) for each in observations]
        ways = [(each.hold, (each.verdict, each.bits)) for each in observations]
        of_verdicts = {covers: ends.log_of(verdicts) for covers, ends in self._verdicts.items()}
        of_ways = {covers: ends.log_of(ways) for covers, ends in self._ways.items()}
        logs = {
            cause: math.log(weight) + of_verdicts[cause.verdict] * self._flips + of_ways[cause.ways]
            for cause, weight in causes.items()
        }
        most = max(logs.values())
        total = sum(math.exp(log - most) for log in logs.values())
        self.posterior = {cause: math.exp(log - most) / total for cause, log in logs.items()}
        """Posterior probabilities of the causes."""

    def of_factors(self) -> dict[Held, float]:
        """Returns how probable it is that the verdict depends on exactly these factors; empty: on none of them."""
        sums: dict[Held, float] = defaultdict(float)
        for cause, probability in self.posterior.items():
            sums[cause.factors] += probability
        return sums

    def decision(self) -> Decision | None:
        """Returns the factor that decides how a job ends, and how sure that is; `None` if the reruns show none."""
        for factors, probability in self.of_factors().items():
            if len(factors) == 1 and probability >= ENOUGH:
                [factor] = factors
                return Decision(factor, probability) if self.is_shown(factor) and self.is_held_alone(factor) else None
        return None

    def is_shown(self, factor: Factor) -> bool:
        """Returns whether reruns ended otherwise that differ in this factor alone, free or at another value."""
        others, _ = contrasts_of(factor, self._factors)
        only_it = frozenset((frozenset((factor,)),))
        # Where no other factor changes the ways, none can change the verdict.
        is_only_noise = sum(chance for cause, chance in self.posterior.items() if cause.ways == only_it) >= SURE
        ends: dict[Hold, set[str]] = defaultdict(set)
        for each in self._observations:
            if each.held in (others, self._factors):
                ends[Hold(others, each.hold.only(others).values)].add(each.bits if is_only_noise else self.label(each))
        return any(len(each) > 1 for each in ends.values())

    def is_held_alone(self, factor: Factor) -> bool:
        """Returns whether reruns with this factor alone held were enough."""
        _, alone = contrasts_of(factor, self._factors)
        return alone == self._factors or sum(each.held == alone for each in self._observations) >= ALONE_HELD

    def most_telling(self, holds: Iterable[Hold]) -> Hold:
        """Returns the hold of one more rerun that is expected to tell most of what decides.

        Told is the mutual information of what decides and how the rerun ends.
        """
        probable = {cause: chance for cause, chance in self.posterior.items() if chance > _FORGOTTEN}
        verdicts, ways = (
            [*dict.fromkeys(part)] for part in zip(*((each.verdict, each.ways) for each in probable), strict=True)
        )
        joint = np.zeros((len(verdicts), len(ways)))
        rows = {covers: number for number, covers in enumerate(verdicts)}
        columns = {covers: number for number, covers in enumerate(ways)}
        for cause, probability in probable.items():
            joint[rows[cause.verdict], columns[cause.ways]] = probability
        told = {hold: round(self._told(hold, joint, verdicts, ways), 6) for hold in holds}
        return max(told, key=lambda hold: (told[hold], len(hold.held), sorted(hold.held), sorted(hold.values)))

    def _told(self, hold: Hold, joint: np.ndarray, verdicts: Sequence[Covers], ways: Sequence[Covers]) -> float:
        seen = {(each.verdict, each.bits) for each in self._observations}
        ends = sorted(seen | {(each, "") for each in self._labels})
        of_ways = np.array([[self._ways[each].chance(hold, end) for end in ends] for each in ways])
        chances = joint @ of_ways
        if self._flips:
            of_verdicts = [
                {label: self._verdicts[each].chance(hold, (label, "")) for label in self._labels} for each in verdicts
            ]
            chances *= np.array([[chance[label] for label, _ in ends] for chance in of_verdicts])
        sums: dict[Held, np.ndarray] = {}
        for covers, row in zip(verdicts, chances, strict=True):
            sums[union(covers)] = sums.get(union(covers), 0.0) + row
        table = np.array(list(sums.values()))
        return _entropy(table.sum(1)) + _entropy(table.sum(0)) - _entropy(table)

    def label(self, observation: Observation) -> str:
        """Returns what is asked for of an end: the verdict, or the way where this stays."""
        return observation.verdict if self._flips else observation.bits


_FORGOTTEN = 1e-3
"""Posterior of causes that the choice of the next rerun leaves out, to be quick."""


def contrasts_of(factor: Factor, factors: Held) -> tuple[Held, Held]:
    """Returns all factors but one, and this one alone, as far as it can be held and freed apart from others."""
    # A held network would hold neighbours and files, too.
    others = factors - {factor, *(["network"] if factor in BESIDE_NETWORK else [])}
    alone: Held = frozenset((factor,)) | (BESIDE_NETWORK & factors if factor == "network" else frozenset())
    return others, alone


def _entropy(chances: np.ndarray) -> float:
    parts = chances[chances > 0.0] / chances.sum()
    return float(-(parts * np.log(parts)).sum())


def sets_of(factors: Weights, evidence: Evidence) -> list[Held]:
    """Returns the sets of factors that the next rerun may hold.

    Factors that are unlikely go together, which keeps the sets few; a network is held with all that it holds.
    """
    probable: dict[Factor, float] = defaultdict(float)
    for held, probability in evidence.of_factors().items():
        for each in held:
            probable[each] += probability
    likely = sorted(factors, key=lambda each: -probable[each])[:_APART]
    if "network" in factors and "network" not in likely:
        likely.append("network")
    rest: Held = frozenset(factors) - frozenset(likely)
    blocks: list[Held] = [*(frozenset((each,)) for each in likely), *([rest] if rest else [])]
    sets = {union(each) for size in range(len(blocks) + 1) for each in combinations(blocks, size)}
    with_network = BESIDE_NETWORK & frozenset(factors)
    return [each for each in sets if "network" not in each or with_network <= each]


_APART = 4
"""Factors that the next rerun may hold apart from each other: 32 sets with the rest of them."""
