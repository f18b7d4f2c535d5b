"""Shortlist of the best floor plans that fill a rectangle: all slicing trees are evaluated, the best ones refined.

Nothing here is random, so a process computes it once per brief, however many worlds it makes.
"""

from functools import lru_cache
from random import Random
from typing import NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from .brief import Brief
from .partition_costs import BatchEvaluator, Cuts, Flags, Floats, Nature, Trees, cut
from .partition_evolution import trees_of
from .plan_signature import forms_of, has_small_steps, is_plain

AREA_MARGIN = 0.03
"""Largest deviation of a floor area's logarithm from its preference; rounding to grid units is added to it."""

_REFINED = 240
"""Number of the best slicing trees that are refined, by their cost when first divided."""

_STEPS = (0.12, 0.06, 0.03)
_NOTCH_STEPS = 4
"""Factor of the step size when a notch's area is refined, as a notch may have any size."""

_OTHER_FOOTPRINTS = (0.25, -0.25, 0.5, -0.5, 0.8, -0.8)
"""Further footprints to begin with for few rooms, as logarithm of the ratio over the preferred one."""

_FEW_ROOMS = 5
SETTLINGS = 2
"""Number of times that a plan is divided again after the area that walls take was measured."""

_BENT_AREA = 0.015
_BENT_FOOTPRINT = 0.03


class Plans(Protocol):
    """Interface of a set of candidate floor plans, as arrays."""

    def take(self, columns: NDArray[np.intp]) -> Self:
        """Returns the selected candidate floor plans, in the order given."""
        ...

    def judged(self, evaluator: BatchEvaluator) -> tuple[Cuts, Nature]:
        """Returns the exactly cut rectangles of all candidate floor plans, and their costs and validity."""
        ...

    def varied(self, dice: Random) -> Self:
        """Returns the candidate floor plans with randomly changed sizes; the last plan is unchanged."""
        ...


LEAST_EDGE = 16
"""Shortest allowed edge of a building's outline, in grid units."""

NOTCH_SHARE = 0.12
"""Usual area of a notch, as a share of all floor areas."""


class Variants(NamedTuple):
    """Candidate floor plans that fill a rectangle, or one with notches: slicing trees with room areas and ratios."""

    trees: Trees
    """Slicing trees; notches are the leaves after the rooms."""
    areas: Floats
    """Logarithm of each floor area over its preferred area, and of a notch's area over the usual one.

    Its shape is (leaf, plan).
    """
    footprint: Floats
    """Logarithm of the footprint's extent along x over that along y."""
    walls: Floats
    """Logarithm of each leaf's area between wall centre lines over its floor area."""

    def take(self, columns: NDArray[np.intp]) -> "Variants":
        """Returns the selected candidate floor plans, in the order given."""
        trees = self.trees.take(columns)
        return Variants(trees, self.areas[:, columns], self.footprint[columns], self.walls[:, columns])

    def cut(self, evaluator: BatchEvaluator, *, exact: bool = False) -> Cuts:
        """Computes the room rectangles of all candidate floor plans."""
        rooms = len(evaluator.areas)
        notch = np.full((len(self.areas) - rooms, 1), NOTCH_SHARE * evaluator.areas.sum())
        areas = np.vstack([evaluator.areas, notch]) * np.exp(self.areas + self.walls)
        low, high = cut(self.trees, areas, np.exp(self.footprint), exact=exact)
        return Cuts(low[:, :rooms], high[:, :rooms])

    def judged(self, evaluator: BatchEvaluator) -> tuple[Cuts, Nature]:
        """Returns the exactly cut rectangles of all candidate floor plans, and their costs and validity."""
        cuts = self.cut(evaluator, exact=True)
        nature = evaluator.evaluate(cuts)
        if self.trees.leaves == len(evaluator.areas):
            return cuts, nature
        return cuts, nature._replace(valid=has_long_edges(cuts, nature.valid & is_plain(cuts)))

    def varied(self, dice: Random) -> "Variants":
        """Returns the candidate floor plans with randomly changed sizes; the last plan is unchanged."""
        leaves = len(self.areas)
        shifts = gaussian(dice, leaves + 1, len(self.footprint))
        limits = np.maximum(AREA_MARGIN, np.abs(self.areas))
        areas = np.clip(self.areas + _BENT_AREA * shifts[:leaves], -limits, limits)
        return self._replace(areas=areas, footprint=self.footprint + _BENT_FOOTPRINT * shifts[leaves])

    def settled(self, evaluator: BatchEvaluator) -> "Variants":
        """Returns the candidate floor plans with room areas corrected for the space that walls take."""
        walls, rooms = self.walls.copy(), len(evaluator.areas)
        for _ in range(SETTLINGS):
            sides = evaluator.floors(self._replace(walls=walls).cut(evaluator))
            walls[:rooms] += self.areas[:rooms] - np.log(sides[0] * sides[1] / evaluator.areas)
        return self._replace(walls=walls)


class Shortlist(NamedTuple):
    """The best valid floor plans of a search, best first."""

    evaluator: BatchEvaluator
    plans: Plans
    cost: Floats
    misses: Flags
    """Mask of missed preferences: (preference, plan); the footprint, each room's ratio, each room's area, each
    requested pair."""
    tried: int
    """Number of floor plans that the search compared."""
    forms: NDArray[np.int64]
    """Number of each plan's form (who touches whom); see `plan_signature`."""
    plain: Flags
    """Whether each plan's outline is a rectangle or a clean L, T or U."""
    off: Floats
    """Largest deviation of a room's aspect ratio (as logarithm) from the preferred one, per plan."""
    togetherness: Floats
    """Cost of rooms without daylight and of unsuitable neighbours, per plan."""


def gaussian(dice: Random, numbers: int, plans: int) -> Floats:
    """Returns normally distributed random numbers for each floor plan; zeros for the last one."""
    drawn = [[dice.gauss(0, 1) for _ in range(numbers)] for _ in range(plans - 1)]
    return np.array([*drawn, [0.0] * numbers]).T


@lru_cache(maxsize=64)
def shortlist(brief: Brief) -> Shortlist:
    """Finds the best floor plans with rectangular rooms in a rectangle; may be empty."""
    evaluator = BatchEvaluator(brief)
    trees = trees_of(brief)
    beginnings = _beginnings(evaluator, trees, few=len(brief.types) <= _FEW_ROOMS)
    return best_first(evaluator, refined(evaluator, beginnings), trees.plans)


def best_first(evaluator: BatchEvaluator, plans: Plans, tried: int) -> Shortlist:
    """Returns a shortlist of the valid ones among candidate floor plans, cheapest first."""
    cuts, nature = plans.judged(evaluator)
    order = np.argsort(nature.cost, kind="stable")
    order = order[nature.valid[order]]
    cuts = cuts.take(order)
    sides = evaluator.floors(cuts)
    # Rounded: another machine's last digit has to make no difference.
    off = np.round(np.abs(np.abs(np.log(sides[0] / sides[1])) - evaluator.preferred).max(axis=0), 6)
    return Shortlist(
        evaluator,
        plans.take(order),
        nature.cost[order],
        nature.misses[:, order],
        tried,
        forms_of(cuts),
        is_plain(cuts),
        off,
        nature.togetherness[order],
    )


def has_long_edges(cuts: Cuts, some: Flags) -> Flags:
    """Marks the candidate floor plans whose outline has no short edge."""
    columns = np.flatnonzero(some)
    found = some.copy()
    found[columns] = ~has_small_steps(cuts.take(columns), LEAST_EDGE)
    return found


def most_different(cuts: Cuts, cost: Floats, most: int) -> NDArray[np.intp]:
    """Selects plans to refine: the cheapest of each form first, then others; cheapest first among both.

    Args:
        cuts: Rectangles of the rooms.
        cost: Cost of each plan.
        most: Largest number of selected plans.
    """
    order = np.argsort(cost, kind="stable")
    _, first = np.unique(forms_of(cuts)[order], return_index=True)
    again = np.ones(len(order), bool)
    again[first] = False
    return order[np.argsort(again, kind="stable")][:most]


def _beginnings(evaluator: BatchEvaluator, trees: Trees, *, few: bool) -> Variants:
    """Returns the most promising slicing trees, with the preferred areas."""
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
    cuts, nature = some.judged(evaluator)
    return some.take(most_different(cuts, nature.cost, _REFINED))


def refined(evaluator: BatchEvaluator, start: Variants) -> Variants:
    """Returns candidates with better room areas (within their margin) and footprints, changed one at a time.

    Each change is kept if it lowers the cost of shapes.
    """
    leaves, plans = start.areas.shape
    rooms = len(evaluator.areas)
    both = np.tile(np.arange(plans), 2)
    found = start
    for step in _STEPS:
        areas, footprint = found.areas.copy(), found.footprint.copy()
        twice = found.take(both)
        cost = evaluator.shapes(found.cut(evaluator))
        for number in range(-1, leaves):
            tried_areas, tried_footprint = np.tile(areas, 2), np.tile(footprint, 2)
            shift = np.repeat((step, -step), plans)
            if number < 0:
                tried_footprint += shift
            elif number >= rooms:
                tried_areas[number] += _NOTCH_STEPS * shift
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
