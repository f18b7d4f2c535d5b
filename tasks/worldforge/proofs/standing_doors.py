"""Ways through a world's doors as they stand at first, measured on what `world.json` holds.

The guarantees are about doors that a robot may push open; a robot that cannot push meets the doors as they stand.
"""

from collections.abc import Iterator, Sequence
from math import hypot

from ....schemas.worlds.world import Passage, Point, World
from ..doors.door_parts import leaf_corners, leaf_outlines
from ..geometry.occupancy import occupancy_grid, reachable

_ORIGIN = (0.0, 0.0)


def stands_open(passage: Passage) -> bool:
    """Whether nothing of a passage's door has to be pushed: it has none, or the door is fully open at first."""
    return passage.door is None or passage.door.open_percent >= 100


def clear_as_it_stands_m(passage: Passage) -> float:
    """Returns the shortest distance between a passage's door, as it stands at first, and the jamb opposite, in metres.

    Args:
        passage: A passage with a door.
    """
    door = passage.door
    assert door is not None
    hinge = door.hinge
    far, near = sorted((passage.start, passage.end), key=lambda end: -hypot(end[0] - hinge[0], end[1] - hinge[1]))
    along = 0 if passage.start[1] == passage.end[1] else 1
    half = abs(hinge[1 - along] - near[1 - along])  # hinges are on the wall's face
    first, last = ((far[0], far[1] + side) if along == 0 else (far[0] + side, far[1]) for side in (-half, half))
    leaf = leaf_corners(door)
    return min(passage.width_m, *_distances((first, last), leaf), *_distances(leaf, (first, last)))


def rooms_behind_doors(world: World) -> list[str]:
    """Lists the rooms that a robot cannot use without pushing a door: it does not reach their goals as doors stand.

    Args:
        world: The world, with its checks; their robot's radius is taken.
    """
    plan, checks = world.floorplan, world.checks
    if checks is None or all(stands_open(passage) for passage in plan.passages):
        return []
    grid = occupancy_grid(plan, world.furniture, leaf_outlines(plan))
    reached = reachable(grid, _ORIGIN, checks.robot_radius_m)
    return [
        room.name
        for room in plan.rooms
        if room.name in checks.closed_off_rooms or not reached[grid.cell(room.goal)]
        if room.name not in checks.unreachable_goals
    ]


def _distances(points: Sequence[Point], outline: Sequence[Point]) -> Iterator[float]:
    """Yields the distance of each point to each edge of an outline, in metres."""
    for x, y in points:
        for (x0, y0), (x1, y1) in zip(outline, (*outline[1:], outline[0]), strict=True):
            u, v = x1 - x0, y1 - y0
            share = max(0.0, min(1.0, ((x - x0) * u + (y - y0) * v) / (u * u + v * v)))
            yield hypot(x - x0 - share * u, y - y0 - share * v)
