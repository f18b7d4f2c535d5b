"""Claims about groups of failures: all axes, their pairs, worlds and kinds of worlds are tested; Holm corrects for all.

Three axes are tested where each two of them are significant: a claim of all three replaces three claims that a reader
would have to put together.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from ...schemas.reports.causes import Claim, ClaimKind, TestedLift
from ...schemas.reports.live_comparison import FEWEST_WORLDS
from .evidence import AxisColumn, Evidence
from .groups import Group
from .lift import Lift, lift_of, world_outlier
from .permutation_tests import Units, p_between_worlds, p_value, scores, units_of
from .regions import CUTS_OF_PAIRS, CUTS_OF_TRIPLES, Region, corners_of, directions_of, parts_of, regions_of
from .world_kinds import hardest_kind, kind_codes, lift_of_kind, steps_like

ALPHA = 0.05
_NEARLY = 0.9
"""Share of the best pair's score from which on another region of the pair may be the one that is named."""
_SAME_TRIALS = 0.8
"""Share of the trials in either of two regions that are in both, from which on they cannot be told apart."""


@dataclass(frozen=True)
class Hypothesis:
    """A tested axis, pair or triple of axes, world or kind of worlds, with its best region in a group."""

    group: int
    kind: ClaimKind
    axes: tuple[str, ...]
    parts: tuple[str, ...]
    """Region of each axis in words, or the world."""
    mask: NDArray[np.bool_]
    strength: float
    """Failures of the region beyond those expected, in standard deviations."""
    p_value: float
    is_of_such_worlds: bool = False
    """Whether it was tested between worlds, so that it holds for others of their kind."""
    adjusted: float = 1.0
    """P-value with Holm's correction for all hypotheses of the run."""

    @property
    def region(self) -> str:
        """Region in words: `FLOOR = carpet, LIGHT = night and noise ≥ 0.02`."""
        *others, last = self.parts
        return f"{', '.join(others)} and {last}" if others else last


def fewest_failures(axes: int) -> int:
    """Returns how many failures a group needs before a cause of them (a region of the axes) can be claimed.

    All of them would have to lie in one half of an axis, with a chance that is below alpha after Holm's correction for
    the axes and pairs of this group, each with about 16 regions.

    Args:
        axes: Number of axes.
    """
    hypotheses = axes + axes * (axes - 1) // 2 + 1
    return math.ceil(math.log2(16 * hypotheses / ALPHA))


def tests_of_a_group(evidence: Evidence, axes: int) -> int:
    """Returns the number of tests of each group: of axes, pairs of axes, worlds if enough, and kinds of worlds if any.

    Args:
        evidence: The trials.
        axes: Number of axes.
    """
    are_worlds_tested = evidence.world_count >= FEWEST_WORLDS
    return axes + axes * (axes - 1) // 2 + are_worlds_tested + bool(kind_codes(evidence)[1])


def hypotheses_of(
    evidence: Evidence, groups: Sequence[Group], axes: Sequence[AxisColumn], chance: np.random.Generator
) -> list[Hypothesis]:
    """Tests all axes, pairs of axes, worlds and kinds of worlds in some groups.

    Args:
        evidence: The trials.
        groups: The groups, each with enough failures.
        axes: The axes that can be told from worlds.
        chance: What permutes trials.

    Returns:
        The hypotheses, with adjusted p-values; those of three axes where each two of these are significant.
    """
    tests = len(groups) * tests_of_a_group(evidence, len(axes))
    found: list[Hypothesis] = []
    for number, group in enumerate(groups):
        found += [_axis(evidence, number, group, axis, _Draw(chance, tests)) for axis in axes]
        found += [_corner(evidence, number, group, pair, _Draw(chance, tests)) for pair in combinations(axes, 2)]
        if (outlier := world_outlier(evidence, group)) is not None:
            found.append(_world(evidence, number, *outlier))
        if (kind := hardest_kind(evidence, group)) is not None:
            found.append(_kind(number, *kind))
    adjusted = holm([each.p_value for each in found])
    tested = [replace(each, adjusted=value) for each, value in zip(found, adjusted, strict=True)]
    return [*tested, *_triples(evidence, groups, axes, tested, chance)]


def _triples(
    evidence: Evidence,
    groups: Sequence[Group],
    axes: Sequence[AxisColumn],
    tested: Sequence[Hypothesis],
    chance: np.random.Generator,
) -> list[Hypothesis]:
    """Tests three axes of which each two are significant.

    Without a true pair there is no such triple unless a pair is claimed in error, which Holm's correction allows in 5 %
    of runs. So only the number of triples is corrected for here.
    """
    pairs = {(each.group, each.axes): each.adjusted for each in tested if each.kind == "pair"}
    wanted: list[tuple[int, tuple[AxisColumn, ...], float]] = []
    for number, triple in product(range(len(groups)), combinations(axes, 3)):
        of_pairs = max(pairs[number, (first.name, second.name)] for first, second in combinations(triple, 2))
        if of_pairs <= ALPHA:
            wanted.append((number, triple, of_pairs))
    draw = _Draw(chance, len(wanted))
    found = [(_corner(evidence, number, groups[number], triple, draw), least) for number, triple, least in wanted]
    return [replace(each, adjusted=max(least, min(1.0, len(wanted) * each.p_value))) for each, least in found]


@dataclass(frozen=True)
class _Draw:
    chance: np.random.Generator
    tests: int
    """Number of tests of the run."""


def holm(p_values: Sequence[float]) -> list[float]:
    """Corrects p-values for their number by the method of Holm (1979)."""
    order = np.argsort(p_values, kind="stable")
    steps = np.array(p_values, dtype=np.float64)[order] * np.arange(len(order), 0, -1)
    adjusted = np.empty(len(order))
    adjusted[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return adjusted.tolist()


def _axis(evidence: Evidence, number: int, group: Group, axis: AxisColumn, draw: _Draw) -> Hypothesis:
    regions = regions_of(axis)
    units = units_of(evidence, group, [axis])
    members = _members(units, axis, regions)
    found = scores(units, members)
    best = int(np.argmax(found))
    region = regions[best]
    between = _between_worlds(evidence, [units], region.weights(axis), directions_of(axis))
    p = between or 0.0
    if p <= ALPHA:
        p = max(p, p_value(units, members, float(found[best]), draw.chance, draw.tests))
    holds = between is not None
    return Hypothesis(number, "axis", (axis.name,), (region.words,), region.mask(axis), float(found[best]), p, holds)


def _members(units: Units, axis: AxisColumn, regions: Sequence[Region]) -> NDArray[np.bool_]:
    return np.stack([region.mask(axis)[units.first] for region in regions], axis=1)


def _corner(evidence: Evidence, number: int, group: Group, axes: tuple[AxisColumn, ...], draw: _Draw) -> Hypothesis:
    """Tests whether failures gather in a corner of two axes or three, as fewer of them would not let expect.

    Trials are swapped inside parts of all axes but one, for each of them; the largest p-value counts.
    """
    cuts = CUTS_OF_PAIRS if len(axes) == 2 else CUTS_OF_TRIPLES
    units = units_of(evidence, group, axes)
    members = reduce(_products, (_members(units, axis, regions_of(axis, cuts)) for axis in axes))
    given = [_inside_parts(units, others, cuts + 1) for others in combinations(axes, len(axes) - 1)]
    each_given = [scores(one, members) for one in given]
    least = np.min(each_given, axis=0)
    # Several corners are nearly the same; the one with most failures is meant.
    corner = int(np.argmax(np.where(least >= _NEARLY * max(float(least.max()), 1e-9), scores(units, members), -np.inf)))
    regions = corners_of(axes, cuts)[corner]
    weights = np.prod([region.weights(axis) for region, axis in zip(regions, axes, strict=True)], axis=0)
    between = _between_worlds(evidence, given, weights, math.prod(directions_of(axis) for axis in axes))
    p = (between or 0.0) if least[corner] > 0 else 1.0
    for one, found in zip(given, each_given, strict=True):
        if p <= ALPHA:
            p = max(p, p_value(one, members, float(found[corner]), draw.chance, draw.tests))
    return Hypothesis(
        number,
        "pair" if len(axes) == 2 else "triple",
        tuple(axis.name for axis in axes),
        tuple(region.words for region in regions),
        np.logical_and.reduce([region.mask(axis) for region, axis in zip(regions, axes, strict=True)]),
        float(scores(units, members[:, [corner]])[0]),
        p,
        between is not None,
    )


def _products(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Returns which units lie in a region of the first and in one of the second, those of the first region first."""
    return (first[:, :, None] & second[:, None, :]).reshape(len(first), -1)


def _inside_parts(units: Units, axes: Sequence[AxisColumn], parts: int) -> Units:
    for axis in axes:
        units = units.inside(_part_codes(axis, parts))
    return units


def _between_worlds(
    evidence: Evidence, units: Sequence[Units], weights: NDArray[np.float64], directions: int
) -> float | None:
    """P-value of an axis between worlds, corrected for its number of directions; None: there are too few worlds."""
    if evidence.world_count < FEWEST_WORLDS:
        return None
    found = [p_between_worlds(each, weights[each.first], evidence.worlds) for each in units]
    known = [each for each in found if each is not None]
    return min(1.0, directions * max(known)) if len(known) == len(found) else None


def _part_codes(axis: AxisColumn, most: int) -> NDArray[np.int64]:
    """Returns for each trial the number of the part of an axis in which its value lies: a fifth, or one value."""
    parts = parts_of(axis, most)
    return np.argmax(np.stack([mask for _, mask in parts]), axis=0).astype(np.int64)


def _world(evidence: Evidence, number: int, world: int, p_value: float) -> Hypothesis:
    name = f"world = {evidence.world_names[world]}"
    return Hypothesis(number, "world", (), (name,), evidence.worlds == world, _strength(p_value), p_value)


def _kind(number: int, name: str, mask: NDArray[np.bool_], p_value: float) -> Hypothesis:
    region = f"worlds of {name}"
    return Hypothesis(number, "worlds", (), (region,), mask, _strength(p_value), p_value, is_of_such_worlds=True)


def _strength(p_value: float) -> float:
    from scipy.special import ndtri

    return float(-ndtri(max(p_value, 1e-300)))


def claims_of(evidence: Evidence, group: Group, found: Sequence[Hypothesis]) -> list[tuple[Claim, Hypothesis]]:
    """Chooses the claims about a group of failures: regions of axes, or worlds, that explain them; strongest first.

    A claim needs an adjusted p-value of at most 5 %, and a lift whose interval, which is that between worlds where
    there are six or more, leaves out 1. What several axes explain together is not claimed of fewer of them again.

    Args:
        evidence: The trials.
        group: The group.
        found: Its hypotheses.
    """
    lifted = [
        (each, lift)
        for each in found
        if each.adjusted <= ALPHA and (lift := lift_of_claim(evidence, group, each)) is not None
    ]
    shown = [(each, lift) for each, lift in lifted if lift.low > 1]
    kept = [(each, lift) for each, lift in shown if not _is_explained(each, [other for other, _ in shown])]
    kept.sort(key=lambda item: (-item[0].strength, item[0].region))
    return [(_claim(evidence, each, lift, found, group.others), each) for each, lift in kept]


def lift_of_claim(evidence: Evidence, group: Group, hypothesis: Hypothesis) -> Lift | None:
    """Computes how many times as often trials of a group fail in a hypothesis' region.

    Args:
        evidence: The trials.
        group: The failures that are asked about.
        hypothesis: The region: of axes, a world, or worlds of a kind.
    """
    if hypothesis.kind == "worlds":
        return lift_of_kind(evidence, group, hypothesis.mask)
    if hypothesis.kind != "world":
        return lift_of(evidence, group, hypothesis.mask)
    # One world is compared with the others as they are: its trials, not worlds, are the sample.
    one = np.zeros(len(evidence), dtype=np.int64)
    alone = replace(evidence, jobs=one, worlds=one, world_names=("",), cells=np.arange(len(evidence)))
    return lift_of(alone, group, hypothesis.mask)


def _is_explained(hypothesis: Hypothesis, shown: Sequence[Hypothesis]) -> bool:
    """Whether axes are explained by more of them that are as strong or stronger, or by fewer that are stronger."""
    own = set(hypothesis.axes)
    more = [each for each in shown if own < set(each.axes)]
    fewer = [each for each in shown if each.axes and set(each.axes) < own]
    return bool(own) and (
        any(each.strength >= hypothesis.strength for each in more)
        or any(each.strength > hypothesis.strength for each in fewer)
    )


def _claim(evidence: Evidence, hypothesis: Hypothesis, lift: Lift, found: Sequence[Hypothesis], others: int) -> Claim:
    of_kind = hypothesis.kind == "worlds"
    steps = steps_like(evidence.steps, evidence.step_names, hypothesis.mask) if of_kind else []
    return Claim(
        kind=hypothesis.kind,
        axes=list(hypothesis.axes),
        region=hypothesis.region,
        failed_inside=lift.failed_inside,
        trials_inside=lift.trials_inside,
        failed_outside=lift.failed_outside,
        trials_outside=lift.trials_outside,
        lift=lift.value,
        low=lift.low,
        high=lift.high,
        p_value=hypothesis.adjusted,
        scope="such worlds" if hypothesis.is_of_such_worlds else "these worlds only",
        alike=[*_alike(hypothesis, found), *steps],
        failed_otherwise=others,
    )


def _alike(hypothesis: Hypothesis, found: Sequence[Hypothesis]) -> Iterator[str]:
    for other in found:
        if other.kind == "axis" and other.axes[0] not in hypothesis.axes:
            both = int((other.mask & hypothesis.mask).sum())
            if both >= _SAME_TRIALS * max(1, int((other.mask | hypothesis.mask).sum())):
                yield other.region


def lifts_of(
    evidence: Evidence, groups: Sequence[Group], names: Sequence[str], found: Sequence[Hypothesis]
) -> list[TestedLift]:
    """Computes the lift of each hypothesis about axes, claimed or not."""
    lifts = [(each, lift_of(evidence, groups[each.group], each.mask)) for each in found if each.axes]
    return [
        TestedLift(
            group=names[each.group],
            axes=list(each.axes),
            region=each.region,
            lift=lift.value,
            low=lift.low,
            high=lift.high,
            p_value=each.adjusted,
        )
        for each, lift in lifts
        if lift is not None
    ]
