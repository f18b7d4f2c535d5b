"""Cells that a robot reaches in a compiled world, and the widths of the passages between rooms."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ....schemas.worlds.world import Fault, Passage, Point, RoomWay, World, bounds
from ..geometry.occupancy import OccupancyGrid, fill, occupancy_grid
from .guarantees import MIN_PASSAGE_M
from .parts import room_at
from .scan import GRACE_M, Outlines, Scan

_JUNCTION_M = 0.051
"""Half the thickness of an inner wall, in metres: where a wall was replaced by an opening, walls across end there."""
_BESIDE_M = 0.5
"""Distance beyond a passage's described sides to which its clear width is measured, in metres."""


def ground_of(world: World, scan: Scan) -> OccupancyGrid:
    """Computes the map on which a robot's reach is measured, without door leaves.

    A robot that follows the world's map does not drive under tables, so the described outlines of furniture are
    obstacles, too; floors and everything that collides are the model's.

    Args:
        world: The world.
        scan: Scanned model of the world.
    """
    grid = occupancy_grid(world.floorplan, world.furniture)
    for _, outline in scan.standing:
        fill(grid, grid.occupied, outline, GRACE_M)
    grid.known[:] &= scan.floor(grid) | grid.occupied
    return grid


def with_leaves(ground: OccupancyGrid, leaves: Outlines) -> OccupancyGrid:
    """Returns a map with the leaves of doors on it.

    Args:
        ground: The map without.
        leaves: Their outlines: `scan.leaves` or `scan.open_leaves`.
    """
    grid = replace(ground, occupied=ground.occupied.copy())
    for _, outline in leaves:
        fill(grid, grid.occupied, outline, GRACE_M)
    return grid


def measure_ways(world: World, scan: Scan) -> tuple[list[RoomWay], list[Fault]]:
    """Measures the clear widths of all passages, with their doors fully open.

    Args:
        world: The world.
        scan: Scanned model of the world.

    Returns:
        The ways in the order of the passages, and those that are too narrow.
    """
    ways: list[RoomWay] = []
    faults: list[Fault] = []
    if not world.floorplan.passages:
        return ways, faults
    boxes = np.array([bounds(outline) for _, outline in scan.standing]).reshape(-1, 4)
    for passage in world.floorplan.passages:
        width_m, obstacle = _clear(passage, scan, boxes)
        door = passage.door
        ways.append(
            RoomWay(
                rooms=passage.rooms,
                kind=passage.kind,
                clear_width_m=round(width_m, 4) + 0.0,
                door=None if door is None else door.id,
            )
        )
        if width_m < MIN_PASSAGE_M - GRACE_M / 2:
            middle = tuple((a + b) / 2 for a, b in zip(passage.start, passage.end, strict=True))
            beside = f" beside {scan.called(obstacle)}" if obstacle is not None else ""
            said = f"{' - '.join(passage.rooms)} is {width_m:.2f} m wide{beside}"
            faults.append(Fault.placed("ways", said, middle, room_at(world, middle)))
    return ways, faults


def _clear(passage: Passage, scan: Scan, boxes: NDArray[np.float64]) -> tuple[float, int | None]:
    """Returns the widest gap along a passage's line in metres, and the geom at its side or in its middle.

    The geom is `None` if nothing stands there. Open door leaves before the passage count as obstacles.
    """
    along = 0 if passage.start[1] == passage.end[1] else 1
    line = passage.start[1 - along]
    first, last = sorted((passage.start[along], passage.end[along]))
    leaf = passage.door.id if passage.door else None
    near = (boxes[:, 2 + along] > first - _BESIDE_M) & (boxes[:, along] < last + _BESIDE_M)
    near &= (boxes[:, 3 - along] >= line - _JUNCTION_M) & (boxes[:, 1 - along] <= line + _JUNCTION_M)
    taken: list[tuple[float, float, int]] = []
    for index in np.flatnonzero(near).tolist():
        geom, outline = scan.standing[index]
        if (span := _span(outline, along, line - _JUNCTION_M, line + _JUNCTION_M)) is not None:
            taken.append((*span, geom))
    # A leaf that stands before the opening takes of its width, although it hangs beside the line.
    for geom, outline in scan.open_leaves:
        if scan.pieces[geom] == leaf:
            side = [point[along] for point in outline]
            taken.append((min(side), max(side), geom))
    begin, widest, beside = first - _BESIDE_M, 0.0, None
    middle = (first + last) / 2
    for low, high, geom in [*sorted(taken), (last + _BESIDE_M, np.inf, -1)]:
        widest = max(widest, low - begin)
        if low <= middle <= high or (beside is None and low < middle):
            beside = geom
        begin = max(begin, high)
    return float(widest), beside if beside != -1 else None


def _span(outline: Sequence[Point], along: int, low: float, high: float) -> tuple[float, float] | None:
    """Returns the extent along one axis of the part of a convex outline between two lines; `None` if there is none."""
    across = [point[1 - along] for point in outline]
    found = [point[along] for point, side in zip(outline, across, strict=True) if low <= side <= high]
    found += _cuts(outline, along, (low, high))
    return (min(found), max(found)) if found else None


def _cuts(outline: Sequence[Point], along: int, levels: tuple[float, float]) -> Iterator[float]:
    """Yields the coordinates along an axis at which the edges of an outline cross two lines."""
    for index, end in enumerate(outline):
        begin = outline[index - 1]
        for level in levels:
            before, after = begin[1 - along] - level, end[1 - along] - level
            if before * after < 0:
                yield begin[along] + (end[along] - begin[along]) * before / (before - after)


def share(part: NDArray[np.bool_], whole: NDArray[np.bool_]) -> float:
    """Returns the share of map cells that are reached, 0 to 1, to four digits; 0 if there are none to reach."""
    count = int(np.count_nonzero(whole))
    return round(int(np.count_nonzero(part)) / count, 4) if count else 0.0
