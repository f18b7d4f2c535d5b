"""The plan of a world as a drawing: `floorplan.svg`.

The drawing carries its own colours, for light and for dark surroundings, and needs nothing else. For
drawing into it later, `<g id="world">` has metres as user units and the world's axes (y points up the
page); its last child is the empty `<g id="overlay">`. The same transform stands on the `<svg>` element as
`data-scale` (pixels per metre), `data-origin-x` and `data-origin-y` (the world's origin in pixels):

    pixel_x = data_origin_x + data_scale * x
    pixel_y = data_origin_y - data_scale * y
"""

from collections.abc import Iterable
from dataclasses import dataclass
from html import escape
from itertools import pairwise, product
from math import cos, degrees, hypot, sin
from re import sub
from typing import NamedTuple

import numpy as np

from ....schemas.worlds.world import Floorplan, Furniture, Passage, Point, Room, Wall, Window, World, bounds, contains
from ..decor.faces import walls_of_windows
from .plan_symbols import DARK_DOOR_STYLE, DOOR_STYLE, door_svg, number, symbol

NAME_PX = 15
AREA_PX = 12
_HEIGHT_PX = 40
_PADDING_PX = 8
_GLYPH_WIDTH = 0.58
"""Mean width of a letter as a share of the font size: enough to fit labels without measuring fonts."""

_STEPS = np.array((0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8, 0.1, 0.9))
"""Positions tried for a label along each side of the room, as shares of it, the middle first."""

_NEAREST_FIRST = np.array(
    sorted(product(range(len(_STEPS)), repeat=2), key=lambda at: float(np.sum(np.abs(_STEPS[list(at)] - 0.5))))
)
"""Index pairs of the label positions, the middle of the room first, shape (81, 2)."""

_ORIGIN_MARK = (-0.3, -0.3, 0.3, 0.3)

Box = tuple[float, float, float, float]
"""Rectangle: west, south, east, north, in metres."""


class Label(NamedTuple):
    """A room's label in a floor plan drawing: text, position in metres, and whether it is vertical."""

    name: str
    area: str
    x: float
    y: float
    upwards: bool


def place_label(room: Room, furniture: Iterable[Furniture], scale: float) -> Label:
    """Chooses the position of a room's label in a floor plan drawing.

    Args:
        room: The room.
        furniture: Furniture to avoid where possible.
        scale: Pixels per metre, because letters have their size in pixels.
    """
    room_box = widest_box(room)
    across, up = (room_box[2] - room_box[0]) * scale, (room_box[3] - room_box[1]) * scale
    area = f"{room.floor_m2:.1f} m²"
    called = room.called
    wanted = max(len(called) * NAME_PX, len(area) * AREA_PX) * _GLYPH_WIDTH + 2 * _PADDING_PX
    upwards = wanted > across and up > across
    length = min(wanted, up if upwards else across)
    letters = max(4, round((length - 2 * _PADDING_PX) / (NAME_PX * _GLYPH_WIDTH)))
    name = called if len(called) <= letters else called[: letters - 1].rstrip() + "…"
    width, height = (_HEIGHT_PX, length) if upwards else (length, _HEIGHT_PX)
    obstacles = [_ORIGIN_MARK, *(_bounds(item) for item in furniture)]
    x, y = _clearest(room_box, width / scale, height / scale, obstacles)
    return Label(name, area, x, y, upwards)


def _clearest(room: Box, width: float, height: float, obstacles: list[Box]) -> Point:
    """Returns the centre for a label of this size that covers the least furniture, nearest to the room's middle.

    Sizes and places are in metres. There must be at least one obstacle.
    """
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
    """Returns the bounding box of a piece of furniture."""
    c, s = abs(cos(item.yaw)), abs(sin(item.yaw))
    half_x = (item.depth_m * c + item.width_m * s) / 2
    half_y = (item.depth_m * s + item.width_m * c) / 2
    return item.x - half_x, item.y - half_y, item.x + half_x, item.y + half_y


def widest_box(room: Room) -> Box:
    """Returns the largest rectangle inside a room, as the place for the room's label.

    The sides run along x and y, in metres.
    """
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


_LONGEST_SIDE_PX = 960
_MAX_SCALE_PX = 64
_MIN_WIDTH_PX = 360
_MARGIN_PX = 56
_FOOTER_PX = 44

_STYLE = """
.fp{font-family:system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",Arial,sans-serif}
.fp-paper{fill:#ffffff}
.fp-Living{fill:#f7ecd9}.fp-Dining{fill:#f7e3d6}.fp-Kitchen{fill:#f3efcf}.fp-Hallway{fill:#eeecea}
.fp-Bedroom{fill:#dfe8f4}.fp-Bathroom{fill:#d8eeec}.fp-Closet{fill:#e8e3ee}
.fp-wall{fill:#23272e;stroke:#23272e;stroke-width:.012}
.fp-threshold{fill:#23272e;fill-opacity:.18}
.fp-opening{stroke:#23272e;stroke-opacity:.55;stroke-width:.025;stroke-dasharray:.14 .1;fill:none}
.fp-window{fill:#ffffff;stroke:#23272e;stroke-width:.025}
.fp-furniture{fill:#ffffff;fill-opacity:.75;stroke:#5a6472;stroke-width:.02;stroke-linejoin:round}
.fp-loose{fill:#ffffff;fill-opacity:.75;stroke:#b4542a;stroke-width:.02}
.fp-name,.fp-area,.fp-note{fill:#1b1f24;text-anchor:middle;dominant-baseline:central;paint-order:stroke;
stroke:#ffffff;stroke-opacity:.8;stroke-width:3px;stroke-linejoin:round}
.fp-name{font-size:15px;font-weight:600}.fp-area{font-size:12px;fill:#4b5563}
.fp-note{font-size:11px;fill:#4b5563;stroke:none}
.fp-line{stroke:#4b5563;stroke-width:1;fill:none}.fp-dark{fill:#4b5563}.fp-light{fill:#ffffff}
.fp-origin{stroke:#c2410c;stroke-width:.03;fill:none}
@media (prefers-color-scheme:dark){
.fp-paper{fill:#14171c}
.fp-Living{fill:#3a3327}.fp-Dining{fill:#3d2f28}.fp-Kitchen{fill:#383622}.fp-Hallway{fill:#2e2f31}
.fp-Bedroom{fill:#263140}.fp-Bathroom{fill:#213836}.fp-Closet{fill:#322d3b}
.fp-wall{fill:#d3d8df;stroke:#d3d8df}
.fp-threshold{fill:#d3d8df}
.fp-opening{stroke:#d3d8df}
.fp-window{fill:#14171c;stroke:#d3d8df}
.fp-furniture{fill:#14171c;fill-opacity:.45;stroke:#9aa5b4}
.fp-loose{fill:#14171c;fill-opacity:.45;stroke:#f0966b}
.fp-name,.fp-area,.fp-note{fill:#f2f4f7;stroke:#14171c}
.fp-area,.fp-note{fill:#b6bfcb}
.fp-line{stroke:#b6bfcb}.fp-dark{fill:#b6bfcb}.fp-light{fill:#14171c}
.fp-origin{stroke:#fb923c}
}
"""


_MORE_FLOORS = {
    "Office": ("#e3efdc", "#28352a"),
    "Storage": ("#ece4da", "#35302a"),
    "Balcony": ("#dde3d6", "#2a3029"),
}
"""Colours of further room types for light and dark mode; only plans with such rooms contain them."""


def _more_styles(plan: Floorplan) -> str:
    """Returns the CSS of further room types that a plan has."""
    there = [kind for kind in _MORE_FLOORS if any(room.type == kind for room in plan.rooms)]
    light, dark = ("".join(f".fp-{kind}{{fill:{_MORE_FLOORS[kind][part]}}}" for kind in there) for part in (0, 1))
    return f"{light}@media (prefers-color-scheme:dark){{{dark}}}" if there else ""


@dataclass(frozen=True)
class _Sheet:
    """Scale and position of the world on the floor plan's page."""

    scale: float
    origin_x: float
    origin_y: float
    width: float
    height: float
    west: float
    east: float
    south: float
    north: float

    def px(self, point: Point) -> Point:
        return self.origin_x + self.scale * point[0], self.origin_y - self.scale * point[1]


def floorplan_svg(world: World) -> str:
    """Draws the floor plan of a world as SVG.

    Args:
        world: The world; names in it are untrusted and come out escaped.

    Returns:
        A self-contained SVG document.
    """
    plan = world.floorplan
    sheet = _sheet(plan)
    scale = f"{number(sheet.scale)} {number(-sheet.scale)}"
    transform = f"translate({number(sheet.origin_x)} {number(sheet.origin_y)}) scale({scale})"
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" class="fp" role="img" aria-label="{_text(_summary(plan))}" '
        f'viewBox="0 0 {number(sheet.width)} {number(sheet.height)}" '
        f'width="{number(sheet.width)}" height="{number(sheet.height)}" data-scale="{number(sheet.scale)}" '
        f'data-origin-x="{number(sheet.origin_x)}" data-origin-y="{number(sheet.origin_y)}">',
        f"<style>{_STYLE}{_more_styles(plan)}{DOOR_STYLE}"
        f"@media (prefers-color-scheme:dark){{{DARK_DOOR_STYLE}}}</style>",
        '<rect class="fp-paper" width="100%" height="100%"/>',
        _dimensions(sheet),
        _scale_bar(sheet),
        _north_arrow(sheet),
        f'<g id="world" transform="{transform}">',
        *(_floor(room) for room in plan.rooms),
        *(_furniture(item) for item in world.furniture),
        *(_wall(wall) for wall in plan.walls),
        *(_window(plan.windows[number], wall.thickness_m) for number, wall in sorted(walls_of_windows(world).items())),
        *(_passage(passage) for passage in plan.passages),
        _origin_mark(),
        *(_label(room, world.furniture, sheet.scale) for room in plan.rooms),
        '<g id="overlay"></g>',
        "</g>",
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def _text(value: str) -> str:
    """Escapes an untrusted text for content and attributes; characters that XML forbids are dropped."""
    # Printable characters are all allowed; preparing the expression takes longer than drawing the plan.
    if value.isprintable():
        return escape(value)
    return escape(sub("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "", value))


def _summary(plan: Floorplan) -> str:
    return f"Floor plan with {len(plan.rooms)} rooms: {', '.join(room.name for room in plan.rooms)}"


def _thickness(plan: Floorplan) -> float:
    return max(wall.thickness_m for wall in plan.walls)


def _sheet(plan: Floorplan) -> _Sheet:
    half = _thickness(plan) / 2
    x0, y0, x1, y1 = bounds(plan.footprint)
    west, south, east, north = x0 - half, y0 - half, x1 + half, y1 + half
    scale = min(_MAX_SCALE_PX, _LONGEST_SIDE_PX / max(east - west, north - south))
    drawn_width, drawn_height = (east - west) * scale, (north - south) * scale
    width = max(_MIN_WIDTH_PX, drawn_width + 2 * _MARGIN_PX)
    left = (width - drawn_width) / 2
    return _Sheet(
        scale=round(scale, 3),
        origin_x=round(left - west * scale, 3),
        origin_y=round(_MARGIN_PX + north * scale, 3),
        width=round(width, 1),
        height=round(drawn_height + 2 * _MARGIN_PX + _FOOTER_PX, 1),
        west=west,
        east=east,
        south=south,
        north=north,
    )


def _path(points: list[Point]) -> str:
    return "M" + "L".join(f"{number(x)} {number(y)}" for x, y in points) + "Z"


def _floor(room: Room) -> str:
    # Plans that are stored have no style for areas; hallways are as neutral.
    kind = "Hallway" if room.type == "Area" else room.type
    return f'<path class="fp-{kind}" d="{_path(room.polygon)}"><title>{_text(room.name)}</title></path>'


def _band(start: Point, end: Point, thickness: float) -> list[Point]:
    """Returns the corners of the rectangle of some thickness along a line."""
    (x0, y0), (x1, y1) = start, end
    length = hypot(x1 - x0, y1 - y0) or 1.0
    u, v = (y0 - y1) / length * thickness / 2, (x1 - x0) / length * thickness / 2
    return [(x0 - u, y0 - v), (x1 - u, y1 - v), (x1 + u, y1 + v), (x0 + u, y0 + v)]


def _wall(wall: Wall) -> str:
    """Returns the SVG of a wall that the plan's plane cuts; of a lintel above it, only its shadow."""
    kind = "fp-threshold" if wall.lintel else "fp-wall"
    return f'<path class="{kind}" d="{_path(_band(wall.start, wall.end, wall.thickness_m))}"/>'


def _window(window: Window, thickness: float) -> str:
    frame = _path(_band(window.start, window.end, thickness))
    glass = _path(_band(window.start, window.end, thickness / 3))
    return f'<path class="fp-window" d="{frame}{glass}"/>'


def _passage(passage: Passage) -> str:
    if passage.kind == "Doorway":
        return door_svg(passage.door) if passage.door else ""
    (x0, y0), (x1, y1) = passage.start, passage.end
    return f'<path class="fp-opening" d="M{number(x0)} {number(y0)}L{number(x1)} {number(y1)}"/>'


def _furniture(item: Furniture) -> str:
    kind = "fp-loose" if item.movable else "fp-furniture"
    place = f"translate({number(item.x)} {number(item.y)}) rotate({number(degrees(item.yaw))})"
    drawing = symbol(item.model_type, item.depth_m, item.width_m)
    title = f"{item.model_type} ({item.id})"
    return f'<g class="{kind}" transform="{place}"><title>{_text(title)}</title>{drawing}</g>'


def _origin_mark() -> str:
    circle = "M.12 0A.12 .12 0 1 1 -.12 0A.12 .12 0 1 1 .12 0"
    return f'<path class="fp-origin" d="M-.22 0H.22M0-.22V.22{circle}"><title>(0, 0)</title></path>'


def _label(room: Room, furniture: list[Furniture], scale: float) -> str:
    """Returns the SVG of a room's name and area, at their size in pixels although the group around counts in metres."""
    label = place_label(room, furniture, scale)
    turn = " rotate(-90)" if label.upwards else ""
    place = f"translate({number(label.x)} {number(label.y)}) scale({1 / scale:.6g} {-1 / scale:.6g}){turn}"
    return (
        f'<g transform="{place}"><title>{_text(room.name)}</title>'
        f'<text class="fp-name" y="{-NAME_PX / 2 - 1:g}">{_text(label.name)}</text>'
        f'<text class="fp-area" y="{AREA_PX / 2 + 3:g}">{label.area}</text></g>'
    )


def _dimensions(sheet: _Sheet) -> str:
    """Returns the SVG of the building's outer dimensions in metres: along the top and up the left side."""
    (left, top), (right, bottom) = sheet.px((sheet.west, sheet.north)), sheet.px((sheet.east, sheet.south))
    y, x = top - 20, left - 20
    wide, high = f"{sheet.east - sheet.west:.2f} m", f"{sheet.north - sheet.south:.2f} m"
    ticks = "".join(f"M{number(end - 4)} {number(y + 4)}l8 -8" for end in (left, right))
    ticks += "".join(f"M{number(x - 4)} {number(end + 4)}l8 -8" for end in (top, bottom))
    middle = f"translate({number(x - 10)} {number((top + bottom) / 2)}) rotate(-90)"
    return (
        f'<path class="fp-line" d="M{number(left - 6)} {number(y)}H{number(right + 6)}'
        f'M{number(x)} {number(top - 6)}V{number(bottom + 6)}{ticks}"/>'
        f'<text class="fp-note" x="{number((left + right) / 2)}" y="{number(y - 11)}">{wide}</text>'
        f'<text class="fp-note" transform="{middle}">{high}</text>'
    )


def _scale_bar(sheet: _Sheet) -> str:
    """Returns the SVG of a scale bar of one-metre fields: as many as fit beside the north arrow, five at most."""
    fields = max(1, min(5, int((sheet.width - 2 * _MARGIN_PX - 60) / sheet.scale)))
    left, y = sheet.px((sheet.west, 0))[0], sheet.height - _FOOTER_PX
    parts = []
    for index in range(fields):
        shade = "fp-light" if index % 2 else "fp-dark"
        x = left + index * sheet.scale
        parts.append(
            f'<rect class="{shade}" x="{number(x)}" y="{number(y)}" width="{number(sheet.scale)}" height="6"/>'
        )
        parts.append(f'<text class="fp-note" x="{number(x)}" y="{number(y + 17)}">{index}</text>')
    end = left + fields * sheet.scale
    parts.append(f'<rect class="fp-line" x="{number(left)}" y="{number(y)}" width="{number(end - left)}" height="6"/>')
    parts.append(f'<text class="fp-note" x="{number(end)}" y="{number(y + 17)}">{fields} m</text>')
    return "".join(parts)


def _north_arrow(sheet: _Sheet) -> str:
    """Returns the SVG of the north arrow, along +y, at the lower right."""
    x, y = sheet.px((sheet.east, 0))[0] - 10, sheet.height - _FOOTER_PX
    return (
        f'<path class="fp-dark" d="M{number(x)} {number(y - 8)}l7 22l-7 -5z"/>'
        f'<path class="fp-line" d="M{number(x)} {number(y - 8)}l-7 22l7 -5z"/>'
        f'<text class="fp-note" x="{number(x)}" y="{number(y - 17)}">N</text>'
    )
