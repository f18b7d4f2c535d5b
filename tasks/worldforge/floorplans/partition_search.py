"""The choice of a partition: one of the best plans for a brief, bent a little, another one for other dice."""

from math import exp, sqrt
from random import Random

import numpy as np

from .brief import EXTERIOR_WALL, Brief
from .partition import UNITS_PER_M, Corners, Partition
from .partition_climb import climb_to_partition
from .partition_costs import as_partition
from .partition_setbacks import setback_shortlist
from .partition_shortlist import Shortlist, shortlist

_CHOICE_TEMPERATURE = 0.4
_CHOICE_MARGIN = 2.0
"""Cost margin above the best plan: a plan within it may be drawn because it satisfies as many preferences."""

_EQUAL_MARGIN = 1.5
"""Cost margin among those plans: how far off they are where they miss a preference counts too."""

_CONNECTION_WEIGHT = 3
"""As how many preferences of shape a requested connection counts."""

_POOR = 5.0
"""Cost of the best plan above which L-shaped rooms are tried as well, unless one grants all."""

_DRAWS = 4
_WORSE = 0.2
"""Largest cost that bending may add to a plan."""

Choice = tuple[Shortlist, int]
"""One plan of a list."""


def find_partition(brief: Brief, dice: Random) -> Partition:
    """Finds a partition that is valid and near the preferences, another one for other dice.

    Args:
        brief: the preferences.
        dice: the source of chance.

    Raises:
        WorldGenerationError: there is no valid partition of rectangles, and none with L-shaped rooms was found.
    """
    if len(brief.areas_m2) == 1:
        return _only_room(brief, dice)
    lists = shortlists(brief)
    if not any((~plans.misses.any(axis=0)).any() for plans in lists):
        least = min((float(plans.cost[0]) for plans in lists), default=None)
        if least is None or least > _POOR:
            bent = climb_to_partition(brief, dice, below=least)
            if bent is not None:
                return _mirrored(bent, dice)
    return _mirrored(_varied(_choice(lists, dice), dice), dice)


def shortlists(brief: Brief) -> list[Shortlist]:
    """The plans to choose from: those that fill a rectangle and, unless one of them grants all, those set back."""
    full = shortlist(brief)
    if full.cost.size and not full.misses[:, 0].any():
        return [full]
    return [plans for plans in (full, setback_shortlist(brief)) if plans.cost.size]


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


def _choice(lists: list[Shortlist], dice: Random) -> Choice:
    """One of the good plans: of those that miss fewest preferences, the better the likelier.

    So variety costs no preference: all plans that may be drawn satisfy equally many.
    """
    costs = np.concatenate([plans.cost for plans in lists])
    misses = np.concatenate([plans.misses for plans in lists], axis=1)
    weights = np.full(len(misses), 1)
    weights[1 + 2 * len(lists[0].evaluator.areas) :] = _CONNECTION_WEIGHT
    near = np.flatnonzero(costs <= costs.min() + _CHOICE_MARGIN)
    missed = weights @ misses[:, near]
    choices = near[missed == missed.min()]
    least = float(costs[choices].min())
    choices = choices[costs[choices] <= least + _EQUAL_MARGIN]
    odds = [exp((least - cost) / _CHOICE_TEMPERATURE) for cost in costs[choices].tolist()]
    number = dice.choices(choices.tolist(), odds)[0]
    first = len(lists[0].cost)
    return (lists[0], number) if number < first else (lists[1], number - first)


def _varied(choice: Choice, dice: Random) -> Partition:
    """A plan with its sides a little longer and shorter, as long as that breaks no preference that it satisfies."""
    best, number = choice
    columns = np.full(_DRAWS + 1, number)
    cuts, nature = best.plans.take(columns).varied(dice).judged(best.evaluator)
    granted = ~(nature.misses & ~best.misses[:, columns]).any(axis=0)
    fine = nature.valid & granted & (nature.cost <= best.cost[number] + _WORSE)
    return as_partition(cuts, int(fine.argmax()))


def _mirrored(plan: Partition, dice: Random) -> Partition:
    """The plan turned over at one, both or none of its axes: all equally good."""
    flip_x, flip_y = dice.random() < 0.5, dice.random() < 0.5

    def turn(corners: Corners) -> Corners:
        turned = [(plan.width - x if flip_x else x, plan.height - y if flip_y else y) for x, y in corners]
        return tuple(reversed(turned)) if flip_x != flip_y else tuple(turned)

    return plan._replace(rooms=tuple(turn(corners) for corners in plan.rooms))
