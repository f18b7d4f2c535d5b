"""Floor plan symbols of furniture and doors, as architects draw them from above.

Every symbol is SVG in the piece's own frame: metres, the middle of its footprint at (0, 0), its front
towards +x, so `depth` runs along x and `width` along y. Nothing here depends on the room around it.
"""

from collections.abc import Callable
from math import cos, pi, sin

from ....schemas.worlds.world import Door, Point
from ..doors.door_parts import leaf_corners
from ..furniture.catalogue import CATALOGUE

Symbol = Callable[[float, float], str]
"""Function from (depth, width) in metres to SVG elements."""


def number(value: float) -> str:
    """Formats a coordinate in metres for SVG, to the millimetre."""
    text = f"{value:.3f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def symbol(model_type: str, depth: float, width: float) -> str:
    """Returns the SVG symbol of a furniture type; a plain outline for unknown types."""
    kind = CATALOGUE.get(model_type)
    return _SYMBOLS[kind.symbol if kind else "plain"](depth, width)


def _box(x: float, y: float, depth: float, width: float, radius: float = 0.0) -> str:
    """Returns the SVG of a rectangle around (x, y)."""
    corner = f' rx="{number(radius)}"' if radius else ""
    return (
        f'<rect x="{number(x - depth / 2)}" y="{number(y - width / 2)}" '
        f'width="{number(depth)}" height="{number(width)}"{corner}/>'
    )


def _line(x0: float, y0: float, x1: float, y1: float) -> str:
    return f'<line x1="{number(x0)}" y1="{number(y0)}" x2="{number(x1)}" y2="{number(y1)}"/>'


def _round(x: float, y: float, along: float, across: float) -> str:
    """Returns the SVG of an ellipse around (x, y) with the given half axes."""
    return f'<ellipse cx="{number(x)}" cy="{number(y)}" rx="{number(along)}" ry="{number(across)}"/>'


def _plain(depth: float, width: float) -> str:
    return _box(0, 0, depth, width)


def _table(depth: float, width: float) -> str:
    return _box(0, 0, depth, width, min(depth, width) * 0.08)


def _bed(depth: float, width: float) -> str:
    pillows = 2 if width > 1.25 else 1
    each = width / pillows
    length = min(0.4, depth * 0.2)
    head = -depth / 2 + depth * 0.04 + length / 2
    parts = [_box(0, 0, depth, width, 0.04)]
    for index in range(pillows):
        across = -width / 2 + each * (index + 0.5)
        parts.append(_box(head, across, length, each * 0.78, 0.07))
    fold = head + length / 2 + depth * 0.05
    parts.append(_line(fold, -width / 2, fold, width / 2))
    parts.append(_line(fold + depth * 0.09, -width / 2, fold + depth * 0.09, width / 2))
    return "".join(parts)


def _sofa(depth: float, width: float) -> str:
    back, arm = min(0.22, depth * 0.3), min(0.18, width * 0.16)
    seats = max(1, round((width - 2 * arm) / 0.7))
    parts = [_box(0, 0, depth, width, 0.06)]
    seat = (width - 2 * arm) / seats
    for index in range(seats):
        across = -width / 2 + arm + seat * (index + 0.5)
        parts.append(_box(back / 2, across, depth - back, seat, 0.05))
    return "".join(parts)


def _chair(depth: float, width: float) -> str:
    back = depth * 0.16
    rest = -depth / 2 + back / 2
    return _box(back / 2, 0, depth - back, width, 0.05) + _box(rest, 0, back, width * 0.96, back / 2)


def _desk_chair(depth: float, width: float) -> str:
    return _round(0, 0, depth / 2, width / 2) + _box(-depth * 0.4, 0, depth * 0.14, width * 0.7, depth * 0.06)


def _toilet(depth: float, width: float) -> str:
    tank = depth * 0.28
    bowl = (depth - tank) / 2
    seat = tank / 2
    return (
        _box(-depth / 2 + tank / 2, 0, tank, width, 0.03)
        + _round(seat, 0, bowl, width * 0.45)
        + _round(seat, 0, bowl * 0.68, width * 0.28)
    )


def _bath(depth: float, width: float) -> str:
    rim = min(0.07, depth * 0.1, width * 0.1)
    drain_x, drain_y = (-depth * 0.35, 0.0) if depth > width else (0.0, -width * 0.35)
    radius = min(depth, width) * 0.28
    return (
        _box(0, 0, depth, width)
        + _box(0, 0, depth - 2 * rim, width - 2 * rim, radius)
        + _round(drain_x, drain_y, 0.035, 0.035)
    )


def _shower(depth: float, width: float) -> str:
    x, y = depth / 2, width / 2
    return _box(0, 0, depth, width) + _line(-x, -y, x, y) + _line(-x, y, x, -y) + _round(0, 0, 0.06, 0.06)


def _basin(depth: float, width: float) -> str:
    bowls = 2 if width > 1.4 else 1
    each = width / bowls
    across, along = min(0.24, each * 0.36), min(0.17, depth * 0.34)
    parts = [_box(0, 0, depth, width)]
    for index in range(bowls):
        y = -width / 2 + each * (index + 0.5)
        parts += [_round(depth * 0.05, y, along, across), _round(-depth * 0.38, y, 0.025, 0.025)]
    return "".join(parts)


def _hob(depth: float, width: float) -> str:
    radius = min(depth, width) * 0.15
    rings = [
        _round(x * depth * 0.22, y * width * 0.23, radius * (1.1 if x == y else 0.8), radius * (1.1 if x == y else 0.8))
        for x in (-1, 1)
        for y in (-1, 1)
    ]
    return _box(0, 0, depth, width) + "".join(rings)


def _fridge(depth: float, width: float) -> str:
    door = depth / 2 - 0.06
    grip = width * 0.36
    return _box(0, 0, depth, width) + _line(door, -width / 2, door, width / 2) + _round(depth / 2, grip, 0.025, 0.025)


def _washer(depth: float, width: float) -> str:
    radius = min(depth, width) * 0.32
    panel = -depth / 2 + depth * 0.14
    return (
        _box(0, 0, depth, width) + _line(panel, -width / 2, panel, width / 2) + _round(depth * 0.05, 0, radius, radius)
    )


def _dish_washer(depth: float, width: float) -> str:
    x, y = depth / 2, width / 2
    return _box(0, 0, depth, width) + _line(-x, -y, x, 0) + _line(-x, y, x, 0)


def _island(depth: float, width: float) -> str:
    return _box(0, 0, depth, width, 0.03) + _box(0, 0, depth - 0.1, width - 0.1, 0.02)


def _cupboard(depth: float, width: float) -> str:
    """Returns the symbol of a tall cupboard: the plan's plane cuts it, hence the diagonal."""
    x, y = depth / 2, width / 2
    return _box(0, 0, depth, width) + _line(-x, -y, x, y)


def _corner_cabinet(depth: float, width: float) -> str:
    x, y = depth / 2, width / 2
    return _box(0, 0, depth, width) + _line(-x, y, x, -y)


def _shelf(depth: float, width: float) -> str:
    bays = max(2, round(width / 0.4))
    walls = [-width / 2 + width / bays * index for index in range(1, bays)]
    back = -depth / 2 + min(0.05, depth * 0.2)
    lines = [_line(back, y, depth / 2, y) for y in walls]
    return _box(0, 0, depth, width) + _line(back, -width / 2, back, width / 2) + "".join(lines)


def _drawers(depth: float, width: float) -> str:
    front = depth / 2 - min(0.05, depth * 0.15)
    return _box(0, 0, depth, width) + _line(front, -width / 2, front, width / 2) + _line(front, 0, depth / 2, 0)


def _lamp(depth: float, width: float) -> str:
    x, y = depth / 2, width / 2
    return _round(0, 0, x, y) + _line(-x, 0, x, 0) + _line(0, -y, 0, y)


def _ottoman(depth: float, width: float) -> str:
    return _box(0, 0, depth, width, min(depth, width) * 0.2)


_SYMBOLS: dict[str, Symbol] = {
    "plain": _plain,
    "basin": _basin,
    "bath": _bath,
    "bed": _bed,
    "chair": _chair,
    "corner_cabinet": _corner_cabinet,
    "cupboard": _cupboard,
    "desk_chair": _desk_chair,
    "dish_washer": _dish_washer,
    "drawers": _drawers,
    "fridge": _fridge,
    "hob": _hob,
    "island": _island,
    "lamp": _lamp,
    "ottoman": _ottoman,
    "shelf": _shelf,
    "shower": _shower,
    "sofa": _sofa,
    "table": _table,
    "toilet": _toilet,
    "washer": _washer,
}


DOOR_STYLE = """
.fp-door{fill:#ffffff;stroke:#23272e;stroke-width:.018;stroke-linejoin:round}
.fp-swing{fill:none;stroke:#23272e;stroke-opacity:.6;stroke-width:.016}
"""
DARK_DOOR_STYLE = """
.fp-door{fill:#14171c;stroke:#d3d8df}
.fp-swing{stroke:#d3d8df}
"""


def door_svg(door: Door) -> str:
    """Returns the SVG of a door, open as far as it is at first, with the arc of its whole swing, in metres."""
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
