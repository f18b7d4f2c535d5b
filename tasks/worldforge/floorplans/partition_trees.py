"""Every way to cut a rectangle into rooms by straight cuts from side to side, as arrays.

A plan of `n` rooms is a slicing tree of `n - 1` cuts. The trees are numbered from 0 and kept side by side, one
column per tree, so that all of them can be cut and judged at the same time. Plans that are mirror images of each
other count once: the search turns its choice over at random afterwards.
"""

from collections.abc import Iterator
from functools import cache
from itertools import permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_SIX_ROOMS = 6
_SIX_ROOMS_STRIDE = 5
"""Stride through the orders of six rooms: each shape takes every fifth one, five times as fast and hardly worse."""

Node = int | tuple[bool, "Node", "Node"]
"""A place for a room, numbered from left to right, or (sideways, first, second)."""


class Trees(NamedTuple):
    """Slicing trees of `n` rooms; nodes 0 to n-1 are the rooms, node n + k is what cut k divides, n the whole."""

    first: NDArray[np.intp]
    """The node that each cut puts to the left or below: one row per cut, one column per tree."""
    second: NDArray[np.intp]
    """The node on the other side."""
    sideways: NDArray[np.bool_]
    """Whether the two lie side by side; otherwise the second lies above the first."""

    @property
    def plans(self) -> int:
        """How many trees there are."""
        return self.first.shape[1]

    def take(self, columns: NDArray[np.intp]) -> "Trees":
        """Some of the trees, in the order given."""
        return Trees(self.first[:, columns], self.second[:, columns], self.sideways[:, columns])


@cache
def all_trees(rooms: int) -> Trees:
    """All plans of two to five rooms (2, 12, 144, 2760), and an even fifth of the 71 280 plans of six rooms.

    Args:
        rooms: how many rooms there are.
    """
    every = np.array([*permutations(range(rooms))], dtype=np.intp)
    stride = _SIX_ROOMS_STRIDE if rooms >= _SIX_ROOMS else 1
    parts: list[Trees] = []
    for number, node in enumerate(_nodes(0, rooms)):
        orders = every[number % stride :: stride]
        chosen = orders[_is_first_of_its_mirror_images(node, orders)].T
        cuts: list[tuple[bool, Node, Node]] = []
        _number(node, cuts)
        index = {id(cut): rooms + number for number, cut in enumerate(cuts)}
        size = chosen.shape[1]

        def column(child: Node, chosen: NDArray[np.intp] = chosen, index: dict[int, int] = index) -> NDArray[np.intp]:
            return chosen[child] if isinstance(child, int) else np.full(chosen.shape[1], index[id(child)], np.intp)

        parts.append(
            Trees(
                np.array([column(cut[1]) for cut in cuts]),
                np.array([column(cut[2]) for cut in cuts]),
                np.repeat(np.array([[cut[0]] for cut in cuts]), size, axis=1),
            )
        )
    return Trees(*(np.concatenate(part, axis=1) for part in zip(*parts, strict=True)))


def _nodes(start: int, end: int, without: bool | None = None) -> Iterator[Node]:
    """All trees over the places from `start` to `end`, each plan once, whose top cut is not `without`.

    Three rooms in a row are one plan, whichever cut comes first: the second part never begins with the same cut.
    """
    if end - start == 1:
        yield start
        return
    for sideways in (True, False):
        if sideways == without:
            continue
        for middle in range(start + 1, end):
            for first in _nodes(start, middle):
                for second in _nodes(middle, end, without=sideways):
                    yield sideways, first, second


def _number(node: Node, cuts: list[tuple[bool, Node, Node]]) -> None:
    """Gathers the cuts, each after the one that makes its rectangle."""
    if not isinstance(node, int):
        cuts.append(node)
        _number(node[1], cuts)
        _number(node[2], cuts)


def _places(node: Node) -> list[int]:
    return [node] if isinstance(node, int) else [*_places(node[1]), *_places(node[2])]


def _row(node: tuple[bool, Node, Node]) -> list[Node]:
    """The parts of a node in a row: those that its cut and the same cuts in its first part divide."""
    sideways, first, second = node
    if isinstance(first, int) or first[0] != sideways:
        return [first, second]
    return [*_row(first), second]


def _is_first_of_its_mirror_images(node: Node, orders: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Marks one of the orders of rooms that are mirror images of each other along either axis."""
    if isinstance(node, int):
        return np.ones(len(orders), bool)
    row = _row(node)
    marked = _lowest(row[0], orders) < _lowest(row[-1], orders)
    for part in row:
        if not isinstance(part, int):
            across = _row(part)
            return marked & (_lowest(across[0], orders) < _lowest(across[-1], orders))
    return marked


def _lowest(node: Node, orders: NDArray[np.intp]) -> NDArray[np.intp]:
    """The lowest number of a room in a part of the tree, per order."""
    return orders[:, _places(node)].min(axis=1)
