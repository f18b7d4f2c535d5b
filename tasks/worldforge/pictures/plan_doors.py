"""Doors as architects draw them: the leaf as it stands at first, and the arc its free edge describes."""

from math import cos, pi, sin

from ....schemas.worlds.world import Door, Point
from ..doors.leaves import leaf_corners
from .plan_symbols import number

DOOR_STYLE = """
.fp-door{fill:#ffffff;stroke:#23272e;stroke-width:.018;stroke-linejoin:round}
.fp-swing{fill:none;stroke:#23272e;stroke-opacity:.6;stroke-width:.016}
"""
DARK_DOOR_STYLE = """
.fp-door{fill:#14171c;stroke:#d3d8df}
.fp-swing{stroke:#d3d8df}
"""


def door_svg(door: Door) -> str:
    """The SVG of a door, in metres and the world's axes."""
    corners = "L".join(f"{number(x)} {number(y)}" for x, y in leaf_corners(door))
    closed, opened = _free_edge(door, 0.0), _free_edge(door, door.max_angle_rad)
    radius = number(door.leaf_width_m)
    long_way, turn = int(door.max_angle_rad > pi), int(door.swing > 0)
    arc = f"M{_at(closed)}A{radius} {radius} 0 {long_way} {turn} {_at(opened)}"
    title = f"<title>{door.id}: {door.open_percent:g} % open</title>"
    return f'<g>{title}<path class="fp-swing" d="{arc}"/><path class="fp-door" d="M{corners}Z"/></g>'


def _free_edge(door: Door, angle_rad: float) -> Point:
    yaw = door.yaw_at(angle_rad)
    return door.hinge[0] + door.leaf_width_m * cos(yaw), door.hinge[1] + door.leaf_width_m * sin(yaw)


def _at(point: Point) -> str:
    return f"{number(point[0])} {number(point[1])}"
