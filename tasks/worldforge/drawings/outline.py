"""Rooms on the grid of units: their overlaps, their floors, and the outline around all of them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..floorplans.partition import UNITS_PER_M, Corners, area, extent, turns
from ..floorplans.walls import Piece

Node = tuple[int, int]
Step = tuple[Node, Node]


def room_units(corners: Corners) -> NDArray[np.bool_]:
    """The units inside a room, of its extent: rows from south to north."""
    box = extent(corners)
    inside = np.zeros((box.y1 - box.y0, box.x1 - box.x0), np.bool_)
    for (x0, y0), (x1, y1) in zip(corners, [*corners[1:], corners[0]], strict=True):
        if x0 == x1:  # only upright edges cross an eastward ray
            inside[min(y0, y1) - box.y0 : max(y0, y1) - box.y0, x0 - box.x0 :] ^= True
    return inside


def floor_cells(corners: Corners, pieces: Sequence[Piece]) -> NDArray[np.bool_]:
    """The units of a room that no wall covers, of its extent."""
    box, cells = extent(corners), room_units(corners)
    for piece in pieces:
        if not piece.lintel:
            half = piece.thickness // 2
            along, across = (piece.start, piece.end), (piece.at - half, piece.at + half)
            (x0, x1), (y0, y1) = (along, across) if piece.horizontal else (across, along)
            cells[max(0, y0 - box.y0) : max(0, y1 - box.y0), max(0, x0 - box.x0) : max(0, x1 - box.x0)] = False
    return cells


def overlap(rooms: Sequence[Corners]) -> tuple[int, int, float] | None:
    """Two rooms that overlap, and by how many square metres; None if none do."""
    boxes = [extent(corners) for corners in rooms]
    owner = np.full((max(box.y1 for box in boxes), max(box.x1 for box in boxes)), -1)
    for number, corners in enumerate(rooms):
        box, units = boxes[number], room_units(corners)
        part = owner[box.y0 : box.y1, box.x0 : box.x1]
        taken = part[units & (part >= 0)]
        if len(taken):
            return int(taken[0]), number, int(np.count_nonzero(taken == taken[0])) / UNITS_PER_M**2
        part[units] = number
    return None


def outline_of(around: Sequence[Step]) -> Corners:
    """The corners around a building, counter-clockwise: the largest loop of what faces the outside.

    Args:
        around: sides of rooms that face the outside, each from end to end with its room to the left.
    """
    steps: dict[Node, list[Node]] = {}
    for one, other in around:
        steps.setdefault(one, []).append(other)
    best: list[Node] = []
    while steps:
        start = next(iter(steps))
        loop = [start]
        while (following := steps[loop[-1]].pop()) != start:
            if not steps[loop[-1]]:
                del steps[loop[-1]]
            loop.append(following)
        if not steps[loop[-1]]:
            del steps[loop[-1]]
        if area(loop) > area(best):
            best = loop
    return turns(best)
