"""Floor plans whose outline is a clean L, T or U: a rectangle divided into rooms and one or two empty notches.

Notches allow room shapes that a full rectangle does not, and the outline is still one that people build.
"""

from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from .brief import Brief
from .partition_costs import BatchEvaluator, Flags, Trees, all_trees
from .partition_evolution import MOST_TRIED, trees_of
from .partition_shortlist import Shortlist, Variants, best_first, most_different, refined
from .plan_signature import is_plain

_TREES = 24_000
"""Approximate number of trees with a notch that are evaluated; with more, a search takes notably longer."""

_BRED = 300
"""Number of the best slicing trees of many rooms that get notches."""

_SETTLED, _REFINED = 960, 240
"""Numbers of best plans: those whose walls are taken into account, and of these, those that are refined."""

_SHARES = (-0.5, 0.5)
"""Initial sizes of an empty notch in a floor plan, as logarithms of its area over the usual one."""


@lru_cache(maxsize=64)
def notched_shortlists(brief: Brief) -> list[Shortlist]:
    """Finds the best floor plans in a rectangle with one notch, and with two; both lists may be empty."""
    evaluator = BatchEvaluator(brief)
    rooms = len(brief.types)
    trees = notched_trees(rooms) if rooms <= MOST_TRIED else _with_notches(trees_of(brief).take(np.arange(_BRED)))
    plain = Variants(
        trees,
        np.zeros((rooms, trees.plans)),
        np.full(trees.plans, evaluator.footprint),
        np.repeat(evaluator.walls, trees.plans, axis=1),
    )
    found: list[Shortlist] = []
    for notches in (1, 2):
        begun = _best_begun(evaluator, plain)
        found.append(best_first(evaluator, refined(evaluator, _different(evaluator, begun)), plain.trees.plans))
        if notches == 1:
            trees, columns = with_notch(begun.trees, begun.trees.leaves - 1)
            plain = begun.take(columns)._replace(trees=trees)
    return found


def _best_begun(evaluator: BatchEvaluator, plain: Variants) -> Variants:
    """Returns the best plans, each with its last notch either rather small or rather large."""
    plans = plain.trees.plans
    twice = plain.take(np.tile(np.arange(plans), len(_SHARES)))
    notch = np.repeat(_SHARES, plans)[None]
    every = twice._replace(
        areas=np.concatenate([twice.areas, notch]), walls=np.concatenate([twice.walls, np.zeros_like(notch)])
    )
    # Rounded: another machine's last digit has to make no difference.
    cost = np.round(evaluator.shapes(every.cut(evaluator), roughly=True), 6)
    return every.take(np.argsort(cost, kind="stable")[:_SETTLED]).settled(evaluator)


def _different(evaluator: BatchEvaluator, some: Variants) -> Variants:
    cuts, nature = some.judged(evaluator)
    # Refining makes rooms wider and spans longer; it makes no outline plain.
    fine = np.flatnonzero(is_plain(cuts))
    return some.take(fine[most_different(cuts.take(fine), nature.cost[fine], _REFINED)])


@cache
def notched_trees(rooms: int) -> Trees:
    """Enumerates slicing trees whose last leaf is a notch; for many rooms, a random part that can be evaluated quickly.

    Args:
        rooms: Number of rooms, two to six.
    """
    return _with_notches(all_trees(rooms))


def _with_notches(trees: Trees) -> Trees:
    every, _ = with_notch(trees)
    return every.take(np.arange(0, every.plans, max(1, every.plans // _TREES)))


def with_notch(trees: Trees, notch: int | None = None) -> tuple[Trees, NDArray[np.intp]]:
    """Adds a notch to each tree in all ways: at a corner of the rectangle, or in the middle of a side.

    Args:
        trees: The trees.
        notch: A leaf that is a notch already, and gets none.

    Returns:
        The trees, with the new notch as the last leaf, and the numbers of those that they were made of.
    """
    touched = _touched(trees)
    parts: list[Trees] = []
    columns: list[NDArray[np.intp]] = []
    for node in range(len(touched)):
        for side in range(4 if node != notch else 0):
            across = touched[node, [2, 3] if side < 2 else [0, 1]]
            columns.append(np.flatnonzero(touched[node, side] & ~across.all(axis=0)))
            parts.append(_with_notch(trees.take(columns[-1]), node, side))
    return Trees(*(np.concatenate(part, axis=1) for part in zip(*parts, strict=True))), np.concatenate(columns)


def _touched(trees: Trees) -> Flags:
    """Returns a mask of the sides of the whole rectangle that each node touches.

    (node, west-east-south-north, tree).
    """
    found = np.zeros((2 * trees.leaves - 1, 4, trees.plans), bool)
    found[trees.leaves] = True
    columns = np.arange(trees.plans)
    for step in range(trees.leaves - 1):
        own = found[trees.leaves + step]
        for child, (level, upright) in ((trees.first[step], (1, 3)), (trees.second[step], (0, 2))):
            sides = own.copy()
            sides[level, trees.sideways[step]] = False
            sides[upright, ~trees.sideways[step]] = False
            found[child, :, columns] = sides.T
    return found


def _with_notch(trees: Trees, node: int, side: int) -> Trees:
    """Splits one node of the trees in two, of which the part on one side (west, east, south or north) is the notch."""
    leaves = trees.leaves
    at = node - leaves if node >= leaves else leaves - 1

    def moved(nodes: NDArray[np.intp]) -> NDArray[np.intp]:
        """Returns the new numbers of nodes after one leaf was added, and one cut at position `at`."""
        return np.where(nodes < leaves, nodes, nodes + 1 + (nodes - leaves >= at))

    first, second = (np.where(part == node, leaves + 1 + at, moved(part)) for part in (trees.first, trees.second))
    own, notch = (np.full((1, trees.plans), each, np.intp) for each in (int(moved(np.array(node))), leaves))
    low, high = (notch, own) if side in (0, 2) else (own, notch)
    upright = np.full((1, trees.plans), side < 2)
    return Trees(
        np.concatenate([first[:at], low, first[at:]]),
        np.concatenate([second[:at], high, second[at:]]),
        np.concatenate([trees.sideways[:at], upright, trees.sideways[at:]]),
    )
