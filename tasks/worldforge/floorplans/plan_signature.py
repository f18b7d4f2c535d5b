"""Signatures of floor plans: two plans with equal signatures count as the same, even if turned or mirrored.

A signature says which rooms touch on which sides, which pairs of rooms have doors or openings, and how many corners the
outline has. Sizes are no part of it. The form of a plan is its signature without the doors, which are chosen last.
"""

import hashlib
import json
from collections.abc import Iterable, Sequence
from enum import IntEnum
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....schemas.worlds.world import Floorplan
from .brief import EXTERIOR_WALL
from .partition import UNITS_PER_M, Corners, contacts
from .partition_costs import Cuts, Flags, Floats

_KEY_CHARACTERS = 12
"""Hexadecimal digits of a signature's key: two of a million plans share a key with a chance of one in five hundred."""


_MOST_PAIRS = 21
"""Limit of the pairs of rooms (of seven rooms) whose sides, with the number of corners, fit into a 64-bit integer."""
_WEIGHTS_SEED = 1


class Side(IntEnum):
    """Side of a room on which another room touches it."""

    EAST = 1
    WEST = 2
    NORTH = 3
    SOUTH = 4


_TURNS = (
    (0, 1, 2, 3, 4),
    (0, 2, 1, 3, 4),
    (0, 1, 2, 4, 3),
    (0, 2, 1, 4, 3),
    (0, 3, 4, 1, 2),
    (0, 4, 3, 1, 2),
    (0, 3, 4, 2, 1),
    (0, 4, 3, 2, 1),
)
"""The eight rotations and reflections of a plan: the new side for no side, east, west, north and south."""


class PlanSignature(NamedTuple):
    """Signature of a floor plan: everything that is equal in two plans that count as the same."""

    touches: tuple[tuple[int, int, int], ...]
    """Pairs of rooms by number, lower first, and the side of the first room on which the second touches it."""
    doors: tuple[tuple[int, int], ...]
    """Pairs of rooms of a floor plan that a doorway or an opening connects."""
    corners: int
    """Number of corners of a floor plan's outline."""

    @property
    def key(self) -> str:
        """Returns a short hexadecimal text that is equal for equal signatures, and practically never for others."""
        return hashlib.sha256(json.dumps(self).encode()).hexdigest()[:_KEY_CHARACTERS]


def plan_signature(rooms: Sequence[Corners], doors: Iterable[tuple[int, int]], corners: int) -> PlanSignature:
    """Computes the signature of a plan.

    Args:
        rooms: Corners of the rooms, counter-clockwise.
        doors: Pairs of rooms that a doorway or an opening joins, by number.
        corners: Number of corners of the outline.
    """
    found: set[tuple[int, int, Side]] = set()
    for contact in contacts(rooms):
        ahead, back = (Side.NORTH, Side.SOUTH) if contact.horizontal else (Side.EAST, Side.WEST)
        one, other = contact.low, contact.high
        found.add((one, other, ahead) if one < other else (other, one, back))
    touches = min(tuple(sorted((one, other, turn[side]) for one, other, side in found)) for turn in _TURNS)
    return PlanSignature(touches, tuple(sorted({(min(pair), max(pair)) for pair in doors})), corners)


def signature_of(plan: Floorplan) -> PlanSignature:
    """Computes the signature of a world's plan; rooms are numbered in the template's order."""
    numbers = {room.name: number for number, room in enumerate(plan.rooms)}
    rooms = [tuple((round(x * UNITS_PER_M), round(y * UNITS_PER_M)) for x, y in room.polygon) for room in plan.rooms]
    doors = [(numbers[way.rooms[0]], numbers[way.rooms[1]]) for way in plan.passages]
    return plan_signature(rooms, doors, len(plan.footprint))


def forms_of(cuts: Cuts) -> NDArray[np.int64]:
    """Numbers the forms of many plans of rectangular rooms: equal numbers for equal forms, and no others."""
    low, high = cuts
    one, other = np.array([*combinations(range(low.shape[1]), 2)], dtype=np.intp).reshape(-1, 2).T
    meet = np.minimum(high[:, one], high[:, other]) > np.maximum(low[:, one], low[:, other])
    ahead = (high[:, one] == low[:, other]) & meet[::-1]
    back = (low[:, one] == high[:, other]) & meet[::-1]
    sides = ahead[0] * Side.EAST + back[0] * Side.WEST + ahead[1] * Side.NORTH + back[1] * Side.SOUTH
    places = len(Side) + 1
    if len(one) <= _MOST_PAIRS:
        weights, beyond = places ** np.arange(len(one), dtype=np.int64), places ** len(one)
    else:
        # Sums wrap around: two of a million forms share a number with a chance of one in thirty million.
        *drawn, beyond = np.random.default_rng(_WEIGHTS_SEED).integers(-(2**63), 2**63, len(one) + 1, dtype=np.int64)
        weights = np.array(drawn)
    touches = np.min([weights @ np.array(turn)[sides] for turn in _TURNS], axis=0)
    return touches + outline_corners(cuts) * np.int64(beyond)


def outline_corners(cuts: Cuts) -> NDArray[np.int64]:
    """Counts the corners of each plan's outline."""
    return _at_corners(cuts)[1].sum(axis=0)


def is_plain(cuts: Cuts) -> Flags:
    """Marks the floor plans whose outline is a rectangle or a clean L, T or U."""
    corners = outline_corners(cuts)
    whole = cuts.high.max(axis=1)
    west, south = cuts.low == 0
    east, north = cuts.high == whole[:, None]
    # Corners of the bounding rectangle that the building fills, around it.
    filled = np.array([(x & y).any(axis=0) for x, y in ((west, south), (east, south), (east, north), (west, north))])
    count = filled.sum(axis=0)
    # A T lacks two neighbours of the four corners, a Z two opposite ones; a step within an L lacks one.
    is_t = (count == 2) & (filled != np.roll(filled, 2, axis=0)).all(axis=0)
    return (corners <= 6) | ((corners == 8) & ((count == 4) | is_t))


def has_small_steps(cuts: Cuts, least: int) -> Flags:
    """Marks the plans whose outline has an edge or a gap that is shorter than so many units.

    Two corners face each other across an edge or a gap, also where other corners lie between them. An inner wall that
    ends less than an outer wall's thickness beside a corner counts as well: the two would overlap.
    """
    points, turns = _at_corners(cuts)
    apart = np.abs(points[:, :, None] - points[:, None, :])
    lined, across = apart == 0, apart[::-1]
    near, beside = ((lined & (across > 0) & (across < limit)).any(axis=0) for limit in (least, EXTERIOR_WALL))
    return ((near & turns[:, None] & turns[None, :]) | (beside & turns[:, None])).any(axis=(0, 1))


def _at_corners(cuts: Cuts) -> tuple[Floats, Flags]:
    """Returns the corners of rooms as points (axis, point, plan), and a mask of the outline's corners, each once."""
    low, high = cuts
    points = np.concatenate([np.array([x, y]) for x in (low[0], high[0]) for y in (low[1], high[1])], axis=1)
    filled = np.zeros((4, *points.shape[1:]), bool)
    for number, shift in enumerate(((0.5, 0.5), (0.5, -0.5), (-0.5, -0.5), (-0.5, 0.5))):
        spots = (points + np.array(shift)[:, None, None])[:, :, None]
        filled[number] = np.any(np.all((low[:, None] < spots) & (spots < high[:, None]), axis=0), axis=1)
    first = np.ones(points.shape[1:], bool)
    same = (points[:, :, None] == points[:, None, :]).all(axis=0)
    for point in range(1, len(first)):
        first[point] = ~same[point, :point].any(axis=0)
    return points, first & (filled.sum(axis=0) % 2 == 1)
