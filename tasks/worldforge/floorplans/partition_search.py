"""The choice of a partition: one of the best plans for a brief, bent a little, another one for other dice."""

from math import exp, sqrt
from random import Random

import numpy as np

from .brief import Brief
from .partition import UNITS_PER_M, Corners, Partition
from .partition_climb import climb_to_partition
from .partition_costs import as_partition
from .partition_shortlist import AREA_MARGIN, Shortlist, Variants, shortlist

_CHOICE_TEMPERATURE = 0.6
_CHOICE_MARGIN = 1.0
"""What a plan may cost more than the best one, to be drawn because it satisfies more preferences."""

_ODD_SHARE = 0.08
_ODD_MARGIN = 5.0
_MOST_CHOICES = 60
"""One world in twelve may have any plan that is not bad: for variety, also at the expense of a preference."""

_POOR = 3.0
"""Cost of the best plan of rectangles above which L-shaped rooms are tried as well."""

_DRAWS = 4
_BENT_AREA = 0.02
_BENT_FOOTPRINT = 0.03
_WORSE = 0.2
"""By how much bending may add to the cost of a plan."""


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
    best = shortlist(brief)
    if best.cost.size and best.cost[0] <= _POOR:
        return _mirrored(_bent(best, _choice(best, dice), dice), dice)
    least = float(best.cost[0]) if best.cost.size else None
    plan = climb_to_partition(brief, dice, below=least)
    return _mirrored(plan or _bent(best, _choice(best, dice), dice), dice)


def _only_room(brief: Brief, dice: Random) -> Partition:
    """The one room is the footprint, turned as the footprint is preferred or, if that is square, either way."""
    least = brief.min_sides[0]
    square_units = brief.areas_m2[0] * UNITS_PER_M**2
    ratio = min(brief.ratios[0], square_units / least**2)
    lying = dice.random() < 0.5 if brief.footprint_ratio == 1 else brief.footprint_ratio > 1
    short = max(least, round(sqrt(square_units / ratio)))
    long = max(least, round(square_units / short))
    width, height = (long, short) if lying else (short, long)
    return Partition(width, height, (((0, 0), (width, 0), (width, height), (0, height)),), (min(width, height),))


def _choice(best: Shortlist, dice: Random) -> int:
    """The number of one of the good plans: of those that satisfy the most preferences, the better the likelier.

    None of them misses the footprint or a requested connection that the best one grants.
    """
    rooms = len(best.evaluator.areas)
    kept = np.delete(best.misses, range(1, rooms + 1), axis=0)
    fine = np.flatnonzero(~(kept & ~kept[:, :1]).any(axis=0) & (best.cost <= best.cost[0] + _ODD_MARGIN))
    if dice.random() < _ODD_SHARE:
        return dice.choice(fine[:_MOST_CHOICES].tolist())
    near = fine[best.cost[fine] <= best.cost[0] + _CHOICE_MARGIN]
    missed = best.misses[:, near].sum(axis=0)
    choices = near[missed == missed.min()]
    costs = best.cost[choices].tolist()
    return dice.choices(choices.tolist(), [exp((costs[0] - cost) / _CHOICE_TEMPERATURE) for cost in costs])[0]


def _bent(best: Shortlist, number: int, dice: Random) -> Partition:
    """A plan with its sides a little longer and shorter, as long as that breaks no preference that it satisfies."""
    rooms = len(best.evaluator.areas)
    columns = np.full(_DRAWS + 1, number)
    plain = best.variants.take(columns)
    shifts = np.array([[dice.gauss(0, 1) for _ in range(rooms + 1)] for _ in range(_DRAWS)] + [[0.0] * (rooms + 1)]).T
    areas = np.clip(plain.areas + _BENT_AREA * shifts[:rooms], -AREA_MARGIN, AREA_MARGIN)
    variants = Variants(plain.trees, areas, plain.footprint + _BENT_FOOTPRINT * shifts[rooms])
    cuts = variants.cut(best.evaluator, exact=True)
    nature = best.evaluator.evaluate(cuts, variants.footprint, variants.areas)
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
