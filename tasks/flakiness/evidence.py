"""Evidence of reruns: how probable it is, after some reruns, that one factor decides how a job ends.

Each rerun holds some factors and leaves the others as they are. The model is that one factor decides, or none of those
that are known:

- While the factor that decides is held, all reruns end alike. Held network, files and neighbours change what a robot
  finds: for reruns that hold others of these three it is only likely (`ALIKE`).
- While it is free, ends are drawn from one distribution that is not known. A Pólya urn stands for it: an end that was
  seen `c` times in `n` draws is drawn next with `c / (n + 1)`, a new one with `1 / (n + 1)`.

At first all factors are equally probable; a factor of which the programs made no use, as far as they were watched, has
the weight `UNUSED`, and "none of them" has `NONE`. Then the posterior follows from the reruns. A flip while a factor is
held rules that factor out for certain; equal ends only make it more probable. So the answer names a factor where its
posterior is at least `ENOUGH`, and where two things were seen, which guard against what the model leaves out (two
factors, or either of two): the job flips while all but that factor is held, and it does not in the reruns that hold it
alone.

An end is compared twice: by all bits of commands and states, and by the verdict. Bits tell more by each rerun, and
equal bits mean equal verdicts; where something else makes bits differ that the verdict does not depend on, no factor
alone holds them, and the verdicts decide.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from ...schemas.runs.verification import Factor

Held = frozenset[Factor]
Level = Literal["bits", "verdict"]
LEVELS: tuple[Level, ...] = ("bits", "verdict")

ENOUGH = 0.95
"""Posterior from which a factor is named: of such answers one in twenty may be wrong, if the model holds."""
FEWEST_ALONE = 3
"""Reruns that hold the factor alone, and end alike."""
BY_CHANCE = 0.15
"""Chance at most that reruns which hold the factor alone would all end alike although it does not decide: three reruns
of a job that flips every other time, six of one that flips in three of ten. Those that hold others besides count, too.
"""
ALIKE = 0.8
"""Chance that holding others of network, files and neighbours does not change how reruns end."""
NONE = 0.25
"""Weight of "none of them", where that of a factor is 1: most flaky tests of software are put down to one of these."""
UNUSED = 0.05
"""Weight of a factor that no program was seen to use: not zero, as watching misses what other languages do."""
_FOUND_BY_ROBOTS: Held = frozenset(("order", "files", "network"))
"""Factors that, held, change what a robot finds, and so may change how all reruns end."""


@dataclass(frozen=True)
class Observation:
    """End of one rerun, with the factors that were held in it."""

    held: Held
    verdict: str
    """Verdict, or failure code of a job that failed."""
    bits: str
    """Hash of commands and states, with the verdict."""

    def label(self, level: Level) -> str:
        """Returns what is compared at a level."""
        return self.bits if level == "bits" else self.verdict


@dataclass(frozen=True)
class Decision:
    """The factor that decides, and the reruns that show it."""

    factor: Factor
    probability: float
    level: Level


Weights = Mapping[Factor, float]
"""Weights of the factors that can be held, before any rerun."""


def posterior(observations: Sequence[Observation], level: Level, factors: Weights) -> dict[Factor | None, float]:
    """Computes how probable it is that each factor decides; None stands for none of them.

    Args:
        observations: Reruns, in any order.
        level: Whether bits or verdicts are compared.
        factors: Factors that were held in some reruns and left free in others.
    """
    logs: dict[Factor | None, float] = {None: math.log(NONE) + _log_likelihood(observations, level, None)}
    for factor, weight in factors.items():
        logs[factor] = math.log(weight) + _log_likelihood(observations, level, factor)
    most = max(logs.values())
    weights: dict[Factor | None, float] = {each: math.exp(log - most) for each, log in logs.items()}
    total = sum(weights.values())
    return {each: weights[each] / total for each in weights}


def _log_likelihood(observations: Sequence[Observation], level: Level, factor: Factor | None) -> float:
    fixed: dict[Held, str] = {}
    drawn: list[str] = []
    log = 0.0
    for each in observations:
        label = each.label(level)
        if factor not in each.held:
            drawn.append(label)
            continue
        found = each.held & _FOUND_BY_ROBOTS
        if found in fixed:
            log += 0.0 if fixed[found] == label else -math.inf
            continue
        is_alike = label in fixed.values()
        if fixed:
            log += math.log(ALIKE if is_alike else 1 - ALIKE)
        if not is_alike:
            drawn.append(label)
        fixed[found] = label
    return log + _log_urn(drawn)


def _log_urn(labels: Iterable[Hashable]) -> float:
    """Returns the logarithm of the probability that an urn gives these labels."""
    counts: Counter[Hashable] = Counter()
    log = 0.0
    for number, label in enumerate(labels):
        log += math.log((counts[label] or 1) / (number + 1))
        counts[label] += 1
    return log


def flips(observations: Iterable[Observation], level: Level) -> bool:
    """Returns whether reruns ended differently."""
    return len({each.label(level) for each in observations}) > 1


def with_held(observations: Iterable[Observation], held: Held) -> list[Observation]:
    """Returns the reruns that held exactly these factors."""
    return [each for each in observations if each.held == held]


def decided(observations: Sequence[Observation], factors: Weights) -> Decision | None:
    """Returns the factor that decides, if the reruns show one."""
    for level in LEVELS:
        for factor, probability in posterior(observations, level, factors).items():
            if factor is None or probability < ENOUGH:
                continue
            if is_needed(observations, factor, factors) and is_enough_alone(observations, level, factor):
                return Decision(factor, probability, level)
    return None


def flipping(observations: Sequence[Observation]) -> Level:
    """Returns the level that is asked about: the verdict, unless only bits differ while nothing is held."""
    return "verdict" if flips(with_held(observations, frozenset()), "verdict") else "bits"


def is_needed(observations: Sequence[Observation], factor: Factor, factors: Weights) -> bool:
    """Returns whether the job was seen to flip while all factors but this one were held."""
    everything = frozenset(factors)
    others = with_held(observations, everything - {factor})
    if others and factor not in _FOUND_BY_ROBOTS:
        others += with_held(observations, everything)
    return flips(others, flipping(observations))


def is_enough_alone(observations: Sequence[Observation], level: Level, factor: Factor) -> bool:
    """Returns whether enough reruns that held this factor alone have ended alike."""
    alone = with_held(observations, frozenset({factor}))
    ends = Counter(each.label(level) for each in with_held(observations, frozenset()))
    # Laplace's estimate: with no end seen twice, an end is still possible to come again.
    share = (max(ends.values(), default=0) + 1) / (ends.total() + 2)
    return len(alone) >= FEWEST_ALONE and not flips(alone, level) and share ** len(alone) <= BY_CHANCE


def most_telling(
    observations: Sequence[Observation],
    level: Level,
    factors: Weights,
    sets: Iterable[Held],
    proofs: Collection[Held] = (),
) -> Held:
    """Returns the set of factors whose holding in one more rerun is expected to tell most about what decides.

    Told is the mutual information of the factor and how the rerun ends; of equal sets it is the smallest.

    Args:
        observations: Reruns so far.
        level: Whether bits or verdicts are compared.
        factors: Factors that can be held.
        sets: Sets to choose from.
        proofs: Sets that will be wanted anyway, and so are worth twice as much.
    """
    before = posterior(observations, level, factors)
    urns: dict[Factor | None, _Urn] = {each: _Urn(observations, level, each) for each in before}

    def told(held: Held) -> float:
        chances: dict[Factor | None, Mapping[str, float]] = {each: urns[each].chances(held) for each in before}
        mixed: dict[str, float] = defaultdict(float)
        for each, ends in chances.items():
            for label, chance in ends.items():
                mixed[label] += before[each] * chance
        return sum(
            before[each] * chance * math.log(chance / mixed[label])
            for each, ends in chances.items()
            for label, chance in ends.items()
            if before[each] * chance > 0.0
        )

    return max(sets, key=lambda held: (round(told(held) * (1 + (held in proofs)), 6), -len(held), sorted(held)))


_NEW = ""
"""Stands for ends that were not seen before."""


class _Urn:
    """Ends that are expected of the next rerun, if a factor decides."""

    def __init__(self, observations: Sequence[Observation], level: Level, factor: Factor | None) -> None:
        self._factor = factor
        self._fixed: dict[Held, str] = {}
        drawn: Counter[str] = Counter()
        for each in observations:
            if factor in each.held:
                self._fixed[each.held & _FOUND_BY_ROBOTS] = each.label(level)
            else:
                drawn[each.label(level)] += 1
        drawn.update(set(self._fixed.values()))
        total = drawn.total() + 1
        self._free = {_NEW: 1 / total, **{label: count / total for label, count in drawn.items()}}

    def chances(self, held: Held) -> Mapping[str, float]:
        """Returns how probable each end of a rerun is."""
        if self._factor not in held or not self._fixed:
            return self._free
        if (known := self._fixed.get(held & _FOUND_BY_ROBOTS)) is not None:
            return {known: 1.0}
        share = Counter(self._fixed.values())
        return {
            label: (1 - ALIKE) * chance + ALIKE * share[label] / share.total() for label, chance in self._free.items()
        }
