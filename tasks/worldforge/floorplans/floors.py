"""The floors of rooms: what walls leave of the rectangles between their centre lines."""

from .brief import EXTERIOR_WALL, INTERIOR_WALL
from .partition import Corners, Partition, area, extent, slenderness

AREA_TOLERANCE = 0.05
"""Share of the desired area by which a floor may be off."""


def inside_walls(plan: Partition) -> Partition:
    """The plan with every room's corners on the faces of its walls.

    Where a wall is taken away for an opening, the strip below it belongs to no room.
    """
    rooms = tuple(_inset(plan, corners) for corners in plan.rooms)
    return plan._replace(rooms=rooms, arms=tuple(map(_arm, rooms)))


def floor_areas(plan: Partition) -> list[float]:
    """Area of each room's floor, in square units."""
    return [area(corners) for corners in inside_walls(plan).rooms]


def floor_ratios(plan: Partition) -> list[float]:
    """Length over width of each room's floor."""
    inside = inside_walls(plan)
    return [slenderness(inside, room) for room in range(len(inside.rooms))]


def _inset(plan: Partition, corners: Corners) -> Corners:
    """Corners moved into the room, which lies to the left of every edge, by half the walls there."""
    moved: list[tuple[int, int]] = []
    for index, (x, y) in enumerate(corners):
        before, after = corners[index - 1], corners[(index + 1) % len(corners)]
        across, along = (before, after) if before[0] == x else (after, before)
        # One edge at the corner is upright, from or to `across`; the other is level.
        up = (y > across[1]) == (across is before)
        right = (x > along[0]) == (along is before)
        inward = -1 if up else 1, 1 if right else -1
        moved.append((x + inward[0] * _half_wall(x, plan.width), y + inward[1] * _half_wall(y, plan.height)))
    return tuple(moved)


def _half_wall(at: int, limit: int) -> int:
    return (EXTERIOR_WALL if at in (0, limit) else INTERIOR_WALL) // 2


def _arm(corners: Corners) -> int:
    """Narrowest width of a rectangle, or of an L."""
    box = extent(corners)
    if len(corners) == 4:
        return min(box.x1 - box.x0, box.y1 - box.y0)
    x = next((x for x, _ in corners if box.x0 < x < box.x1), box.x0)
    y = next((y for _, y in corners if box.y0 < y < box.y1), box.y0)
    # The corner of the box that is none of the room's lies in the pocket.
    west = not {(box.x0, box.y0), (box.x0, box.y1)} <= {*corners}
    south = not {(box.x0, box.y0), (box.x1, box.y0)} <= {*corners}
    return min(box.x1 - x if west else x - box.x0, box.y1 - y if south else y - box.y0)
