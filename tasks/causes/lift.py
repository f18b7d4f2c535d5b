"""Lift of a region: how many times as often trials fail in it as outside, within the same worlds, with its interval."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...schemas.reports.live_comparison import FEWEST_WORLDS
from .evidence import Evidence, key_codes
from .groups import Group

_LEVEL = 0.95


@dataclass(frozen=True)
class Lift:
    """Failure rate inside a region divided by that outside, with its 95 % interval."""

    inside: float
    """Failure rate in the region, with worlds weighted as in the ratio."""
    outside: float
    value: float
    low: float
    high: float
    failed_inside: int
    trials_inside: int
    failed_outside: int
    trials_outside: int


def lift_of(evidence: Evidence, group: Group, region: NDArray[np.bool_]) -> Lift | None:
    """Computes how many times as often trials fail in a region; `None`: nothing failed, or no job has both sides.

    It is the ratio of Mantel and Haenszel over jobs, so that a hard world with many trials in the region lifts nothing.
    Its variance is that between worlds where there are six or more, and between cells, of which the larger one counts;
    half a failure is added outside if there is none.

    Args:
        evidence: The trials.
        group: The failures that are asked about.
        region: Which of the trials lie in the region.
    """
    failed, at_risk = group.failed, group.at_risk
    jobs, count = evidence.jobs, int(evidence.jobs.max(initial=-1)) + 1
    inside = np.bincount(jobs, weights=region & at_risk, minlength=count)
    whole = np.bincount(jobs, weights=at_risk, minlength=count)
    outside = whole - inside
    with np.errstate(invalid="ignore", divide="ignore"):
        weights = np.where(region, (outside / whole)[jobs], (inside / whole)[jobs])
    usable = at_risk & (weights > 0)
    hits, misses = (float((weights * failed)[usable & side].sum()) for side in (region, ~region))
    of_hits, of_misses = (float(weights[usable & side].sum()) for side in (region, ~region))
    if of_hits <= 0 or hits + misses <= 0:
        return None
    half = 0.5 * of_misses / max(1, int((usable & ~region).sum()))
    rate_in = max(hits, half) / of_hits
    rate_out = max(misses, half) / of_misses
    # Each trial's part in the logarithm of the ratio.
    parts = np.where(region, (failed - rate_in) / (rate_in * of_hits), -(failed - rate_out) / (rate_out * of_misses))
    reach = _reach(evidence, np.where(usable, parts * weights, 0.0), usable)
    ratio = rate_in / rate_out
    return Lift(
        inside=hits / of_hits,
        outside=misses / of_misses,
        value=ratio,
        low=ratio * math.exp(-reach),
        high=ratio * math.exp(min(reach, 50.0)),
        failed_inside=int(failed[region].sum()),
        trials_inside=int((region & at_risk).sum()),
        failed_outside=int(failed[~region].sum()),
        trials_outside=int((~region & at_risk).sum()),
    )


def _reach(evidence: Evidence, parts: NDArray[np.float64], usable: NDArray[np.bool_]) -> float:
    """Half the width of the 95 % interval of a sum, from how its parts differ between clusters; the widest counts."""
    clusterings = [cells_of(evidence)]
    if evidence.world_count >= FEWEST_WORLDS:
        clusterings.append(evidence.worlds)
    return max(reach_between(parts[usable], clusters[usable], _LEVEL) for clusters in clusterings)


def cells_of(evidence: Evidence) -> NDArray[np.int64]:
    """Returns the number of each trial's cluster: its drawn combination of axis values, else its job and seed.

    The cells of a grid have all values of each axis equally often, and few of them are no sample of anything.
    """
    return evidence.cells if is_drawn(evidence) else key_codes([evidence.jobs, evidence.seeds])


def is_drawn(evidence: Evidence) -> bool:
    """Returns whether there are so many cells that they are taken for a sample, as drawn ones are."""
    return int(evidence.cells.max(initial=-1)) + 1 >= _MANY_CELLS


def p_by_chance(evidence: Evidence, group: Group, region: NDArray[np.bool_]) -> float:
    """Computes the chance that as many failures or more fall into a region, if its trials fail as often as the others.

    It is Fisher's exact test, one-sided, with each job's trials and failures as they are: a hard world makes no region
    guilty. Unlike an interval it has an answer where all trials of a region failed, and none outside.

    Args:
        evidence: The trials.
        group: The failures that are asked about.
        region: Which of the trials lie in the region.

    Returns:
        The p-value; 1 where drawn cells have several trials, which are alike in more than the region.
    """
    at_risk = group.at_risk
    cells = np.unique(key_codes([evidence.jobs, evidence.cells])[at_risk])
    if is_drawn(evidence) and len(cells) < at_risk.sum():
        return 1.0
    count = int(evidence.jobs.max(initial=-1)) + 1
    whole, inside, failed, hits = (
        np.bincount(evidence.jobs[at_risk & which], minlength=count)
        for which in (at_risk, region, group.failed, group.failed & region)
    )
    chances = np.ones(1)  # of each number of failures in the region, of the jobs so far
    for job in np.flatnonzero(failed).tolist():
        chances = np.convolve(chances, _hypergeometric(int(whole[job]), int(inside[job]), int(failed[job])))
    return min(1.0, float(chances[int(hits.sum()) :].sum()))


def _hypergeometric(trials: int, inside: int, failed: int) -> NDArray[np.float64]:
    """Returns the chance of each number of failures among the trials inside, from 0 to all, if any may fail."""
    from scipy.special import gammaln

    hits = np.arange(failed + 1)
    is_possible = (hits <= inside) & (failed - hits <= trials - inside)
    hits = hits[is_possible]

    def choose(of: int, count: NDArray[np.int64] | int) -> NDArray[np.float64]:
        return gammaln(of + 1) - gammaln(np.add(count, 1)) - gammaln(np.subtract(of + 1, count))

    chances = np.zeros(failed + 1)
    chances[is_possible] = np.exp(
        choose(inside, hits) + choose(trials - inside, failed - hits) - choose(trials, failed)
    )
    return chances


_MOST_OF_CHANCE = 0.5
"""Variance of logits by chance above which failures are so few that it is no measure: without one it is 2."""
_MANY_CELLS = 30
"""Cells from which on they are taken for a sample."""


def reach_between(parts: NDArray[np.float64], clusters: NDArray[np.int64], level: float) -> float:
    """Computes half the width of the interval of a sum of influences, clustered, with a t distribution.

    Args:
        parts: Part of each trial in the estimate; their sum is about 0.
        clusters: Number of the cluster of each trial.
        level: Confidence level of the interval.
    """
    from scipy.special import stdtrit

    numbers = np.unique(clusters, return_inverse=True)[1]
    sums = np.bincount(numbers, weights=parts)
    count = len(sums)
    if count < 2:
        return math.inf
    deviation = math.sqrt(count / (count - 1) * float((sums**2).sum()))
    return float(stdtrit(count - 1, (1 + level) / 2)) * deviation


def world_outlier(evidence: Evidence, group: Group) -> tuple[int, float] | None:
    """Finds the world that is harder than the others by more than these differ; `None` with fewer than six worlds.

    Both are asked: whether its trials failed more often by more than chance, and whether it lies apart from the spread
    of the other worlds, by a t test of their logits, in which hard worlds lie no further apart than easy ones.

    Args:
        evidence: The trials.
        group: The failures that are asked about.

    Returns:
        Number of the world, and the p-value, with Bonferroni's factor for the number of worlds.
    """
    from scipy.special import bdtrc, stdtr

    worlds = evidence.world_count
    if worlds < FEWEST_WORLDS:
        return None
    hits = np.bincount(evidence.worlds, weights=group.failed, minlength=worlds)
    counts, logits, of_chance = logits_of_worlds(evidence, group)
    best, p_value = 0, 1.0
    for world in range(worlds):
        others = np.delete(logits, world)
        spread = math.sqrt(max(float(others.var(ddof=1)), of_chance))
        t = (logits[world] - others.mean()) / (spread * math.sqrt(1 + 1 / (worlds - 1)))
        rest = (hits.sum() - hits[world]) / max(counts.sum() - counts[world], 1.0)
        if not counts[world]:
            continue
        by_chance = float(bdtrc(int(hits[world]) - 1, int(counts[world]), max(rest, 1e-9))) if hits[world] else 1.0
        found = worlds * max(float(stdtr(worlds - 2, -t)), by_chance)
        if found < p_value:
            best, p_value = world, found
    return best, min(1.0, p_value)


def logits_of_worlds(evidence: Evidence, group: Group) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Returns the number of trials at risk in each world, the logit of its failures, and the variance of chance.

    Logits have Haldane's half, so that a world without failures has one, too.
    """
    worlds = evidence.world_count
    counts = np.bincount(evidence.worlds, weights=group.at_risk, minlength=worlds).astype(np.float64)
    hits = np.bincount(evidence.worlds, weights=group.failed, minlength=worlds)
    hit, missed = hits + 0.5, counts - hits + 0.5
    of_chance = float(np.mean(1 / hit + 1 / missed))
    return counts, np.log(hit / missed), min(of_chance, _MOST_OF_CHANCE)
