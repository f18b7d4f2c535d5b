"""The choice of a partition: of all good plans one whose form no earlier plan of the order has, bent a little.

Which plans there are is found once per brief. An order, drawn from dice of its own, goes through all their forms before
one comes again; so the plans of a generation job differ as long as there are others.
"""

from functools import lru_cache
from math import ceil, log, sqrt
from random import Random
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .brief import EXTERIOR_WALL, Brief
from .partition import UNITS_PER_M, Corners, Partition
from .partition_climb import climb_to_partition
from .partition_costs import Floats, as_partition
from .partition_evolution import MOST_TRIED
from .partition_notches import notched_shortlists
from .partition_setbacks import setback_shortlist
from .partition_shortlist import Shortlist, shortlist
from .plan_seed import PlanSeed
from .plan_signature import forms_of

_CHOICE_MARGIN = 2.0
"""Cost above that of the cheapest plan within which the best one is looked for: of those with fewest misses."""

_VARIETY_MARGIN = 4.0
"""Cost above that of the best plan that a plan may have to differ: a missed ratio and rooms that lie together worse."""

_WORSE_TOGETHER = 0.75
"""The part of it that may come from how rooms lie together: about a way through a bedroom, less than a dark room."""

_MORE_MISSES = 1
"""Preferences that a plan may miss beyond the best one, for each six rooms."""

_RATIO_LIMITS = tuple(round(log(ratio), 6) + 1e-6 for ratio in (1.25, 1.5))
"""Largest deviations of a room's ratio; the second one is taken where the first leaves few forms. Many plans are
exactly at a limit: another machine's last digit has to make no difference."""

_FEW_FORMS = 20
"""Forms below which ratios give way further."""

_ODD_SHARE = 0.5
"""Most forms with other outlines than rectangles and clean L, T and U, over the number of those with such outlines."""

_MANY_FORMS = 75
"""While there are fewer forms than this, odd outlines are taken as well: enough for 50 different worlds of a job, or 60
different plans among 200 seeds."""

_ODD_ODDS = 0.5
"""Factor of the odds of plans with odd outlines, so that they come later."""

_CONNECTION_WEIGHT = 3
"""As how many preferences of shape a requested connection counts."""

_TEMPERATURE = 1.5
"""Difference in cost that makes a plan come first a third as often."""

_MOST_OFTEN = 0.06
"""Largest chance of any form to come first; well below a tenth, so that counts of 200 seeds stay below a tenth, too."""

_POOR = 5.0
"""Cost of the best plan above which L-shaped rooms are tried as well, unless one grants all."""

_CLIMB_SEED = 1
"""Seed of the search for L-shaped rooms where plans are not to differ."""

_DRAWS = 4
_WORSE = 0.2
"""Largest cost that bending may add to a plan."""


class Pool(NamedTuple):
    """Plans to choose from, one of each form, cheapest first."""

    lists: list[Shortlist]
    places: list[tuple[int, int]]
    """Each plan's list and its number there."""
    odds: list[float]


def find_partition(brief: Brief, seed: PlanSeed, dice: Random) -> Partition:
    """Finds a valid floor plan near the template's preferences.

    Args:
        brief: the preferences.
        seed: which plan of which order; whether it is the best one, the brief says.
        dice: the source of chance for sizes and mirrored sides, and of searches for L-shaped rooms if plans differ.

    Raises:
        WorldGenerationError: there is no valid partition of rectangles, and none with L-shaped rooms was found.
    """
    if len(brief.areas_m2) == 1:
        return _only_room(brief, dice)
    lists = shortlists(brief)
    if not any((~plans.misses.any(axis=0)).any() for plans in lists):
        least = min((float(plans.cost[0]) for plans in lists), default=None)
        if least is None or (least > _POOR and len(brief.areas_m2) <= MOST_TRIED):
            climb_dice = dice if brief.diverse else Random(_CLIMB_SEED)  # noqa: S311 (chance, not secrecy)
            bent = climb_to_partition(brief, climb_dice, below=least)
            if bent is not None:
                return _mirrored(bent, dice)
    pool = plans_of(brief)
    return _mirrored(_varied(pool.lists, pool.places[_chosen(pool, seed)], dice), dice)


def shortlists(brief: Brief) -> list[Shortlist]:
    """Returns the candidate floor plans to choose from: in a rectangle, in one with notches, and set back freely."""
    found = (shortlist(brief), *notched_shortlists(brief), setback_shortlist(brief))
    return [plans for plans in found if plans.cost.size]


@lru_cache(maxsize=64)
def plans_of(brief: Brief) -> Pool:
    """Selects the plans of a brief that may be chosen: one of each form, or the best one if none is to differ.

    Areas and connections are missed by none unless the best plan misses them too; one ratio more may be.

    Args:
        brief: the preferences of two rooms or more, for which there is a valid plan.
    """
    lists = shortlists(brief)
    places = [(number, column) for number, plans in enumerate(lists) for column in range(len(plans.cost))]
    costs, off, together, plain, forms = (
        np.concatenate([getattr(plans, name) for plans in lists])
        for name in ("cost", "off", "togetherness", "plain", "forms")
    )
    misses = np.concatenate([plans.misses for plans in lists], axis=1)
    firm = 1 + len(brief.areas_m2)
    weights = np.full(len(misses), 1)
    weights[2 * firm - 1 :] = _CONNECTION_WEIGHT
    missed = weights @ misses
    near = np.flatnonzero(costs <= costs.min() + _CHOICE_MARGIN)
    best = int(near[np.lexsort((costs[near], missed[near]))[0]])
    if not brief.diverse:
        return Pool(lists, [places[best]], [1.0])
    sixes = ceil(len(brief.areas_m2) / MOST_TRIED)
    fine = (missed <= missed[best] + sixes * _MORE_MISSES) & (costs <= costs[best] + sixes * _VARIETY_MARGIN)
    fine &= together <= together[best] + _WORSE_TOGETHER
    fine &= ~(misses[firm:] & ~misses[firm:, [best]]).any(axis=0)
    chosen = np.array([best])
    for limit in _RATIO_LIMITS:
        allowed = np.flatnonzero(fine & (off <= max(limit, off[best])))
        chosen = _one_of_each(allowed[np.argsort(costs[allowed], kind="stable")], forms, plain)
        if int(plain[chosen].sum()) >= _FEW_FORMS:
            break
    odds = np.exp((costs[chosen].min() - costs[chosen]) / _TEMPERATURE) * np.where(plain[chosen], 1.0, _ODD_ODDS)
    return Pool(lists, [places[number] for number in chosen.tolist()], capped(odds).tolist())


def _one_of_each(ordered: NDArray[np.intp], forms: NDArray[np.int64], plain: NDArray[np.bool_]) -> NDArray[np.intp]:
    """The first plan of each form, in the same order; with odd outlines only so many."""
    _, first = np.unique(forms[ordered], return_index=True)
    each = ordered[np.sort(first)]
    clean = int(plain[each].sum())
    most = max(round(_ODD_SHARE * clean), _MANY_FORMS - clean)
    return each[plain[each] | (np.cumsum(~plain[each]) <= most)]


def capped(odds: Floats) -> Floats:
    """Returns odds as shares, with none above the largest chance, or all equal where there are too few for that."""
    if len(odds) * _MOST_OFTEN <= 1:
        return np.full(len(odds), 1 / len(odds))
    shares = odds / odds.sum()
    full = np.zeros(len(odds), bool)
    while (shares > _MOST_OFTEN + 1e-9).any():
        full |= shares >= _MOST_OFTEN
        rest = np.where(full, 0.0, odds)
        shares = np.where(full, _MOST_OFTEN, rest / rest.sum() * (1 - _MOST_OFTEN * full.sum()))
    return shares


def _chosen(pool: Pool, seed: PlanSeed) -> int:
    """The plan whose turn it is: those of higher odds tend to come earlier, and all come before one comes again."""
    dice = Random(seed.order)  # noqa: S311 (chance, not secrecy)
    arrivals = [dice.expovariate(1) / odds for odds in pool.odds]
    order = sorted(range(len(arrivals)), key=arrivals.__getitem__)
    return order[seed.rank % len(order)]


def _only_room(brief: Brief, dice: Random) -> Partition:
    """The one room is the footprint, turned as the footprint is preferred or, if that is square, either way."""
    least = brief.min_sides[0] - EXTERIOR_WALL
    square_units = brief.areas_m2[0] * UNITS_PER_M**2
    ratio = min(brief.ratios[0], square_units / least**2)
    lying = dice.random() < 0.5 if brief.footprint_ratio == 1 else brief.footprint_ratio > 1
    short = max(least, round(sqrt(square_units / ratio)))
    long = max(least, round(square_units / short)) + EXTERIOR_WALL
    short += EXTERIOR_WALL
    width, height = (long, short) if lying else (short, long)
    return Partition(width, height, (((0, 0), (width, 0), (width, height), (0, height)),), (min(width, height),))


def _varied(lists: list[Shortlist], place: tuple[int, int], dice: Random) -> Partition:
    """A plan with its sides a little longer and shorter, if that breaks no preference and leaves its form."""
    best, number = lists[place[0]], place[1]
    columns = np.full(_DRAWS + 1, number)
    cuts, nature = best.plans.take(columns).varied(dice).judged(best.evaluator)
    granted = ~(nature.misses & ~best.misses[:, columns]).any(axis=0)
    same = forms_of(cuts) == best.forms[number]
    fine = nature.valid & granted & same & (nature.cost <= best.cost[number] + _WORSE)
    return as_partition(cuts, int(fine.argmax()))


def _mirrored(plan: Partition, dice: Random) -> Partition:
    """The plan turned over at one, both or none of its axes: all equally good."""
    flip_x, flip_y = dice.random() < 0.5, dice.random() < 0.5

    def turn(corners: Corners) -> Corners:
        turned = [(plan.width - x if flip_x else x, plan.height - y if flip_y else y) for x, y in corners]
        return tuple(reversed(turned)) if flip_x != flip_y else tuple(turned)

    return plan._replace(rooms=tuple(turn(corners) for corners in plan.rooms))
