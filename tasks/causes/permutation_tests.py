"""Permutation tests of regions: trials, or cells, that differ in the tested axes only could as well be swapped.

What is swapped decides what the test is fooled by. Trials of one job are compared with each other only, so that a
world that is hard makes no axis guilty that has other values there. In a grid, all trials of a seed that share a value
of the tested axes are swapped with those that share another: an axis that changes nothing repeats trials, and repeated
trials are no evidence. Where cells were drawn, whole cells are swapped, with their trials in all worlds: cells that
share a value of the tested axis by chance share those of others, which may be the cause.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...schemas.reports.live_comparison import FEWEST_WORLDS
from .evidence import AxisColumn, Evidence, key_codes
from .groups import Group

_FIRST_LOOK, _MOST_PERMUTATIONS = 199, 29_999
_FLOOR = 0.01
"""Smallest p-value, after its correction, that permutations have to be able to show."""
_ROUNDING = 1e-4
"""Scores that differ by less are the same, in numbers of 32 bits."""
_ENOUGH = 15
"""Permutations that reach what was found; as many tell a p-value of no use within a quarter."""
_HOPELESS = 0.5
"""Bonferroni's bound on the p-value, from the normal distribution, above which no permutation is made."""
_MOST_UNITS = 8_000
_AT_ONCE = 2_000_000
"""Numbers that are permuted at once: 16 MB."""
_NO_SPREAD = 1e-6
"""Standard deviation, in failures, of a region that all units of each stratum are in, or none; rounding leaves some."""
_AS_CLEAR = 2.0
"""P-values that are planned are that much smaller: a few hundred permutations may show them half as large again."""
_SHARE_IN_BLOCKS = 0.5
"""Share of the trials that need partners in the same block, so that trials are swapped and not cells."""


@dataclass(frozen=True)
class Units:
    """Trials, or groups of trials, that a permutation test swaps, and the strata inside which they are swapped."""

    values: NDArray[np.float64]
    """Failures of each unit beyond those that its jobs would lead to expect."""
    strata: NDArray[np.int64]
    """Number of the stratum inside which it may be swapped."""
    first: NDArray[np.int64]
    """A trial of each unit: all of them have the same values of the tested axes."""
    trials: NDArray[np.int64]
    """Trials of all units."""
    of_trials: NDArray[np.int64]
    """Number of the unit of each of these trials."""
    parts: NDArray[np.float64]
    """Part of each of these trials in the value of its unit."""

    def inside(self, codes: NDArray[np.int64]) -> "Units":
        """Returns the same units, in finer strata: only units with the same number of those given are swapped."""
        return replace(self, strata=key_codes([self.strata, codes[self.first]]))

    def centred(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Subtracts the mean of its stratum from each unit's value; also of matrices with a row for each unit."""
        counts = np.bincount(self.strata).astype(np.float64)
        columns = values.reshape(len(values), -1)
        sums = np.zeros((len(counts), columns.shape[1]))
        np.add.at(sums, self.strata, columns)
        return (columns - (sums / counts[:, None])[self.strata]).reshape(values.shape)


def units_of(evidence: Evidence, group: Group, axes: Sequence[AxisColumn]) -> Units:
    """Finds what may be swapped to test some axes.

    Args:
        evidence: The trials.
        group: The failures that are asked about.
        axes: The axes that are tested together.
    """
    others = [each.codes for each in evidence.axes if each.name not in {axis.name for axis in axes}]
    blocks = key_codes([evidence.jobs, evidence.seeds, *others])
    own = key_codes([axis.codes for axis in axes])
    if _share_with_partners(blocks, own) >= _SHARE_IN_BLOCKS:
        return _slabs(evidence, group, blocks, own)
    return _cells(evidence, group)


def _share_with_partners(blocks: NDArray[np.int64], own: NDArray[np.int64]) -> float:
    kinds = np.bincount(np.unique(np.stack([blocks, own]), axis=1)[0], minlength=int(blocks.max(initial=0)) + 1)
    return float((kinds[blocks] > 1).mean()) if len(blocks) else 0.0


def _slabs(evidence: Evidence, group: Group, blocks: NDArray[np.int64], own: NDArray[np.int64]) -> Units:
    """Makes units of all trials of a job and seed that share a value of the tested axes, whatever their other values.

    Trials of one seed are alike in all cells of a grid: an axis that changes nothing repeats them, and its values are
    no further evidence. Failures are counted beyond those of the trials that differ in the tested axes only.
    """
    trials = np.flatnonzero(group.at_risk)
    failed = group.failed[trials].astype(np.float64)
    of_blocks = np.unique(blocks[trials], return_inverse=True)[1]
    means = np.bincount(of_blocks, weights=failed) / np.bincount(of_blocks)
    parts = failed - means[of_blocks]
    repeats = key_codes([evidence.jobs, evidence.seeds])
    slabs = key_codes([repeats, own])[trials]
    found, first, of_trials = np.unique(slabs, return_index=True, return_inverse=True)
    values = np.bincount(of_trials, weights=parts, minlength=len(found)).astype(np.float64)
    strata = np.unique(repeats[trials][first], return_inverse=True)[1]
    units = Units(values, strata, trials[first], trials, of_trials, parts)
    return units if len(found) <= _MOST_UNITS else _some(units)


def _some(units: Units) -> Units:
    """Returns the units of some strata, all of which they keep, as many as are swapped at most."""
    every = -(-len(units.values) // _MOST_UNITS)
    chosen = np.random.default_rng(2).permutation(int(units.strata.max()) + 1) % every == 0
    kept = chosen[units.strata]
    of_kept = kept[units.of_trials]
    numbers = np.cumsum(kept) - 1
    return Units(
        units.values[kept],
        np.unique(units.strata[kept], return_inverse=True)[1],
        units.first[kept],
        units.trials[of_kept],
        numbers[units.of_trials[of_kept]],
        units.parts[of_kept],
    )


def _cells(evidence: Evidence, group: Group) -> Units:
    in_jobs = np.bincount(evidence.jobs, weights=group.at_risk)
    rates = np.bincount(evidence.jobs, weights=group.failed) / np.maximum(in_jobs, 1)
    parts = np.where(group.at_risk, group.failed - rates[evidence.jobs], 0.0)
    beyond = np.bincount(evidence.cells, weights=parts).astype(np.float64)
    first = np.unique(evidence.cells, return_index=True)[1]
    # Cells may be swapped that were tried by the same jobs: sums of random numbers of the jobs are the same only then.
    pairs = np.unique(np.stack([evidence.cells, evidence.jobs]), axis=1)
    signs = np.random.default_rng(1).random(len(in_jobs))
    profile = np.round(np.bincount(pairs[0], weights=signs[pairs[1]]), 9)
    strata = np.unique(profile, return_inverse=True)[1]
    every = max(1, -(-len(first) // _MOST_UNITS))
    kept = slice(None, None, every)
    trials = np.flatnonzero(evidence.cells % every == 0)
    numbers = np.unique(strata[kept], return_inverse=True)[1]
    return Units(beyond[kept], numbers, first[kept], trials, evidence.cells[trials] // every, parts[trials])


def scores(units: Units, members: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Returns each region's failures beyond those expected, in standard deviations; 0 where that cannot be told.

    Args:
        units: What may be swapped.
        members: Which units lie in which region, with a row for each unit.
    """
    found = np.zeros(members.shape[1])
    scaled, usable = _scaled(units, members)
    found[usable] = scaled.T @ units.centred(units.values)
    return found


def p_between_worlds(units: Units, weights: NDArray[np.float64], worlds: NDArray[np.int64]) -> float | None:
    """Computes the p-value of an axis between worlds, which are its sample; `None` where too few of them have failures.

    Each world has a score: its failures beyond those expected, weighted, in standard deviations of its own. Where the
    axis changes nothing, or suits each world by chance, scores are 0 in the mean; a one-sided t test asks whether they
    are more.

    Args:
        units: What may be swapped.
        weights: How far each unit lies in the direction of the cause, from 0 to 1, without a search for the best cut.
        worlds: Number of the world of each trial.
    """
    from scipy.special import stdtr

    centred = units.centred(weights)[units.of_trials]
    own = worlds[units.trials]
    count = np.maximum(np.bincount(own), 1)
    sums = np.bincount(own, weights=units.parts * centred)
    spread = np.sqrt(np.bincount(own, weights=units.parts**2) / count * np.bincount(own, weights=centred**2))
    found = sums[spread > _NO_SPREAD] / spread[spread > _NO_SPREAD]
    if len(found) < FEWEST_WORLDS:
        return None
    error = max(float(found.std(ddof=1)), _NO_SPREAD) / math.sqrt(len(found))
    return float(stdtr(len(found) - 1, -float(found.mean()) / error))


def p_value(
    units: Units, members: NDArray[np.bool_], found: float, chance: np.random.Generator, tests: int = 1
) -> float:
    """Computes the chance that some region has a score as large as one that was found, where the axes change nothing.

    Args:
        units: What may be swapped.
        members: Which units lie in which region, with a row for each unit.
        found: The score.
        chance: What permutes them.
        tests: Number of tests for which the p-value will be corrected, so that it has to be that much finer.
    """
    scaled, usable = _scaled(units, members)
    if found <= 0 or _upper_tail(found) * int(usable.sum()) >= _HOPELESS:
        return 1.0
    order = np.argsort(units.strata, kind="stable")
    values, strata = units.centred(units.values)[order].astype(np.float32), units.strata[order]
    regions = scaled[order].astype(np.float32)
    made = reached = 0
    for total in (_FIRST_LOOK, min(_MOST_PERMUTATIONS, max(_FIRST_LOOK, math.ceil(tests / _FLOOR)))):
        for count in _chunks(total - made, len(values)):
            swapped = values[np.argsort(strata + chance.random((count, len(values))), axis=1)]
            reached += int(((swapped @ regions).max(axis=1) >= found - _ROUNDING).sum())
        made = total
        if reached >= _ENOUGH:
            break
    return (reached + 1) / (made + 1)


def growth_needed(units: Units, region: NDArray[np.bool_], regions: int, alpha: float) -> float:
    """Computes how many times as many trials it takes before permutations can show a p-value at all.

    However clear failures are, four seeds with two values each can be swapped in 16 ways only, of which one for each
    region looks as clear.

    Args:
        units: What may be swapped.
        region: Which trials lie in the region that fits best.
        regions: Number of regions among which it was found.
        alpha: Error probability of the test, corrected for the number of tests.

    Returns:
        The factor, below 1 where there are more than enough; infinite where nothing can be swapped.
    """
    from scipy.special import gammaln

    inside = np.bincount(units.strata, weights=region[units.first])
    sizes = np.bincount(units.strata)
    ways = float((gammaln(sizes + 1) - gammaln(inside + 1) - gammaln(sizes - inside + 1)).sum())
    return math.log(_AS_CLEAR * regions / alpha) / ways if ways > 0 else math.inf


def _scaled(units: Units, members: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Returns the regions that vary, scaled so that their products with the values are scores; and which they are."""
    regions = units.centred(members.astype(np.float64))
    counts = np.bincount(units.strata)
    squares = np.bincount(units.strata, weights=units.centred(units.values) ** 2) / np.maximum(counts - 1, 1)
    spread = np.sqrt((regions**2 * squares[units.strata][:, None]).sum(axis=0))
    usable = spread > _NO_SPREAD
    return regions[:, usable] / spread[usable], usable


def _chunks(count: int, width: int) -> Iterator[int]:
    size = max(1, _AT_ONCE // max(width, 1))
    while count > 0:
        yield min(size, count)
        count -= size


def _upper_tail(z: float) -> float:
    from scipy.special import ndtr

    return float(ndtr(-z))
