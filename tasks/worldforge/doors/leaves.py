"""Poses of a hung door's leaf: closed, open, and everywhere between."""

from math import cos, sin

from ....schemas.worlds.polygons import bounds
from ....schemas.worlds.world import Door, Floorplan, Passage, Point, Wall
from ..geometry.boxes import Box

FULLY_OPEN_PERCENT = 100.0

HANDLE_M = 0.06
"""How far handles stand off the leaf."""


def lintel_over(plan: Floorplan, passage: Passage) -> Wall:
    """The piece of wall over a doorway."""
    ends = {passage.start, passage.end}
    return next(wall for wall in plan.walls if wall.lintel and {wall.start, wall.end} == ends)


def leaf_corners(door: Door, angle_rad: float | None = None) -> list[Point]:
    """The leaf's outline on the floor, counter-clockwise.

    Args:
        door: the door.
        angle_rad: how far it is open; None: as it is at first.
    """
    yaw = door.yaw_at(door.open_angle_rad if angle_rad is None else angle_rad)
    u, v = cos(yaw), sin(yaw)
    across = -door.swing * door.thickness_m
    corners = [(0.0, 0.0), (door.leaf_width_m, 0.0), (door.leaf_width_m, across), (0.0, across)]
    points = [(door.hinge[0] + x * u - y * v, door.hinge[1] + x * v + y * u) for x, y in corners]
    return points if door.swing < 0 else points[::-1]


def leaf_outlines(plan: Floorplan, *, fully_open: bool = False) -> list[list[Point]]:
    """The outlines of all leaves, as obstacles for a map.

    Args:
        plan: the plan.
        fully_open: as far open as they go, not as they are at first.
    """
    doors = [passage.door for passage in plan.passages if passage.door]
    return [leaf_corners(door, door.max_angle_rad if fully_open else None) for door in doors]


def swept_box(door: Door) -> Box:
    """The box around everything the leaf and its handles pass, from closed to fully open."""
    return _local_box(door, (-HANDLE_M, 0.0), (door.leaf_width_m, door.leaf_width_m))


def open_box(door: Door) -> Box:
    """The box around the fully open leaf."""
    return _local_box(door, (0.0, 0.0), (door.thickness_m, door.leaf_width_m))


def _local_box(door: Door, one: Point, other: Point) -> Box:
    """A box between two points given from the hinge along the closed leaf and into the room."""
    # Walls run along axes.
    along = (float(round(cos(door.closed_yaw))), float(round(sin(door.closed_yaw))))
    into = (-door.swing * along[1], door.swing * along[0])
    (x, y), points = door.hinge, (one, other)
    first, last = ((x + a * along[0] + b * into[0], y + a * along[1] + b * into[1]) for a, b in points)
    return bounds((first, last))
