"""The best plans of rectangular rooms for a brief: all slicing trees are cut, the best ones refined and judged.

Nothing here is left to chance, so a process works it out once per brief, however many worlds it makes.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....schemas.worlds.world import PassageKind, RoomType
from .brief import Brief
from .partition_costs import BatchEvaluator, Cuts, Flags, Floats, cut
from .partition_trees import Trees, all_trees

AREA_MARGIN = 0.07
"""Largest deviation of the logarithm of a room's area from its preference; rounding to units comes on top."""

_REFINED = 240
"""Trees that are refined, the best ones as first cut."""

_STEPS = (0.12, 0.06, 0.03)
_OTHER_FOOTPRINTS = (0.25, -0.25, 0.5, -0.5, 0.8, -0.8)
"""Further outlines to begin with (logarithm of the ratio over the preferred one) where there are few rooms."""

_FEW_ROOMS = 3


class Variants(NamedTuple):
    """Trees with the numbers that cut them; one column per plan."""

    trees: Trees
    areas: Floats
    """Logarithm of each room's area over its preferred area."""
    footprint: Floats
    """Logarithm of the extent along x over that along y."""

    def take(self, columns: NDArray[np.intp]) -> "Variants":
        """Some of the plans, in the order given."""
        return Variants(self.trees.take(columns), self.areas[:, columns], self.footprint[columns])

    def cut(self, evaluator: BatchEvaluator, *, exact: bool = False) -> Cuts:
        """Cuts all of them."""
        return cut(self.trees, evaluator.areas * np.exp(self.areas), np.exp(self.footprint), exact=exact)


class Shortlist(NamedTuple):
    """Plans for a brief, best first, none without a way to every room or with a room that is too narrow."""

    evaluator: BatchEvaluator
    variants: Variants
    cost: Floats
    misses: Flags
    """Which preferences each misses: (preference, plan); the footprint, each room's ratio, each requested pair."""
    tried: int
    """How many plans were compared."""


def shortlist(brief: Brief) -> Shortlist:
    """The best plans of at least two rectangular rooms; empty when there is none."""
    return _shortlist(*brief[:5], tuple(brief.requests.items()))


@lru_cache(maxsize=64)
def _shortlist(
    names: tuple[str, ...],
    types: tuple[RoomType, ...],
    areas_m2: tuple[float, ...],
    ratios: tuple[float, ...],
    footprint_ratio: float,
    requests: tuple[tuple[tuple[int, int], tuple[PassageKind, int]], ...],
) -> Shortlist:
    brief = Brief(names, types, areas_m2, ratios, footprint_ratio, dict(requests))
    evaluator = BatchEvaluator(brief)
    start = _beginnings(evaluator, all_trees(len(types)), few=len(types) <= _FEW_ROOMS)
    refined = _refined(evaluator, start)
    nature = evaluator.evaluate(refined.cut(evaluator, exact=True), refined.footprint, refined.areas)
    order = np.argsort(nature.cost, kind="stable")
    order = order[nature.valid[order]]
    tried = all_trees(len(types)).plans
    return Shortlist(evaluator, refined.take(order), nature.cost[order], nature.misses[:, order], tried)


def _beginnings(evaluator: BatchEvaluator, trees: Trees, *, few: bool) -> Variants:
    """The most promising trees with the preferred areas."""
    footprints = evaluator.footprint + np.array([0.0, *(_OTHER_FOOTPRINTS if few else ())])
    columns = np.tile(np.arange(trees.plans), len(footprints))
    every = Variants(
        trees.take(columns) if few else trees,
        np.zeros((len(evaluator.areas), len(columns))),
        np.repeat(footprints, trees.plans),
    )
    if len(columns) <= _REFINED:
        return every
    cuts = every.cut(evaluator, exact=True)
    cost = evaluator.shapes(cuts, every.footprint, every.areas)
    best = np.argsort(np.round(cost, 6), kind="stable")[: 4 * _REFINED]
    some = every.take(best)
    nature = evaluator.evaluate(Cuts(cuts.low[..., best], cuts.high[..., best]), some.footprint, some.areas)
    return some.take(np.argsort(nature.cost, kind="stable")[:_REFINED])


def _refined(evaluator: BatchEvaluator, start: Variants) -> Variants:
    """Bends areas, within their margin, and outlines, one at a time, as long as it makes the shapes better."""
    trees, areas, footprint = start.trees, start.areas.copy(), start.footprint.copy()
    rooms, plans = areas.shape
    twice = trees.take(np.tile(np.arange(plans), 2))
    cost = evaluator.shapes(start.cut(evaluator), footprint, areas)
    for step in _STEPS:
        for number in range(-1, rooms):
            tried_areas, tried_footprint = np.tile(areas, 2), np.tile(footprint, 2)
            shift = np.repeat((step, -step), plans)
            if number < 0:
                tried_footprint += shift
            else:
                tried_areas[number] = np.clip(tried_areas[number] + shift, -AREA_MARGIN, AREA_MARGIN)
            tried = Variants(twice, tried_areas, tried_footprint)
            costs = evaluator.shapes(tried.cut(evaluator), tried_footprint, tried_areas).reshape(2, plans)
            # Rounded: another machine's last digit has to make no difference.
            side = (np.round(costs[1] - costs[0], 6) < 0).astype(int)
            better = np.flatnonzero(np.round(costs.min(axis=0) - cost, 6) < 0)
            chosen = side[better] * plans + better
            areas[:, better], footprint[better] = tried_areas[:, chosen], tried_footprint[chosen]
            cost[better] = costs.ravel()[chosen]
    return Variants(trees, areas, footprint)
