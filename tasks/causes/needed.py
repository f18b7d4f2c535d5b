"""Number of trials with which an effect of the size that was seen would be told from chance.

It is planned as `robomaker plan --detect` does: by the exact McNemar test of pairs inside and outside a region, and
where six worlds or more are compared by the test that flips whole worlds.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...schemas.reports.live_comparison import FEWEST_WORLDS
from .evidence import Evidence, key_codes, varies
from .groups import Group
from .lift import Lift

POWER = 0.8
"""Chance with which the planned trials would show the effect, that of `robomaker plan --detect`."""
_FEWEST_PAIRS = 20
"""Pairs from which on the share that differ is taken from them; with fewer, sides count as independent."""
_MOST = 1_000_000
"""Trials of a job, at most; more are not told."""
_SEED = 20


@dataclass(frozen=True)
class Needed:
    """Numbers of trials, and of worlds, that would do."""

    trials: int
    worlds: int | None = None
    """Worlds in which they are; None: worlds do not decide."""


def trials_needed(
    evidence: Evidence, group: Group, region: NDArray[np.bool_], lift: Lift, least: int, alpha: float
) -> Needed | None:
    """Plans how many trials would show that failures are more frequent in a region by a difference of two rates.

    Args:
        evidence: The trials.
        group: The failures that are asked about.
        region: Which of the trials lie in the region.
        lift: Failure rates in the region and outside, those that were seen or others.
        least: Trials that a claim takes whatever the rates are.
        alpha: Error probability of the test, corrected for the number of tests.

    Returns:
        The numbers, larger than those that there are; None: there is no such effect, or it takes too many.
    """
    # They import scipy, which every process that runs or shows something would do without.
    from ..comparison.statistics.mcnemar import mcnemar_pairs_needed
    from ..comparison.statistics.sign_flips import worlds_needed

    difference = lift.inside - lift.outside
    if difference <= 0 or not group.count:
        return None
    discordant = min(1.0, max(difference, _discordant(evidence, group, region, lift)))
    at_risk = int(group.at_risk.sum())
    others = len(evidence) / at_risk  # trials that failed otherwise come, too
    changes = _changes_of_worlds(evidence, group, region)
    if evidence.world_count >= FEWEST_WORLDS and len(changes):
        each = len(evidence) / evidence.world_count
        is_of_worlds = not varies(evidence.worlds, region.astype(np.int64)).any()
        pairs = at_risk / evidence.world_count / (1 if is_of_worlds else 2)
        chance = np.random.default_rng(_SEED)
        worlds = worlds_needed(changes, pairs, difference, chance, discordant=discordant, alpha=alpha, power=POWER)
        worlds = max(worlds * (2 if is_of_worlds else 1), math.ceil(least / each), evidence.world_count + 1)
        return _told(Needed(math.ceil(worlds * each), worlds), evidence)
    pairs = mcnemar_pairs_needed(discordant, difference, alpha, POWER)
    share = float((region & group.at_risk).sum()) / at_risk
    total = max(pairs / min(share, 1 - share) * others, least)
    return _told(Needed(math.ceil(total)), evidence)


def _told(needed: Needed, evidence: Evidence) -> Needed | None:
    return needed if len(evidence) < needed.trials <= _MOST else None


def _discordant(evidence: Evidence, group: Group, region: NDArray[np.bool_], lift: Lift) -> float:
    """Returns the share of pairs, inside and outside of the region, of which one side fails."""
    blocks = key_codes([evidence.jobs, evidence.seeds])
    count = int(blocks.max(initial=0)) + 1
    sides = [_rates(blocks, group, group.at_risk & side, count) for side in (region, ~region)]
    both = np.isfinite(sides[0]) & np.isfinite(sides[1])
    inside, outside = (side[both] for side in sides) if both.sum() >= _FEWEST_PAIRS else (lift.inside, lift.outside)
    return float(np.mean(inside * (1 - outside) + outside * (1 - inside)))


def _changes_of_worlds(evidence: Evidence, group: Group, region: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Returns by how much the failure rate in the region exceeds that outside, in each world that has both.

    Of a region of whole worlds it is that of pairs of worlds, as many as there are.
    """
    sides = [_rates(evidence.worlds, group, group.at_risk & side, evidence.world_count) for side in (region, ~region)]
    changes = sides[0] - sides[1]
    if np.isfinite(changes).any():
        return changes[np.isfinite(changes)]
    inside, outside = (side[np.isfinite(side)] for side in sides)
    pairs = min(len(inside), len(outside))
    return inside[:pairs] - outside[:pairs]


def _rates(blocks: NDArray[np.int64], group: Group, trials: NDArray[np.bool_], count: int) -> NDArray[np.float64]:
    """Returns the failure rate of some trials in each block; NaN where it has none of them."""
    sizes = np.bincount(blocks, weights=trials, minlength=count)
    failed = np.bincount(blocks, weights=trials & group.failed, minlength=count)
    return np.where(sizes > 0, failed / np.maximum(sizes, 1), np.nan)
