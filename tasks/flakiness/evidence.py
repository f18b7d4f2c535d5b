"""Evidence of reruns: how probable it is, after some reruns, that one factor decides how a job ends.

Each rerun holds some factors and leaves the others free. A `Cause` says which holds make commands and states repeat,
and which make the verdict repeat: one factor, two that both bring chance, two that only act together, or none of those
that are known. Noise of one factor may change the ways and leave the verdict to another.

- Held, a way is always the same. Held network, files and neighbours change what a robot finds, and the code that holds
  others changes the addresses that held hashes repeat: for reruns that differ in these it is only likely (`ALIKE`).
- Free, ways are drawn from one unknown distribution. A Pólya urn stands for it: a way that was seen `c` times in `n`
  draws is drawn next with `c / (n + 1)`, a new one with `1 / (n + 1)`; the verdict of a new way likewise.

A difference between two reruns that a cause would hold rules that cause out (threads are held but roughly, `SLIP`);
equal ends only make it more probable. A factor is named where all causes of the verdict that consist of it alone have
`ENOUGH` together.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

from ...schemas.runs.verification import Factor

Held = frozenset[Factor]
Covers = frozenset[Held]
"""Sets of factors each of which, held as a whole, makes ends repeat; empty: nothing does."""
Weights = Mapping[Factor, float]
"""Weights of the factors that can be held, before any rerun."""

ENOUGH = 0.95
"""Posterior from which a factor is named: of such answers one in twenty may be wrong, if the model holds."""
ALIKE = 0.8
"""Chance that holding others of what changes a held end does not change it."""
SLIP = 0.05
"""Chance that held threads take other turns nevertheless: the kernel goes on to choose who follows one that waits."""
NONE = 0.25
"""Weight of "none of them", where that of a factor is 1: most flaky tests of software are put down to one of these."""
UNUSED = 0.05
"""Weight of a factor that no program was seen to use: not zero, as watching misses what other languages do."""
PAIR = 0.2
"""Weight of two factors, relative to the product of theirs."""
_FOUND_BY_ROBOTS: Held = frozenset(("order", "files", "network"))
"""Factors that, held, change what a robot finds, and so may change how all reruns end."""
BESIDE_NETWORK: Held = frozenset(("order", "files"))
"""Factors that a held network holds as well, at least partly: its box has ports and temporary files of its own."""


@dataclass(frozen=True)
class Observation:
    """End of one rerun, and what was held in it."""

    held: Held
    verdict: str
    """Verdict, or failure code of a job that failed."""
    bits: str
    """Hash of commands and states, with the verdict."""


@dataclass(frozen=True)
class Cause:
    """Hypothesis about a job: which holds make its ways repeat, and which its verdicts."""

    ways: Covers
    verdict: Covers

    @property
    def factor(self) -> Factor | None:
        """The factor that alone decides the verdict; None: there is no such one."""
        factors = self.factors
        return next(iter(factors)) if len(factors) == 1 else None

    @property
    def factors(self) -> Held:
        """All factors that the verdict depends on."""
        return frozenset[Factor]().union(*self.verdict)


@dataclass(frozen=True)
class Decision:
    """The factor that decides, and how probable that is."""

    factor: Factor
    probability: float


def causes_of(factors: Weights) -> dict[Cause, float]:
    """Returns all causes that are thought of, with their weights before any rerun."""
    nothing: Covers = frozenset()
    causes = {Cause(nothing, nothing): NONE}
    singles = {each: frozenset((frozenset((each,)),)) for each in factors}
    for each, weight in factors.items():
        causes[Cause(singles[each], singles[each])] = weight
        causes[Cause(nothing, singles[each])] = weight * NONE * PAIR
    for one, other in combinations(factors, 2):
        weight = factors[one] * factors[other] * PAIR
        both: Covers = frozenset((frozenset((one, other)),))
        causes |= {Cause(both, each): weight for each in (both, singles[one], singles[other])}
        # A held network holds these as well, so that no rerun could tell that both are needed.
        if not ("network" in (one, other) and BESIDE_NETWORK & {one, other}):
            either = singles[one] | singles[other]
            causes[Cause(either, either)] = weight
    return causes


@dataclass
class _Ends:
    """Labels of one kind, as a cause lets them be: those of held reruns by what robots found, and those drawn."""

    covers: Covers
    fixed: dict[Held, str] = field(default_factory=dict[Held, str])
    drawn: Counter[str] = field(default_factory=Counter[str])

    def chance(self, held: Held, label: str, new: float = 1.0) -> float:
        """Returns the probability (0 to 1) of a label in the next rerun; `new` is the count for all new labels."""
        drawn = (self.drawn[label] or new) / (self.drawn.total() + 1)
        if not self.fixed or not self.holds(held):
            return drawn
        if (known := self.fixed.get(self._apart(held))) is not None:
            slip = SLIP if any("threads" in each for each in self.covers) else 0.0
            return 1.0 - slip if known == label else slip * drawn
        values = list(self.fixed.values())
        return ALIKE * values.count(label) / len(values) + (1 - ALIKE) * drawn

    def add(self, held: Held, label: str) -> None:
        if not self.holds(held):
            self.drawn[label] += 1
        elif self._apart(held) not in self.fixed:
            self.drawn[label] += label not in self.fixed.values()
            self.fixed[self._apart(held)] = label

    def holds(self, held: Held) -> bool:
        return any(each <= held for each in self.covers)

    def _apart(self, held: Held) -> Held:
        """Returns what reruns have to have in common to be certain to end alike."""
        return held if any("hash" in each for each in self.covers) else held & _FOUND_BY_ROBOTS


class _Model:
    """Reruns under one cause: their likelihood, and what is expected of the next."""

    def __init__(self, cause: Cause) -> None:
        self.ways, self.verdicts = _Ends(cause.ways), _Ends(cause.verdict)
        self.log = 0.0

    def chance(self, held: Held, end: tuple[str, str]) -> float:
        """Returns how probable an end is: a verdict with its way."""
        verdict, bits = end
        of_verdict = self.verdicts.chance(held, verdict)
        of_end = self.ways.chance(held, bits, of_verdict) if of_verdict else 0.0
        # A way that was seen while the verdict was free is no more probable than its verdict, now that this is held.
        return min(of_end, of_verdict) if self.verdicts.holds(held) else of_end

    def add(self, held: Held, end: tuple[str, str]) -> None:
        chance = self.chance(held, end)
        self.log += math.log(chance) if chance else -math.inf
        is_new = end[1] not in self.ways.drawn
        self.ways.add(held, end[1])
        # A way that was seen before says nothing new of verdicts.
        if is_new or self.verdicts.holds(held):
            self.verdicts.add(held, end[0])


class Evidence:
    """Posterior of all causes after some reruns.

    Args:
        observations: Reruns, in the order in which they were made.
        factors: Factors that can be held, with their weights.
    """

    def __init__(self, observations: Sequence[Observation], factors: Weights) -> None:
        flips = len({each.verdict for each in observations}) > 1
        # Where the verdict stays, it is asked what decides the way.
        ends = [(each.verdict if flips else each.bits, each.bits) for each in observations]
        weights = causes_of(factors)
        self._models = {cause: _Model(cause) for cause in weights}
        for model in self._models.values():
            for each, end in zip(observations, ends, strict=True):
                model.add(each.held, end)
        verdicts = {verdict for verdict, _ in ends}
        self._ends = {*ends, *((each, "") for each in verdicts), ("", "")}
        logs = {cause: math.log(weight) + self._models[cause].log for cause, weight in weights.items()}
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
                return Decision(next(iter(factors)), probability)
        return None

    def most_telling(self, sets: Iterable[Held]) -> Held:
        """Returns the set of factors whose holding in one more rerun is expected to tell most of what decides.

        Told is the mutual information of what decides and how the rerun ends.
        """
        return max(sets, key=lambda held: (round(self._told(held), 6), len(held), sorted(held)))

    def _told(self, held: Held) -> float:
        joint: dict[tuple[Held, tuple[str, str]], float] = defaultdict(float)
        for cause, probability in self.posterior.items():
            if probability > _FORGOTTEN:
                for end in self._ends:
                    joint[cause.factors, end] += probability * self._models[cause].chance(held, end)
        return _entropy(_sums(joint, 0)) + _entropy(_sums(joint, 1)) - _entropy(joint)


_FORGOTTEN = 1e-3
"""Posterior of causes that the choice of the next rerun leaves out, to be quick."""


def _sums(joint: Mapping[tuple[Held, tuple[str, str]], float], part: int) -> Mapping[object, float]:
    sums: dict[object, float] = defaultdict(float)
    for key, chance in joint.items():
        sums[key[part]] += chance
    return sums


def _entropy(chances: Mapping[object, float] | Mapping[tuple[Held, tuple[str, str]], float]) -> float:
    total = sum(chances.values())
    return -sum(each / total * math.log(each / total) for each in chances.values() if each > 0.0)


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
    sets = {frozenset[Factor]().union(*each) for size in range(len(blocks) + 1) for each in combinations(blocks, size)}
    with_network = BESIDE_NETWORK & frozenset(factors)
    return [each for each in sets if "network" not in each or with_network <= each]


_APART = 4
"""Factors that the next rerun may hold apart from each other: 32 sets with the rest of them."""
