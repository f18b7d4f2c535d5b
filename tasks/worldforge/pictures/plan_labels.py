"""Places room labels on a drawn plan: inside the room, readable, off the furniture if there is space."""

from collections.abc import Iterable
from itertools import pairwise, product
from math import cos, sin
from typing import NamedTuple

import numpy as np

from ....schemas.worlds.polygons import contains
from ....schemas.worlds.world import Furniture, Point, Room

NAME_PX = 15
AREA_PX = 12
_HEIGHT_PX = 40
_PADDING_PX = 8
_GLYPH_WIDTH = 0.58
"""Mean width of a letter over the font's size: enough to fit labels without measuring fonts."""

_STEPS = np.array((0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8, 0.1, 0.9))
"""Places tried along each side of the room, the middle first."""

_NEAREST_FIRST = np.array(
    sorted(product(range(len(_STEPS)), repeat=2), key=lambda at: float(np.sum(np.abs(_STEPS[list(at)] - 0.5))))
)
"""Pairs of them, the middle of the room first, shape (81, 2)."""

_ORIGIN_MARK = (-0.3, -0.3, 0.3, 0.3)

Box = tuple[float, float, float, float]
"""West, south, east, north, in metres."""


class Label(NamedTuple):
    """A room's label: its text as far as it fits, its middle in metres, and whether it runs upwards."""

    name: str
    area: str
    x: float
    y: float
    upwards: bool


def place_label(room: Room, furniture: Iterable[Furniture], scale: float) -> Label:
    """Places a room's label.

    Args:
        room: the room.
        furniture: what to keep clear of where possible.
        scale: pixels per metre, because letters have their size in pixels.
    """
    room_box = widest_box(room)
    across, up = (room_box[2] - room_box[0]) * scale, (room_box[3] - room_box[1]) * scale
    area = f"{room.floor_m2:.1f} m²"
    wanted = max(len(room.name) * NAME_PX, len(area) * AREA_PX) * _GLYPH_WIDTH + 2 * _PADDING_PX
    upwards = wanted > across and up > across
    length = min(wanted, up if upwards else across)
    letters = max(4, round((length - 2 * _PADDING_PX) / (NAME_PX * _GLYPH_WIDTH)))
    name = room.name if len(room.name) <= letters else room.name[: letters - 1].rstrip() + "…"
    width, height = (_HEIGHT_PX, length) if upwards else (length, _HEIGHT_PX)
    obstacles = [_ORIGIN_MARK, *(_bounds(item) for item in furniture)]
    x, y = _clearest(room_box, width / scale, height / scale, obstacles)
    return Label(name, area, x, y, upwards)


def _clearest(room: Box, width: float, height: float, obstacles: list[Box]) -> Point:
    """The middle of the place for a box of this size that covers least, nearest to the room's middle."""
    west, south, east, north = np.array(obstacles).T[:, :, None]
    free_x, free_y = max(0.0, room[2] - room[0] - width), max(0.0, room[3] - room[1] - height)
    columns = room[0] + (room[2] - room[0] - free_x) / 2 + free_x * _STEPS
    rows = room[1] + (room[3] - room[1] - free_y) / 2 + free_y * _STEPS
    across = np.minimum(columns + width / 2, east) - np.maximum(columns - width / 2, west)
    up = np.minimum(rows + height / 2, north) - np.maximum(rows - height / 2, south)
    covered = np.sum(np.maximum(across, 0.0)[:, :, None] * np.maximum(up, 0.0)[:, None, :], axis=0)
    x, y = _NEAREST_FIRST[int(np.argmin(np.round(covered[tuple(_NEAREST_FIRST.T)], 3)))]
    return float(columns[x]), float(rows[y])


def _bounds(item: Furniture) -> Box:
    """The box around a piece of furniture."""
    c, s = abs(cos(item.yaw)), abs(sin(item.yaw))
    half_x = (item.depth_m * c + item.width_m * s) / 2
    half_y = (item.depth_m * s + item.width_m * c) / 2
    return item.x - half_x, item.y - half_y, item.x + half_x, item.y + half_y


def widest_box(room: Room) -> Box:
    """The largest rectangle inside a rectilinear room whose sides lie on lines through its corners."""
    xs, ys = sorted({x for x, _ in room.polygon}), sorted({y for _, y in room.polygon})
    gaps = [
        ((x0 + x1) / 2, (y0 + y1) / 2)
        for (x0, x1), (y0, y1) in product(pairwise(xs), pairwise(ys))
        if not contains(room.polygon, (x0 + x1) / 2, (y0 + y1) / 2)
    ]
    boxes = [
        (x0, y0, x1, y1)
        for x0, x1 in product(xs, xs)
        for y0, y1 in product(ys, ys)
        if x0 < x1 and y0 < y1 and not any(x0 < x < x1 and y0 < y < y1 for x, y in gaps)
    ]
    return max(boxes, key=lambda box: (box[2] - box[0]) * (box[3] - box[1]))
