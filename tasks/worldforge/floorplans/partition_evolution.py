"""Evolutionary search for slicing trees of more than six rooms, which are too many to try them all.

Trees are changed a little, a generation at a time, and those whose plans cost least survive, first one of each form.
Equal briefs give equal trees: the random generator begins with the same seed each time.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .brief import Brief
from .partition_costs import BatchEvaluator, Cuts, Flags, Floats, Nature, Trees, all_trees, cut
from .plan_signature import forms_of

MOST_TRIED = 6
"""Largest number of rooms for which all slicing trees are tried."""

_SHAPES, _ORDERS = 120, 10
"""Random trees of the first generation: number of shapes, and number of random room orders for each."""

_GENERATIONS = 90
"""Generations of the search: two seconds for twelve rooms.

With half as many, the best plan misses one preference more.
"""

_LIVING = 240
"""Trees that survive each generation; more survivors find hardly better plans in the same time."""
_CHILDREN = 3
"""Changed copies of each surviving tree per generation; in the first generation, the random trees themselves."""
_KEPT = 1200
"""Number of slicing trees that the search returns, from all generations."""
_MOST_CHANGES = 3
_SEED = 1


def trees_of(brief: Brief) -> Trees:
    """Returns the slicing trees to try for a brief: all of them, or the best ones found.

    Args:
        brief: The preferences of two rooms or more.
    """
    return all_trees(len(brief.types)) if len(brief.types) <= MOST_TRIED else _bred_trees(brief)


@lru_cache(maxsize=16)
def _bred_trees(brief: Brief) -> Trees:
    evaluator = BatchEvaluator(brief)
    dice = np.random.default_rng(_SEED)
    living = _random_trees(len(brief.types), dice)
    found: list[tuple[Trees, Floats, NDArray[np.int64]]] = []
    for _ in range(_GENERATIONS):
        cuts, nature = _plans(living, evaluator)
        costs, forms = nature.cost, forms_of(cuts)
        order = _cheapest_of_each(costs, forms)[:_LIVING]
        living = living.take(order)
        found.append((living, costs[order], forms[order]))
        children = living.take(np.tile(np.arange(living.plans), _CHILDREN))
        for number in range(_MOST_CHANGES):
            # Most are changed once, some more often.
            chosen = dice.random(children.plans) < 0.5**number
            children = _changed(children, chosen, dice)
        living = _joined([living, children])
    every = _joined([trees for trees, _, _ in found])
    best = _cheapest_of_each(*(np.concatenate([each[part] for each in found]) for part in (1, 2)))
    return every.take(best[:_KEPT])


def _plans(trees: Trees, evaluator: BatchEvaluator) -> tuple[Cuts, Nature]:
    """Returns the plans of some trees, corrected approximately for the area of walls, and their costs."""
    ratios = np.full(trees.plans, np.exp(evaluator.footprint))
    walls = np.repeat(evaluator.walls, trees.plans, axis=1)
    rough = cut(trees, evaluator.areas * np.exp(walls), ratios)
    sides = evaluator.floors(rough)
    walls = walls - np.log(sides[0] * sides[1] / evaluator.areas)
    cuts = cut(trees, evaluator.areas * np.exp(walls), ratios, exact=True)
    return cuts, evaluator.evaluate(cuts)


def _cheapest_of_each(costs: Floats, forms: NDArray[np.int64]) -> NDArray[np.intp]:
    """Returns the indices of the cheapest floor plan of each form (who touches whom), cheapest first."""
    order = np.argsort(costs, kind="stable")
    _, first = np.unique(forms[order], return_index=True)
    return order[np.sort(first)]


def _joined(some: list[Trees]) -> Trees:
    return Trees(*(np.concatenate(part, axis=1) for part in zip(*some, strict=True)))


def _random_trees(rooms: int, dice: np.random.Generator) -> Trees:
    """Makes slicing trees of random shapes, with rooms in random orders and cuts in random directions."""
    firsts: list[NDArray[np.intp]] = []
    seconds: list[NDArray[np.intp]] = []
    for _ in range(_SHAPES):
        first, second = _random_shape(rooms, dice)
        for _ in range(_ORDERS):
            names = np.concatenate([dice.permutation(rooms), np.arange(rooms, 2 * rooms - 1)])
            firsts.append(names[first])
            seconds.append(names[second])
    sideways = dice.random((rooms - 1, len(firsts))) < 0.5
    return Trees(np.array(firsts).T, np.array(seconds).T, sideways)


def _random_shape(rooms: int, dice: np.random.Generator) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Returns the children of the cuts of a random tree; each cut comes after the one that makes its rectangle.

    The first and the second child of each cut are numbers: of rooms, or of cuts, which follow the rooms.
    """
    first, second = np.zeros((2, rooms - 1), np.intp)
    cuts = 0

    def node(start: int, end: int) -> int:
        nonlocal cuts
        if end - start == 1:
            return start
        own, cuts = cuts, cuts + 1
        middle = int(dice.integers(start + 1, end))
        first[own], second[own] = node(start, middle), node(middle, end)
        return rooms + own

    node(0, rooms)
    return first, second


def _changed(trees: Trees, chosen: Flags, dice: np.random.Generator) -> Trees:
    """Returns slicing trees with one random change in each of the chosen ones."""
    kind = dice.integers(0, 4, trees.plans)
    trees = _with_swapped_rooms(trees, chosen & (kind == 0), dice)
    trees = _with_turned_cut(trees, chosen & (kind == 1), dice)
    trees = _with_mirrored_cut(trees, chosen & (kind == 2), dice)
    return _with_rotation(trees, chosen & (kind == 3), dice)


def _with_swapped_rooms(trees: Trees, chosen: Flags, dice: np.random.Generator) -> Trees:
    rooms = trees.leaves
    one = dice.integers(0, rooms, trees.plans)
    other = (one + dice.integers(1, rooms, trees.plans)) % rooms
    other = np.where(chosen, other, one)
    first, second = (
        np.where(part == one, other, np.where(part == other, one, part)) for part in (trees.first, trees.second)
    )
    return trees._replace(first=first, second=second)


def _some_cut(trees: Trees, chosen: Flags, dice: np.random.Generator) -> Flags:
    """Returns a mask of one random cut of each chosen slicing tree, shape (cut, tree)."""
    cuts = len(trees.first)
    return (np.arange(cuts)[:, None] == dice.integers(0, cuts, trees.plans)) & chosen


def _with_turned_cut(trees: Trees, chosen: Flags, dice: np.random.Generator) -> Trees:
    return trees._replace(sideways=trees.sideways ^ _some_cut(trees, chosen, dice))


def _with_mirrored_cut(trees: Trees, chosen: Flags, dice: np.random.Generator) -> Trees:
    where = _some_cut(trees, chosen, dice)
    return trees._replace(
        first=np.where(where, trees.second, trees.first), second=np.where(where, trees.first, trees.second)
    )


def _with_rotation(trees: Trees, chosen: Flags, dice: np.random.Generator) -> Trees:
    """Returns the trees with a rotation at one cut of each chosen tree.

    ((a, b), c) becomes (a, (b, c)) where the order of cuts allows.
    """
    rooms, columns = trees.leaves, np.arange(trees.plans)
    upper = dice.integers(0, rooms - 1, trees.plans)
    lower, beside = trees.first[upper, columns], trees.second[upper, columns]
    # A cut comes after the one that makes its rectangle: the part beside has to come after the lower cut.
    fine = chosen & (lower >= rooms) & ((beside < rooms) | (beside > lower))
    columns, upper, lower, beside = columns[fine], upper[fine], lower[fine], beside[fine]
    first, second = trees.first.copy(), trees.second.copy()
    outer, inner = first[lower - rooms, columns], second[lower - rooms, columns]
    first[upper, columns], second[upper, columns] = outer, lower
    first[lower - rooms, columns], second[lower - rooms, columns] = inner, beside
    return trees._replace(first=first, second=second)
