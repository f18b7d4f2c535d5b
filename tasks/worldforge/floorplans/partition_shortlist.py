"""The best plans of rooms that fill a rectangle: all slicing trees are cut, the best ones refined and judged.

Nothing here is left to chance, so a process works it out once per brief, however many worlds it makes.
"""

from functools import lru_cache
from random import Random
from typing import NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from .brief import Brief
from .partition_costs import BatchEvaluator, Cuts, Flags, Floats, Nature, Trees, all_trees, cut

AREA_MARGIN = 0.03
"""Largest deviation of the logarithm of a floor's area from its preference; rounding to units comes on top."""

_REFINED = 240
"""Trees that are refined, the best ones as first cut."""

_STEPS = (0.12, 0.06, 0.03)
_OTHER_FOOTPRINTS = (0.25, -0.25, 0.5, -0.5, 0.8, -0.8)
"""Further outlines to begin with (logarithm of the ratio over the preferred one) where there are few rooms."""

_FEW_ROOMS = 5
SETTLINGS = 2
"""How often what walls take is measured and a plan cut again."""

_BENT_AREA = 0.015
_BENT_FOOTPRINT = 0.03


class Plans(Protocol):
    """Interface of a set of candidate floor plans, as arrays."""

    def take(self, columns: NDArray[np.intp]) -> Self:
        """Returns the selected candidates, in the order given."""
        ...

    def judged(self, evaluator: BatchEvaluator) -> tuple[Cuts, Nature]:
        """Cuts all candidates exactly, and evaluates them."""
        ...

    def varied(self, dice: Random) -> Self:
        """Returns the candidates with randomly changed numbers; the last one stays."""
        ...


class Variants(NamedTuple):
    """Candidate floor plans that fill a rectangle: slicing trees with room areas and ratios."""

    trees: Trees
    areas: Floats
    """Logarithm of each floor's area over its preferred area."""
    footprint: Floats
    """Logarithm of the extent along x over that along y."""
    walls: Floats
    """Logarithm of each room's area between the centre lines of its walls over that of its floor."""

    def take(self, columns: NDArray[np.intp]) -> "Variants":
        """Returns the selected candidates, in the order given."""
        trees = self.trees.take(columns)
        return Variants(trees, self.areas[:, columns], self.footprint[columns], self.walls[:, columns])

    def cut(self, evaluator: BatchEvaluator, *, exact: bool = False) -> Cuts:
        """Computes the room rectangles of all candidates."""
        areas = evaluator.areas * np.exp(self.areas + self.walls)
        return cut(self.trees, areas, np.exp(self.footprint), exact=exact)

    def judged(self, evaluator: BatchEvaluator) -> tuple[Cuts, Nature]:
        """Cuts all candidates exactly, and evaluates them."""
        cuts = self.cut(evaluator, exact=True)
        return cuts, evaluator.evaluate(cuts)

    def varied(self, dice: Random) -> "Variants":
        """Returns the candidates with randomly changed numbers; the last one stays."""
        rooms = len(self.areas)
        shifts = gaussian(dice, rooms + 1, len(self.footprint))
        areas = np.clip(self.areas + _BENT_AREA * shifts[:rooms], -AREA_MARGIN, AREA_MARGIN)
        return self._replace(areas=areas, footprint=self.footprint + _BENT_FOOTPRINT * shifts[rooms])

    def settled(self, evaluator: BatchEvaluator) -> "Variants":
        """Returns the candidates with the space that walls take corrected for their shapes."""
        walls = self.walls
        for _ in range(SETTLINGS):
            sides = evaluator.floors(self._replace(walls=walls).cut(evaluator))
            walls = walls + self.areas - np.log(sides[0] * sides[1] / evaluator.areas)
        return self._replace(walls=walls)


class Shortlist(NamedTuple):
    """The best valid candidate floor plans, best first."""

    evaluator: BatchEvaluator
    plans: Plans
    cost: Floats
    misses: Flags
    """Mask of missed preferences: (preference, plan); the footprint, each room's ratio, each room's area, each
    requested pair."""
    tried: int
    """How many plans were compared."""


def gaussian(dice: Random, numbers: int, plans: int) -> Floats:
    """Returns normally distributed random changes for each plan; none for the last one."""
    drawn = [[dice.gauss(0, 1) for _ in range(numbers)] for _ in range(plans - 1)]
    return np.array([*drawn, [0.0] * numbers]).T


@lru_cache(maxsize=64)
def shortlist(brief: Brief) -> Shortlist:
    """Finds the best floor plans with rectangular rooms in a rectangle; may be empty."""
    evaluator = BatchEvaluator(brief)
    trees = all_trees(len(brief.types))
    refined = _refined(evaluator, _beginnings(evaluator, trees, few=len(brief.types) <= _FEW_ROOMS))
    return best_first(evaluator, refined, trees.plans)


def best_first(evaluator: BatchEvaluator, plans: Plans, tried: int) -> Shortlist:
    """Returns the valid ones of some candidate plans, cheapest first."""
    _, nature = plans.judged(evaluator)
    order = np.argsort(nature.cost, kind="stable")
    order = order[nature.valid[order]]
    return Shortlist(evaluator, plans.take(order), nature.cost[order], nature.misses[:, order], tried)


def _beginnings(evaluator: BatchEvaluator, trees: Trees, *, few: bool) -> Variants:
    """The most promising trees with the preferred areas."""
    footprints = evaluator.footprint + np.array([0.0, *(_OTHER_FOOTPRINTS if few else ())])
    columns = np.tile(np.arange(trees.plans), len(footprints))
    every = Variants(
        trees.take(columns) if few else trees,
        np.zeros((len(evaluator.areas), len(columns))),
        np.repeat(footprints, trees.plans),
        np.repeat(evaluator.walls, len(columns), axis=1),
    )
    if len(columns) <= _REFINED:
        return every.settled(evaluator)
    cost = evaluator.shapes(every.cut(evaluator, exact=True))
    best = np.argsort(np.round(cost, 6), kind="stable")[: 4 * _REFINED]
    some = every.take(best).settled(evaluator)
    nature = evaluator.evaluate(some.cut(evaluator, exact=True))
    return some.take(np.argsort(nature.cost, kind="stable")[:_REFINED])


def _refined(evaluator: BatchEvaluator, start: Variants) -> Variants:
    """Bends areas, within their margin, and outlines, one at a time, as long as it makes the shapes better."""
    rooms, plans = start.areas.shape
    both = np.tile(np.arange(plans), 2)
    found = start
    for step in _STEPS:
        areas, footprint = found.areas.copy(), found.footprint.copy()
        twice = found.take(both)
        cost = evaluator.shapes(found.cut(evaluator))
        for number in range(-1, rooms):
            tried_areas, tried_footprint = np.tile(areas, 2), np.tile(footprint, 2)
            shift = np.repeat((step, -step), plans)
            if number < 0:
                tried_footprint += shift
            else:
                tried_areas[number] = np.clip(tried_areas[number] + shift, -AREA_MARGIN, AREA_MARGIN)
            tried = twice._replace(areas=tried_areas, footprint=tried_footprint)
            costs = evaluator.shapes(tried.cut(evaluator)).reshape(2, plans)
            # Rounded: another machine's last digit has to make no difference.
            side = (np.round(costs[1] - costs[0], 6) < 0).astype(int)
            better = np.flatnonzero(np.round(costs.min(axis=0) - cost, 6) < 0)
            chosen = side[better] * plans + better
            areas[:, better], footprint[better] = tried_areas[:, chosen], tried_footprint[chosen]
            cost[better] = costs.ravel()[chosen]
        found = found._replace(areas=areas, footprint=footprint).settled(evaluator)
    return found
