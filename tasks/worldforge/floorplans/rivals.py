"""Rivals of a missed preference: what the best plan that satisfies it would miss, or what forbids every plan."""

from collections.abc import Collection
from itertools import permutations
from math import log

import numpy as np

from .brief import RATIO_TOLERANCE, Brief
from .connections import Pair
from .floors import AREA_TOLERANCE, floor_areas, floor_ratios
from .partition import UNITS_PER_M, Partition
from .partition_search import shortlists

_FORBIDDEN = (
    "ab ac ad bc bd cd",
    "ab ac ad ae bc bd be",
    "ad ae af bd be bf cd ce cf",
    "ac ad ae af bc bd be bf ce cf de df",
)
"""The smallest sets of rooms and walls between them that no rectangle cut into up to six rectangles has: four that all
touch each other; two that touch, with three more that touch both; three that each touch three others; and six that
each touch all but one."""


def forbidden_together(requests: Collection[Pair], pair: Pair) -> list[Pair]:
    """The smallest set of requested ways, one of them `pair`, that no plan of rectangular rooms has; empty if none is.

    Args:
        requests: pairs of rooms, lower number first.
        pair: the one that a plan misses.
    """
    rooms = sorted({room for request in requests for room in request})
    for walls in _FORBIDDEN:
        letters = sorted({*walls} - {" "})
        for chosen in permutations(rooms, len(letters)):
            place = dict(zip(letters, chosen, strict=True))
            ways = sorted(_ordered(place[one], place[other]) for one, other in walls.split())
            if pair in ways and all(way in requests for way in ways):
                return ways
    return []


def _ordered(one: int, other: int) -> Pair:
    return (one, other) if one < other else (other, one)


def competing_preferences(brief: Brief, plan: Partition, missed: int) -> str:
    """Says at whose expense a preference could have been granted: at that of as few others as possible.

    Args:
        brief: the preferences, of two rooms or more.
        plan: the plan that misses one.
        missed: the number of that preference, in the order of the search.
    """
    lists = shortlists(brief)
    if not lists:
        return "no plan was found that grants it"
    misses = np.concatenate([plans.misses for plans in lists], axis=1)
    granting = np.flatnonzero(~misses[missed])
    if not len(granting):
        tried = sum(plans.tried for plans in lists)
        compared = f"none of the {misses.shape[1]} best plans of {tried} tried grants it"
        return f"{compared} together with the areas and the least widths"
    rivals = misses[:, granting] & ~_misses(brief, plan, len(misses))[:, None]
    costs = np.concatenate([plans.cost for plans in lists])[granting]
    fewest = np.lexsort((costs, rivals.sum(axis=0)))[0]
    names = [name for name, rival in zip(_names(brief), rivals[:, fewest].tolist(), strict=True) if rival]
    if names:
        return f"the best plan that grants it misses {' and '.join(names)}"
    return "a plan that grants it was found, and its rooms lie together worse than these"


def ratio_of(room: int) -> int:
    """The number of a room's ratio among the preferences."""
    return 1 + room


def way_of(brief: Brief, pair: Pair) -> int:
    """The number of a requested way among the preferences."""
    return 1 + 2 * len(brief.ratios) + [each for each, _, _ in brief.requests].index(pair)


FOOTPRINT = 0
"""The number of the footprint's ratio among the preferences."""


def _misses(brief: Brief, plan: Partition, preferences: int) -> np.ndarray:
    """Mask of the preferences of shape that the plan itself misses; requested ways count as satisfied."""
    missed = np.zeros(preferences, bool)
    missed[0] = abs(log(plan.width / plan.height / brief.footprint_ratio)) > RATIO_TOLERANCE
    rooms = len(brief.ratios)
    shapes = zip(brief.ratios, floor_ratios(plan), brief.areas_m2, floor_areas(plan), strict=True)
    for number, (ratio, actual, square_metres, floor) in enumerate(shapes):
        missed[1 + number] = abs(log(actual / ratio)) > RATIO_TOLERANCE
        missed[1 + rooms + number] = abs(floor / (square_metres * UNITS_PER_M**2) - 1) > AREA_TOLERANCE
    return missed


def _names(brief: Brief) -> list[str]:
    """The preferences in the order of the search, in words."""
    ratios = [f"the aspect ratio {ratio:.2f} of {name}" for name, ratio in zip(brief.names, brief.ratios, strict=True)]
    areas = [f"the area of {name}" for name in brief.names]
    pairs = [f"the way between {brief.names[low]} and {brief.names[high]}" for (low, high), _, _ in brief.requests]
    return [f"the footprint's {brief.footprint_ratio:.2f}", *ratios, *areas, *pairs]
