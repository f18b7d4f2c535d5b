"""Chooses a floor plan: one of the good plans whose form no earlier plan of the order has, slightly varied.

The candidate plans are computed once per brief. A random order goes through all their forms before one is repeated, so
the plans of a generation job differ as long as there are others.
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
"""Largest cost above the cheapest plan's with which a plan can be the best one.

Of these plans, the one with the fewest missed preferences is the best one.
"""

_VARIETY_MARGIN = 4.0
"""Largest cost above the best plan's with which a plan may be chosen so that plans differ.

It allows a missed ratio and slightly unsuitable neighbours.
"""

_MAX_TOGETHERNESS_COST = 0.75
"""Largest part of that extra cost that may come from neighbours and daylight.

It allows about a way through a bedroom, but no room without daylight.
"""

_MORE_MISSES = 1
"""Number of preferences that a plan may miss in addition to those of the best plan, for each six rooms."""

_RATIO_LIMITS = tuple(round(log(ratio), 6) + 1e-6 for ratio in (1.25, 1.5))
"""Largest deviations of a room's aspect ratio from the preferred one, as logarithms.

The second one is used if the first allows few forms. Many plans are exactly at a limit; the rounding keeps another
machine's last digit from making a difference.
"""

_FEW_FORMS = 20
"""Number of different plan forms below which the second, larger ratio limit is used."""

_ODD_SHARE = 0.5
"""Limit of the forms with odd outlines, as a share of those with plain outlines (rectangles and clean L, T and U)."""

_MANY_FORMS = 75
"""Number of forms below which odd outlines are also used.

It is enough for 50 different worlds of a job, or 60 different plans among 200 seeds.
"""

_ODD_OUTLINE_FACTOR = 0.5
"""Factor of the odds of plans with odd outlines, so that they come later in an order."""

_CONNECTION_WEIGHT = 3
"""Weight of a requested connection that is missed, relative to one missed shape preference."""

_TEMPERATURE = 1.5
"""Difference in cost that makes a plan come first a third as often (softmax temperature)."""

_MOST_OFTEN = 0.06
"""Largest chance of any form to be the first of an order.

It is well below a tenth, so that counts of 200 seeds are below a tenth, too.
"""

_POOR_PLAN_COST = 5.0
"""Cost of the best plan above which L-shaped rooms are tried as well, unless a plan satisfies all preferences."""

_CLIMB_SEED = 1
"""Random seed of the search for floor plans with L-shaped rooms, where plans need not differ."""

_DRAWS = 4
_MAX_VARIATION_COST = 0.2
"""Largest cost that the random variation of room sizes may add to a floor plan."""


class Pool(NamedTuple):
    """Floor plans to choose from: one of each form, cheapest first."""

    lists: list[Shortlist]
    places: list[tuple[int, int]]
    """Index of each candidate plan's shortlist, and its index there."""
    odds: list[float]


def find_partition(brief: Brief, seed: PlanSeed, dice: Random) -> Partition:
    """Finds a valid floor plan near the template's preferences.

    Args:
        brief: The preferences.
        seed: Number of the plan in a random order; the brief says whether it is the best plan instead.
        dice: The source of chance for sizes and mirrored sides, and of searches for L-shaped rooms if plans differ.

    Raises:
        WorldGenerationError: There is no valid partition of rectangles, and none with L-shaped rooms was found.
    """
    if len(brief.areas_m2) == 1:
        return _only_room(brief, dice)
    lists = shortlists(brief)
    if not any((~plans.misses.any(axis=0)).any() for plans in lists):
        least = min((float(plans.cost[0]) for plans in lists), default=None)
        if least is None or (least > _POOR_PLAN_COST and len(brief.areas_m2) <= MOST_TRIED):
            climb_dice = dice if brief.diverse else Random(_CLIMB_SEED)  # noqa: S311 (chance, not secrecy)
            bent = climb_to_partition(brief, climb_dice, below=least)
            if bent is not None:
                return _mirrored(bent, dice)
    pool = plans_of(brief)
    return _mirrored(_varied(pool.lists, pool.places[_chosen(pool, seed)], dice), dice)


def shortlists(brief: Brief) -> list[Shortlist]:
    """Returns the candidate floor plans to choose from: in a rectangle, in one with notches, and set back freely.

    Lists without a valid plan are left out.
    """
    found = (shortlist(brief), *notched_shortlists(brief), setback_shortlist(brief))
    return [plans for plans in found if plans.cost.size]


@lru_cache(maxsize=64)
def plans_of(brief: Brief) -> Pool:
    """Selects the plans of a brief that may be chosen: one of each form, or only the best one if plans need not differ.

    No plan misses a preferred area or connection that the best plan satisfies; one more aspect ratio may be missed.

    Args:
        brief: The preferences of two rooms or more, for which there is a valid plan.
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
    fine &= together <= together[best] + _MAX_TOGETHERNESS_COST
    fine &= ~(misses[firm:] & ~misses[firm:, [best]]).any(axis=0)
    chosen = np.array([best])
    for limit in _RATIO_LIMITS:
        allowed = np.flatnonzero(fine & (off <= max(limit, off[best])))
        chosen = _one_of_each(allowed[np.argsort(costs[allowed], kind="stable")], forms, plain)
        if int(plain[chosen].sum()) >= _FEW_FORMS:
            break
    odds = np.exp((costs[chosen].min() - costs[chosen]) / _TEMPERATURE) * np.where(
        plain[chosen], 1.0, _ODD_OUTLINE_FACTOR
    )
    return Pool(lists, [places[number] for number in chosen.tolist()], capped(odds).tolist())


def _one_of_each(ordered: NDArray[np.intp], forms: NDArray[np.int64], plain: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Returns the first plan of each form, in the same order, with a limited number of odd outlines."""
    _, first = np.unique(forms[ordered], return_index=True)
    each = ordered[np.sort(first)]
    clean = int(plain[each].sum())
    most = max(round(_ODD_SHARE * clean), _MANY_FORMS - clean)
    return each[plain[each] | (np.cumsum(~plain[each]) <= most)]


def capped(odds: Floats) -> Floats:
    """Normalises odds to shares with none above the largest chance; all are equal where there are too few for that."""
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
    """Returns the plan at the seed's position in its random order.

    Likelier plans tend to come earlier, and none is repeated before all were used.
    """
    dice = Random(seed.order)  # noqa: S311 (chance, not secrecy)
    arrivals = [dice.expovariate(1) / odds for odds in pool.odds]
    order = sorted(range(len(arrivals)), key=arrivals.__getitem__)
    return order[seed.rank % len(order)]


def _only_room(brief: Brief, dice: Random) -> Partition:
    """Returns the plan of a single room.

    It is the footprint, turned as preferred, or randomly if the preference is square.
    """
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
    """Returns a plan whose side lengths are varied slightly at random.

    The plan is unchanged if that would break a preference or change its form. `place` is the number of its list, and
    its number there.
    """
    best, number = lists[place[0]], place[1]
    columns = np.full(_DRAWS + 1, number)
    cuts, nature = best.plans.take(columns).varied(dice).judged(best.evaluator)
    granted = ~(nature.misses & ~best.misses[:, columns]).any(axis=0)
    same = forms_of(cuts) == best.forms[number]
    fine = nature.valid & granted & same & (nature.cost <= best.cost[number] + _MAX_VARIATION_COST)
    return as_partition(cuts, int(fine.argmax()))


def _mirrored(plan: Partition, dice: Random) -> Partition:
    """Returns a plan that is mirrored randomly along x, y, both or neither: all are equally good."""
    flip_x, flip_y = dice.random() < 0.5, dice.random() < 0.5

    def turn(corners: Corners) -> Corners:
        turned = [(plan.width - x if flip_x else x, plan.height - y if flip_y else y) for x, y in corners]
        return tuple(reversed(turned)) if flip_x != flip_y else tuple(turned)

    return plan._replace(rooms=tuple(turn(corners) for corners in plan.rooms))
