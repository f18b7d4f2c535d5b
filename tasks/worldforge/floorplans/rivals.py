"""Competing preferences of a missed one: what the best plan that satisfies it would miss."""

from math import log

import numpy as np

from .brief import RATIO_TOLERANCE, Brief
from .partition import Partition, slenderness
from .partition_shortlist import shortlist


def competing_preferences(brief: Brief, plan: Partition, room: int) -> str:
    """Says at whose expense a room's aspect ratio could have been granted.

    Args:
        brief: the preferences, of two rooms or more.
        plan: the plan that misses the ratio.
        room: the room's number.
    """
    best = shortlist(brief)
    granting = np.flatnonzero(~best.misses[1 + room])
    if not len(granting):
        compared = f"none of the {len(best.cost)} best plans of {best.tried} tried grants it"
        return f"{compared} together with the areas and the least widths" if len(best.cost) else compared
    missed = best.misses[:, granting[0]] & ~_misses(brief, plan, best.misses.shape[0])
    names = [name for name, rival in zip(_names(brief), missed.tolist(), strict=True) if rival]
    if names:
        return f"the best plan that grants it misses {' and '.join(names)}"
    return "a plan that grants it was found, and this one was drawn for variety or for how its rooms lie together"


def _misses(brief: Brief, plan: Partition, preferences: int) -> np.ndarray:
    """Which preferences of shape the plan itself misses; requested ways count as satisfied."""
    missed = np.zeros(preferences, bool)
    missed[0] = abs(log(plan.width / plan.height / brief.footprint_ratio)) > RATIO_TOLERANCE
    for number, ratio in enumerate(brief.ratios):
        missed[1 + number] = abs(log(slenderness(plan, number) / ratio)) > RATIO_TOLERANCE
    return missed


def _names(brief: Brief) -> list[str]:
    """The preferences in the order of the search, in words."""
    ratios = [f"the aspect ratio {ratio:.2f} of {name}" for name, ratio in zip(brief.names, brief.ratios, strict=True)]
    pairs = [f"the way between {brief.names[low]} and {brief.names[high]}" for low, high in brief.requests]
    return [f"the footprint's {brief.footprint_ratio:.2f}", *ratios, *pairs]
