"""Floor plans with preferred room shapes whose outline is set back where the rooms fill no rectangle."""

from functools import lru_cache
from itertools import product
from random import Random
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .brief import EXTERIOR_WALL, INTERIOR_WALL, RATIO_TOLERANCE, Brief
from .partition_costs import BatchEvaluator, Cuts, Flags, Floats, Nature, Trees, exposed
from .partition_evolution import MOST_TRIED, trees_of
from .partition_shortlist import (
    AREA_MARGIN,
    LEAST_EDGE,
    SETTLINGS,
    Shortlist,
    best_first,
    gaussian,
    has_long_edges,
    most_different,
)

RATIO_MARGIN = 0.9 * RATIO_TOLERANCE
"""Largest deviation of an aspect ratio's logarithm that is tried; rounding to grid units is added to it."""

_BENT_AREA = 0.015
_BENT_RATIO = 0.03

_SET_BACK = 0.3
_EMPTY_SHARE = 1.5
_EXTRA_OUTLINE = 2.0
_ENCLOSED = 20.0
"""Costs of outlines that are no rectangle.

They are: the cost of not being a rectangle, per empty share, per outer wall beyond those of the rectangle, and of a
yard without an open side.
"""

_JUDGED = 4800
_REFINED = 240
_STEPS = (0.08, 0.04, 0.02)
_USUAL_WALLS = 2.6
_BEGINNINGS = 40_000
"""Approximate number of candidates to begin with.

They are trees with rooms turned in all ways, or in other ways than in the trees before.
"""

_LEAST_TURNS = 3


class Setbacks(NamedTuple):
    """Candidate floor plans whose outline may be set back from a rectangle, as arrays."""

    trees: Trees
    lying: Flags
    """Whether a room's longer side is along x, shape (room, plan)."""
    areas: Floats
    """Logarithm of each room's floor area over its preferred area."""
    ratios: Floats
    """Logarithm of each room's aspect ratio over the preferred one."""
    walls: Floats
    """Length that walls add to the sides of floors, shape (axis, room, plan), in grid units."""

    def take(self, columns: NDArray[np.intp]) -> "Setbacks":
        """Returns the selected candidate floor plans, in the order given."""
        return Setbacks(
            self.trees.take(columns),
            self.lying[:, columns],
            self.areas[:, columns],
            self.ratios[:, columns],
            self.walls[:, :, columns],
        )

    def cut(self, evaluator: BatchEvaluator, *, exact: bool = False) -> Cuts:
        """Computes the room rectangles of all candidate floor plans."""
        return self.laid(evaluator, exact=exact)[0]

    def laid(self, evaluator: BatchEvaluator, *, exact: bool = False) -> tuple[Cuts, Flags]:
        """Computes the room rectangles of all candidates, and marks those with an enclosed yard."""
        areas = evaluator.areas * np.exp(self.areas)
        longer = np.sqrt(areas * np.exp(np.maximum(evaluator.ratios + self.ratios, 0.0)))
        shorter = areas / longer
        sides = np.array([np.where(self.lying, longer, shorter), np.where(self.lying, shorter, longer)]) + self.walls
        return put_together(self.trees, np.rint(sides) if exact else sides)

    def settled(self, evaluator: BatchEvaluator) -> "Setbacks":
        """Returns the candidates with the space that walls take corrected for their positions."""
        found = self
        for _ in range(SETTLINGS):
            cuts = found.cut(evaluator)
            outer = (exposed(cuts) / (cuts.high - cuts.low)[::-1]).sum(axis=0)
            found = found._replace(walls=INTERIOR_WALL + outer * ((EXTERIOR_WALL - INTERIOR_WALL) // 2))
        return found

    def judged(self, evaluator: BatchEvaluator) -> tuple[Cuts, Nature]:
        """Returns the exactly cut rectangles of all candidate floor plans, and their costs and validity."""
        cuts, enclosed = self.laid(evaluator, exact=True)
        nature = evaluator.evaluate(cuts)
        cost = np.round(nature.cost + outline_cost(cuts, enclosed), 6)
        return cuts, nature._replace(cost=cost, valid=has_long_edges(cuts, nature.valid & ~enclosed))

    def varied(self, dice: Random) -> "Setbacks":
        """Returns the candidate floor plans with randomly changed room sizes; the last plan is unchanged."""
        rooms, plans = self.areas.shape
        shifts = gaussian(dice, 2 * rooms, plans)
        areas = np.clip(self.areas + _BENT_AREA * shifts[:rooms], -AREA_MARGIN, AREA_MARGIN)
        ratios = np.clip(self.ratios + _BENT_RATIO * shifts[rooms:], -RATIO_MARGIN, RATIO_MARGIN)
        return self._replace(areas=areas, ratios=ratios)

    def rough_cost(self, evaluator: BatchEvaluator, *, roughly: bool = False) -> Floats:
        """Returns the approximate cost of room shapes and outlines of the candidate floor plans."""
        cuts, enclosed = self.laid(evaluator)
        return evaluator.shapes(cuts, roughly=roughly) + outline_cost(cuts, enclosed)


def put_together(trees: Trees, sides: Floats) -> tuple[Cuts, Flags]:
    """Places rooms of given sizes side by side, as the slicing trees say.

    Args:
        trees: The cuts.
        sides: Extents of the rooms: (axis, room, plan), in units.

    Returns:
        Rectangles of the rooms, and a mask of the plans with a yard without an open side.
    """
    _, rooms, plans = sides.shape
    columns = np.arange(plans)
    first, second = trees.first * plans + columns, trees.second * plans + columns
    sizes = np.empty((2, 2 * rooms - 1, plans))
    sizes[:, :rooms] = sides
    flat = sizes.reshape(2, -1)
    along = np.array([trees.sideways, ~trees.sideways])
    for step in range(rooms - 2, -1, -1):
        one, other = flat[:, first[step]], flat[:, second[step]]
        sizes[:, rooms + step] = np.where(along[:, step], one + other, np.maximum(one, other))
    low, granted = np.zeros_like(sizes), sizes.copy()
    starts, ends = np.ones(sizes.shape, bool), np.ones(sizes.shape, bool)
    enclosed = np.zeros(plans, bool)
    flat_low, flat_granted = low.reshape(2, -1), granted.reshape(2, -1)
    flat_starts, flat_ends = starts.reshape(2, -1), ends.reshape(2, -1)
    for step in range(rooms - 1):
        node = rooms + step
        ways, begin, whole = along[:, step], low[:, node], granted[:, node]
        open_start, open_end = starts[:, node], ends[:, node]
        more = whole - sizes[:, node]
        # The longer of two in a row is stretched where both have to be a little longer together.
        first_more = np.where(flat[:, first[step]] >= flat[:, second[step]], more, 0.0)
        at = begin
        for child, extra, is_first in ((first[step], first_more, True), (second[step], more - first_more, False)):
            size = flat[:, child]
            slack = whole - size
            back = ~ways & (slack >= LEAST_EDGE)
            given = np.where(ways, size + extra, np.where(back, size, whole))
            enclosed |= (back & ~open_start & ~open_end).any(axis=0)
            flat_granted[:, child] = given
            flat_low[:, child] = np.where(ways, at, begin + np.where(back & ~open_end, slack, 0.0))
            flat_starts[:, child] = np.where(ways, open_start & is_first, open_start | (back & ~open_end))
            flat_ends[:, child] = np.where(ways, open_end & (not is_first), open_end)
            at = at + np.where(ways, given, 0.0)
    return Cuts(low[:, :rooms], low[:, :rooms] + granted[:, :rooms]), enclosed


def outline_cost(cuts: Cuts, enclosed: Flags) -> Floats:
    """Returns the cost of each plan's building outline: 0 for a rectangle, more for empty corners or enclosed space."""
    sides = cuts.high - cuts.low
    whole = cuts.high.max(axis=1)
    empty = 1 - sides.prod(axis=0).sum(axis=0) / whole.prod(axis=0)
    outline = 2 * sides.sum(axis=(0, 1)) - 2 * _shared(cuts)
    extra = outline / (2 * whole.sum(axis=0)) - 1
    cost = _SET_BACK * (empty > 1e-6) + _EMPTY_SHARE * empty + _EXTRA_OUTLINE * np.maximum(extra, 0.0)
    return cost + _ENCLOSED * enclosed


def _shared(cuts: Cuts) -> Floats:
    """Returns the total length of borders that two rooms share, per floor plan."""
    rooms = cuts.low.shape[1]
    one, other = np.triu_indices(rooms, 1)
    overlap = np.minimum(cuts.high[:, one], cuts.high[:, other]) - np.maximum(cuts.low[:, one], cuts.low[:, other])
    touching = (np.abs(overlap[::-1]) < 1e-6) & (overlap > 0)
    return np.where(touching, overlap, 0.0).sum(axis=(0, 1))


@lru_cache(maxsize=64)
def setback_shortlist(brief: Brief) -> Shortlist:
    """Finds the best floor plans with rectangular rooms and a set-back outline; may be empty."""
    evaluator = BatchEvaluator(brief)
    every = _beginnings(trees_of(brief))
    # What judging takes grows with the square of the number of rooms.
    judged = round(_JUDGED * min(1.0, (MOST_TRIED / len(brief.types)) ** 2))
    best = np.argsort(np.round(every.rough_cost(evaluator, roughly=True), 6), kind="stable")[:judged]
    some = every.take(best).settled(evaluator)
    cuts, nature = some.judged(evaluator)
    refined = _refined(evaluator, some.take(most_different(cuts, nature.cost, _REFINED)))
    return best_first(evaluator, refined, every.trees.plans)


def _beginnings(trees: Trees) -> Setbacks:
    """Returns the floor plans to begin a search with: all slicing trees, with rooms turned either way."""
    rooms = trees.leaves
    turns = np.array([*product((False, True), repeat=rooms)])
    each = min(len(turns), max(_LEAST_TURNS, _BEGINNINGS // trees.plans))
    columns = np.tile(np.arange(trees.plans), each)
    # Odd steps share no factor with the number of turns, so they meet all of them.
    chosen = (27 * columns + 11 * np.repeat(np.arange(each), trees.plans)) % len(turns)
    lying = turns[chosen].T
    nothing = np.zeros(lying.shape)
    return Setbacks(trees.take(columns), lying, nothing, nothing, np.full((2, *lying.shape), _USUAL_WALLS))


def _refined(evaluator: BatchEvaluator, start: Setbacks) -> Setbacks:
    """Returns candidates with better ratios and areas, changed one at a time and within their margins.

    Each change is kept if it lowers the cost of shapes.
    """
    found = start
    for step in _STEPS:
        cost = found.rough_cost(evaluator)
        for number in range(len(evaluator.areas)):
            for shift in (step, -step):
                ratios = found.ratios.copy()
                ratios[number] = np.clip(ratios[number] + shift, -RATIO_MARGIN, RATIO_MARGIN)
                found, cost = _better(evaluator, found, cost, found._replace(ratios=ratios))
                areas = found.areas.copy()
                areas[number] = np.clip(areas[number] + shift, -AREA_MARGIN, AREA_MARGIN)
                found, cost = _better(evaluator, found, cost, found._replace(areas=areas))
        found = found.settled(evaluator)
    return found


def _better(evaluator: BatchEvaluator, found: Setbacks, cost: Floats, tried: Setbacks) -> tuple[Setbacks, Floats]:
    """Returns the cheaper of two sets of candidate floor plans, column by column, and its cost."""
    costs = tried.rough_cost(evaluator)
    # Rounded: another machine's last digit has to make no difference.
    better = np.round(costs - cost, 6) < 0
    ratios, areas = (
        np.where(better, new, old) for new, old in ((tried.ratios, found.ratios), (tried.areas, found.areas))
    )
    return found._replace(ratios=ratios, areas=areas), np.where(better, costs, cost)
