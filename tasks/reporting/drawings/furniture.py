"""Symbols of furniture seen from above, as architects draw them.

A symbol is an outline and marks inside it. Marks are given in shares of the footprint: the first
coordinate runs from the back (-0.5) to the front (0.5), the second across, from -0.5 to 0.5.
"""

import math

from markupsafe import Markup

from ....schemas.worlds.world import Furniture, Point
from .frame import Frame
from .svg import element

_Box = tuple[float, float, float, float]

# Rectangles: back, one side, front, other side.
_BOXES: dict[str, list[_Box]] = {
    "Baths": [(-0.4, -0.42, 0.4, 0.42)],
    "Beds": [(-0.46, -0.42, -0.28, -0.05), (-0.46, 0.05, -0.28, 0.42), (-0.2, -0.5, 0.5, 0.5)],
    "CoffeeTables": [(-0.4, -0.44, 0.4, 0.44)],
    "DeskChairs": [(-0.5, -0.42, -0.34, 0.42)],
    "DiningChairs": [(-0.5, -0.42, -0.34, 0.42)],
    "DiningTables": [(-0.45, -0.45, 0.45, 0.45)],
    "KitchenIslandsAndCarts": [(-0.42, -0.45, 0.42, 0.45)],
    "LivingRoomChairs": [(-0.5, -0.5, -0.26, 0.5), (-0.26, -0.5, 0.5, -0.34), (-0.26, 0.34, 0.5, 0.5)],
    "Ottomans": [(-0.4, -0.4, 0.4, 0.4)],
    "Showers": [(-0.44, -0.44, 0.44, 0.44)],
    "Sofas": [(-0.5, -0.5, -0.24, 0.5), (-0.24, -0.5, 0.5, -0.4), (-0.24, 0.4, 0.5, 0.5)],
    "Toilets": [(-0.5, -0.45, -0.2, 0.45)],
}
# Ellipses: along, across, radius along, radius across.
_ELLIPSES: dict[str, list[_Box]] = {
    "FloorLamps": [(0, 0, 0.2, 0.2)],
    "Ovens": [(-0.2, -0.22, 0.15, 0.15), (-0.2, 0.22, 0.15, 0.15), (0.2, -0.22, 0.15, 0.15), (0.2, 0.22, 0.15, 0.15)],
    "Showers": [(0, 0, 0.06, 0.06)],
    "Toilets": [(0.14, 0, 0.34, 0.36)],
    "VanityCounters": [(0.02, 0, 0.3, 0.22)],
    "WashingMachinesAndDryers": [(0, 0, 0.3, 0.3)],
}
# Cupboards and appliances get a line along their front, so that one sees which way they open.
_FRONT_LINE = frozenset({
    "BarCabinets", "Bookcases", "ConsoleTables", "CornerCabinets", "DishWashers", "Dressers", "Fridges",
    "MediaStorage", "Nightstands", "SideboardsAndBuffets", "Storage", "StorageBenches",
})  # fmt: skip
_ROUND = frozenset({"FloorLamps"})
_ROUND_STYLE = "round"  # of tables and ottomans


def draw_furniture(item: Furniture, frame: Frame) -> Markup:
    """Draws one piece in its place, turned as it stands, with its id as tooltip."""
    x, y = frame.at((item.x, item.y))
    depth, width = item.depth_m * frame.scale, item.width_m * frame.scale
    round_top = item.style.split("-")[0] == _ROUND_STYLE
    outline = (
        element("ellipse", rx=depth / 2, ry=width / 2)
        if round_top or item.model_type in _ROUND
        else element("rect", x=-depth / 2, y=-width / 2, width=depth, height=width, rx=min(4, depth / 4, width / 4))
    )
    turn = math.degrees(item.yaw)
    return element(
        "g",
        element("title", item.id),
        outline,
        *([] if round_top else _marks(item.model_type, depth, width)),
        class_="loose" if item.movable else None,
        # Turning left on the ground is a negative angle in a drawing whose y points down.
        transform=f"translate({x:.1f} {y:.1f})" + (f" rotate({-turn:.0f})" if round(turn) else ""),
    )


def covered_points(item: Furniture, frame: Frame) -> list[Point]:
    """A few points of the drawing that the piece covers: enough to keep letters off it."""
    cos, sin = math.cos(item.yaw), math.sin(item.yaw)
    shares = (-0.45, 0.0, 0.45)
    offsets = ((u * item.depth_m, v * item.width_m) for u in shares for v in shares)
    return [frame.at((item.x + u * cos - v * sin, item.y + u * sin + v * cos)) for u, v in offsets]


def _marks(model_type: str, depth: float, width: float) -> list[Markup]:
    boxes = [
        element("rect", x=u0 * depth, y=v0 * width, width=(u1 - u0) * depth, height=(v1 - v0) * width, rx=3)
        for u0, v0, u1, v1 in _BOXES.get(model_type, [])
    ]
    ellipses = [
        element("ellipse", cx=u * depth, cy=v * width, rx=ru * depth, ry=rv * width)
        for u, v, ru, rv in _ELLIPSES.get(model_type, [])
    ]
    lines = (
        [element("line", x1=0.34 * depth, y1=-width / 2, x2=0.34 * depth, y2=width / 2)]
        if model_type in _FRONT_LINE
        else []
    )
    return boxes + ellipses + lines
