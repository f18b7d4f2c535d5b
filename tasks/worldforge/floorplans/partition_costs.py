"""Evaluates many candidate floor plans at a time with NumPy arrays: slicing trees, room rectangles, and costs.

Arrays of plans have one column per plan. Costs are sums of deviations from the template's preferences; 0 is perfect.
"""

from collections.abc import Iterator
from functools import cache
from itertools import combinations, permutations
from math import log
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .brief import (
    DOOR_CLEARANCE,
    DOOR_WIDTH,
    EXTERIOR_WALL,
    FOOTPRINT_WEIGHTS,
    HABITABLE,
    INTERIOR_WALL,
    LIT_WALL,
    MISSED_CONNECTION,
    MISSED_PREFERENCE,
    NOT_CONNECTED,
    OPENING_WIDTH,
    OUTLIER,
    PUBLIC,
    RATIO_TOLERANCE,
    STRANGE_NEIGHBOURS,
    TOO_NARROW,
    Brief,
    affinity,
)
from .connections import AREA_TOLERANCE
from .partition import UNITS_PER_M, Partition

_SIX_ROOMS = 6
_SIX_ROOMS_STRIDE = 5
"""Stride through the orders of six rooms.

Each tree shape takes every fifth order, which is five times as fast and hardly worse.
"""

Node = int | tuple[bool, "Node", "Node"]
"""Node of a slicing tree: the number of a room's place, or (is side by side, first child, second child)."""


class Trees(NamedTuple):
    """Slicing trees of many candidate floor plans, as arrays: how each is cut into rooms."""

    first: NDArray[np.intp]
    """Number of the node that each cut puts to the left or below; one row per cut, one column per tree."""
    second: NDArray[np.intp]
    """Number of the node that each cut puts to the right or above, shaped as `first`."""
    sideways: NDArray[np.bool_]
    """Whether the two nodes of each cut are side by side; otherwise the second is above the first."""

    @property
    def plans(self) -> int:
        """Number of slicing trees in the arrays."""
        return self.first.shape[1]

    @property
    def leaves(self) -> int:
        """Number of leaves of each slicing tree: rooms, and notches."""
        return len(self.first) + 1

    def take(self, columns: NDArray[np.intp]) -> "Trees":
        """Returns the selected slicing trees, in the order given."""
        return Trees(self.first[:, columns], self.second[:, columns], self.sideways[:, columns])


@cache
def all_trees(rooms: int) -> Trees:
    """Enumerates the slicing trees of two to six rooms.

    Args:
        rooms: Number of rooms.
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
    """Yields all slicing trees for the rooms from `start` to `end` whose top cut is not `without`; each plan once.

    Three rooms in a row are one plan, whichever cut comes first, so the second part never begins with the same cut.
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
    """Collects the cuts of a tree in an order in which each comes after the cut that makes its rectangle."""
    if not isinstance(node, int):
        cuts.append(node)
        _number(node[1], cuts)
        _number(node[2], cuts)


def _places(node: Node) -> list[int]:
    return [node] if isinstance(node, int) else [*_places(node[1]), *_places(node[2])]


def _row(node: tuple[bool, Node, Node]) -> list[Node]:
    """Returns the parts of a node that are in a row, as divided by its cut and by equal cuts in its first part."""
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
    """Returns the lowest room number in a part of a slicing tree, for each order of rooms."""
    return orders[:, _places(node)].min(axis=1)


Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_AREA_WEIGHT = 0.25
_USUAL_WALLS = 2.6
"""Average amount by which a room's side is longer than its floor's, in grid units, as some sides have outer walls."""

_AREA_DOUBT = 0.002
"""Possible error of floor areas computed here, as a share: corners of set-back walls are not counted one by one."""

_DARK = 1.0
_AWAY_FROM_HALLWAY = 0.35
_BEHIND_PRIVATE = 0.7
"""Cost of a room that is reached only through a bedroom, a bath or a closet."""


class Cuts(NamedTuple):
    """Room rectangles of many candidate floor plans, as arrays."""

    low: Floats
    """Left and lower side of each room, shape (axis, room, plan), in grid units."""
    high: Floats
    """Right and upper side of each room, shape (axis, room, plan), in grid units."""

    def take(self, columns: NDArray[np.intp]) -> "Cuts":
        """Returns the rectangles of the selected floor plans, in the order given."""
        return Cuts(self.low[:, :, columns], self.high[:, :, columns])


class Nature(NamedTuple):
    """Cost, validity and missed preferences of many candidate floor plans, as arrays."""

    cost: Floats
    """Cost of each candidate floor plan."""
    valid: Flags
    """Whether every room of a plan is wide enough and can be reached."""
    misses: Flags
    """Mask of missed preferences: (preference, plan); the footprint, each room's ratio, each room's area, each
    requested pair."""
    togetherness: Floats
    """Part of the cost that comes from rooms without daylight and from unsuitable neighbours, per plan."""


def cut(trees: Trees, areas: Floats, ratios: Floats, *, exact: bool = False) -> Cuts:
    """Cuts each tree's rectangle so that every room gets its area.

    Args:
        trees: The cuts.
        areas: Square units: (room, plan).
        ratios: Extent along x over extent along y of each plan.
        exact: Round the cuts to whole units.
    """
    rooms, plans = areas.shape
    columns = np.arange(plans)
    first, second = trees.first * plans + columns, trees.second * plans + columns
    sizes = np.empty((2 * rooms - 1, plans))
    sizes[:rooms] = areas
    flat = sizes.ravel()
    for step in range(rooms - 2, -1, -1):
        np.add(flat[first[step]], flat[second[step]], out=sizes[rooms + step])
    sides = np.empty((2, 2, 2 * rooms - 1, plans))
    sides[0, :, rooms] = 0
    sides[1, 0, rooms] = np.sqrt(sizes[rooms] * ratios)
    sides[1, 1, rooms] = sizes[rooms] / sides[1, 0, rooms]
    if exact:
        np.rint(sides[1, :, rooms], out=sides[1, :, rooms])
    along = sides.reshape(2, 2, -1)
    for step in range(rooms - 1):
        low, high = sides[0, :, rooms + step], sides[1, :, rooms + step]
        middle = low + (high - low) * (flat[first[step]] / sizes[rooms + step])
        if exact:
            middle = np.rint(middle)
        across = np.array([trees.sideways[step], ~trees.sideways[step]])
        along[0][:, first[step]], along[1][:, first[step]] = low, np.where(across, middle, high)
        along[0][:, second[step]], along[1][:, second[step]] = np.where(across, middle, low), high
    return Cuts(sides[0, :, :rooms], sides[1, :, :rooms])


def fills_rectangle(cuts: Cuts) -> Flags:
    """Marks the floor plans whose rooms leave nothing empty in the rectangle around them."""
    whole = cuts.high.max(axis=1).prod(axis=0)
    # Less than a room could be, and more than sums of whole rooms are off.
    return whole - (cuts.high - cuts.low).prod(axis=0).sum(axis=0) < 1e-6 * whole


def exposed(cuts: Cuts) -> Floats:
    """Measures how long each side of a room is an outer wall: (low or high side, axis across it, room, plan)."""
    low, high = cuts
    one, other = (slice(None), slice(None), None), (slice(None), None, slice(None))
    meet = np.maximum(np.minimum(high[one], high[other]) - np.maximum(low[one], low[other]), 0.0)[::-1]
    covered = [
        np.where(np.abs(mine[one] - theirs[other]) < 1e-6, meet, 0.0).sum(axis=2)
        for mine, theirs in ((low, high), (high, low))
    ]
    return np.maximum((high - low)[::-1] - np.array(covered), 0.0)


def as_partition(cuts: Cuts, plan: int) -> Partition:
    """Returns one candidate of the arrays as a floor plan."""
    low, high = cuts.low[:, :, plan].astype(int).T.tolist(), cuts.high[:, :, plan].astype(int).T.tolist()
    boxes = [(*start, *end) for start, end in zip(low, high, strict=True)]
    return Partition(
        max(box[2] for box in boxes),
        max(box[3] for box in boxes),
        tuple(((x0, y0), (x1, y0), (x1, y1), (x0, y1)) for x0, y0, x1, y1 in boxes),
        tuple(min(x1 - x0, y1 - y0) for x0, y0, x1, y1 in boxes),
    )


class BatchEvaluator:
    """Computes the costs of many candidate floor plans with rectangular rooms at once."""

    def __init__(self, brief: Brief) -> None:
        types = brief.types
        self.pairs = np.array([*combinations(range(len(types)), 2)], dtype=np.intp).reshape(-1, 2).T
        self.areas = np.array(brief.areas_m2)[:, None] * UNITS_PER_M**2
        """Preferred floor areas of the rooms, in square grid units."""
        self.footprint = log(brief.footprint_ratio)
        self.footprint_weight = FOOTPRINT_WEIGHTS[min(len(types), 3)]
        self.least = np.array(brief.min_sides, dtype=float)[:, None]
        self.preferred = np.log(np.array(brief.ratios))[:, None]
        # A little off the limit, because sides are rounded to units.
        possible = np.log(np.maximum(0.97 * self.areas / (self.least - INTERIOR_WALL) ** 2, 1.0))
        self.ratios = np.minimum(self.preferred, possible)
        shorter = np.sqrt(self.areas / np.exp(self.ratios))
        self.walls = np.log((1 + _USUAL_WALLS / shorter) * (1 + _USUAL_WALLS * shorter / self.areas))
        """Estimated logarithm of each room's area between wall centre lines over its floor area."""
        self.longer = np.array([0.5 if kind == "Hallway" else 1.0 for kind in types])[:, None]
        self.habitable = np.array([kind in HABITABLE for kind in types])[:, None]
        self.public = np.array([kind in PUBLIC for kind in types])
        self.affinities = np.array([[affinity(one, other) for other in types] for one in types])
        self.hallways = np.array([kind == "Hallway" for kind in types])
        self.served = np.array([kind in ("Bedroom", "Bathroom", "Living") for kind in types]) & self.hallways.any()
        self.requests = [(self._number_of(pair), kind, count) for pair, kind, count in brief.requests]

    def _number_of(self, pair: tuple[int, int]) -> int:
        return next(number for number, known in enumerate(self.pairs.T) if tuple(known) == pair)

    def shapes(self, cuts: Cuts, *, roughly: bool = False) -> Floats:
        """Returns the cost of the rooms' areas and aspect ratios, for each plan.

        Args:
            cuts: Rectangles of the rooms.
            roughly: Take sides that are set back from the rectangle for inner walls, which is quicker.
        """
        off, narrow, areas = self._off(cuts, roughly=roughly)
        off_footprint = self._off_footprint(cuts)
        cost = self.footprint_weight * (off_footprint + MISSED_PREFERENCE * (off_footprint > RATIO_TOLERANCE))
        cost += (off + OUTLIER * off * off + MISSED_PREFERENCE * (off > RATIO_TOLERANCE)).sum(axis=0)
        cost += (_AREA_WEIGHT * areas + MISSED_PREFERENCE * (areas > AREA_TOLERANCE)).sum(axis=0)
        return cost + (TOO_NARROW * (narrow > 0) + narrow / UNITS_PER_M).sum(axis=0)

    def floors(self, cuts: Cuts, *, roughly: bool = False) -> Floats:
        """Returns the inner sizes of each room: (axis, room, plan).

        A side of which a part is an outer wall counts as much less as the floor loses there.
        """
        sides = cuts.high - cuts.low
        if roughly or fills_rectangle(cuts).all():
            limits = cuts.high.max(axis=1)[:, None]
            outer = (cuts.low == 0).astype(float) + (cuts.high == limits)
        else:
            outer = (exposed(cuts) / sides[::-1]).sum(axis=0)
        return np.maximum(sides - INTERIOR_WALL - outer * ((EXTERIOR_WALL - INTERIOR_WALL) // 2), 0.1)

    def _off_footprint(self, cuts: Cuts) -> Floats:
        """Returns the deviation of each plan's footprint from the preferred ratio."""
        width, height = cuts.high.max(axis=1)
        return np.abs(np.log(width / height) - self.footprint)

    def _off(self, cuts: Cuts, *, roughly: bool = False) -> tuple[Floats, Floats, Floats]:
        """Returns the rooms' deviations from preferred ratios, least width (in grid units), and preferred areas.

        Each has shape (room, plan). A hallway that is longer than preferred deviates less.
        """
        sides = self.floors(cuts, roughly=roughly)
        off = np.abs(np.log(sides[0] / sides[1])) - self.ratios
        narrow = np.maximum(0.0, self.least - (cuts.high - cuts.low).min(axis=0))
        # A hallway that is longer than preferred is still a good hallway.
        return np.where(off > 0, off * self.longer, -off), narrow, np.abs(sides[0] * sides[1] / self.areas - 1)

    def evaluate(self, cuts: Cuts) -> Nature:
        """Returns cost, validity and missed preferences of exactly cut plans."""
        spans = self._spans(cuts)
        doors = (spans - DOOR_CLEARANCE) // (DOOR_WIDTH + DOOR_CLEARANCE)
        fits = doors > 0
        missed = np.zeros(cuts.low.shape[2])
        misses = [self._off_footprint(cuts) > RATIO_TOLERANCE]
        for number, kind, count in self.requests:
            if kind == "Opening":
                fits[number] = spans[number] >= OPENING_WIDTH
            lacking = ~fits[number] if kind == "Opening" else np.maximum(0, count - np.maximum(0, doors[number]))
            missed += lacking
            misses.append(lacking > 0)
        rooms, plans = cuts.low.shape[1:]
        ways = np.zeros((plans, rooms, rooms), bool)
        ways[:, self.pairs[0], self.pairs[1]] = ways[:, self.pairs[1], self.pairs[0]] = fits.T
        sides = self.floors(cuts)
        ratios = np.abs(np.log(sides[0] / sides[1]))
        areas = np.abs(sides[0] * sides[1] / self.areas - 1)
        misses[1:1] = [*(np.abs(ratios - self.preferred) > RATIO_TOLERANCE), *(areas > AREA_TOLERANCE - _AREA_DOUBT)]
        reached = np.all(_closure(ways)[:, 0], axis=1)
        cost = self.shapes(cuts) + MISSED_CONNECTION * missed + NOT_CONNECTED * ~reached
        together = _DARK * (self.habitable & (self._outer(cuts) < LIT_WALL)).sum(axis=0) + self._neighbours(ways)
        cost += together
        wide = np.all(self._off(cuts)[1] <= 0, axis=0)
        # Rounded: another machine's last digit has to make no difference.
        valid = np.logical_and(reached, wide)
        return Nature(np.round(cost, 6), valid, np.array(misses), np.round(together, 6))

    def _spans(self, cuts: Cuts) -> Floats:
        """Returns for every pair of rooms the clear length of their shared wall, 0 without one; shape (pair, plan)."""
        one, other = self.pairs
        start = np.maximum(cuts.low[:, one], cuts.low[:, other])
        end = np.minimum(cuts.high[:, one], cuts.high[:, other])
        limits = cuts.high.max(axis=1)[:, None]
        overlap = end - start
        # Walls end at the faces of those they meet; where the outline is set back, that may be outer walls anywhere.
        outer = np.where(fills_rectangle(cuts), (start == 0).astype(float) + (end == limits), 2.0)
        clear = overlap - INTERIOR_WALL - outer * ((EXTERIOR_WALL - INTERIOR_WALL) // 2)
        touching = (overlap[::-1] == 0) & (overlap > 0)
        return np.where(touching, clear, 0.0).max(axis=0)

    def _outer(self, cuts: Cuts) -> Floats:
        """Returns for each room the length of outer wall on the side that has most of it."""
        return exposed(cuts).max(axis=(0, 1))

    def _neighbours(self, ways: Flags) -> Floats:
        """Returns for each candidate floor plan the cost of badly placed rooms, judged by the rooms next to them.

        A room costs if no room that it can be connected to suits its type, if it should be next to a hallway and is
        not, and if it can be reached only through private rooms, such as bedrooms.

        Args:
            ways: Whether two rooms can be connected; shape (plan, room, room).
        """
        best = (ways * self.affinities).max(axis=2)
        cost = STRANGE_NEIGHBOURS * (1 - best).sum(axis=1)
        if self.hallways.any():
            cost += _AWAY_FROM_HALLWAY * (self.served & ~ways[:, :, self.hallways].any(axis=2)).sum(axis=1)
        if not self.public.any():
            return cost
        through = _closure(ways & self.public[None, :, None] & self.public[None, None, :])
        beside_public = (ways & self.public[None, :, None]).any(axis=1)
        together = through[:, int(self.public.argmax())] | (beside_public & ~self.public)
        return cost + _BEHIND_PRIVATE * (~together).sum(axis=1)


def _closure(ways: Flags) -> Flags:
    """Returns a mask of the rooms that can be reached from each room (transitive closure of the connections)."""
    rooms = ways.shape[1]
    reached = (ways | np.eye(rooms, dtype=bool)).astype(np.float32)
    for _ in range(max(1, (rooms - 1).bit_length())):
        reached = np.minimum(reached @ reached, 1)
    return reached > 0
