"""Primitive parts of which furniture is made, in the furniture's own frame.

The frame is on the floor in the middle of the footprint: x points to the front, y to the left, z up. Parts that carry
or stop objects collide and are drawn; most others are only drawn, so that a piece with drawers and cushions costs
physics little more than a crate. A few parts collide and are not drawn: the inside of a cushion, and the squares that
round objects rest on.
"""

from dataclasses import dataclass, replace
from math import cos, radians, sin
from typing import Literal

Color = tuple[float, float, float, float]
Span = tuple[float, float]
Vector = tuple[float, float, float]
Shape = Literal["box", "cylinder", "ellipsoid"]
Axis = Literal["x", "y", "z"]


@dataclass(frozen=True, slots=True)
class Part:
    """A geometric primitive of a piece of furniture, in the piece's frame."""

    name: str
    """Name of a furniture part that is unique in its piece."""
    shape: Shape
    """Kind of primitive of a furniture part; `axis` is the direction of a cylinder."""
    center: Vector
    """Centre of a furniture part, in metres."""
    size: Vector
    """Full extents of a furniture part along x, y and z, in metres."""
    color: Color
    """Colour of a furniture part: red, green, blue and opacity, 0 to 1."""
    solid: bool
    """Whether a furniture part collides."""
    axis: Axis = "z"
    """Direction of a cylindrical furniture part; other shapes have none."""
    drawn: bool = True
    """Whether a furniture part is drawn; an undrawn part collides."""

    @property
    def top_m(self) -> float:
        """Height of a furniture part's upper end, in metres."""
        return self.center[2] + self.size[2] / 2


@dataclass(frozen=True, slots=True)
class Style:
    """A look of a furniture type: form, size, and three colours."""

    form: str
    """Form of a furniture style that the builder makes, such as `round` or `three-seat`."""
    width_m: float
    """Width of a furniture style across the facing direction, in metres."""
    depth_m: float
    """Depth of a furniture style along the facing direction, in metres."""
    height_m: float
    """Height of a furniture style, in metres."""
    colors: str
    """Name of a furniture style's colour scheme."""
    main: Color
    """Colour of a furniture style's body, frame and legs."""
    accent: Color
    """Colour of a furniture style's tops, fronts and metal."""
    soft: Color
    """Colour of a furniture style's cushions, covers and screens."""

    @property
    def name(self) -> str:
        """Name of a furniture style, unique among the styles of one furniture type."""
        return f"{self.form} {self.colors}"

    @property
    def half_depth_m(self) -> float:
        """Half of a furniture style's depth, in metres; the front is at `+half_depth_m`."""
        return self.depth_m / 2

    @property
    def half_width_m(self) -> float:
        """Half of a furniture style's width, in metres; the left side is at `+half_width_m`."""
        return self.width_m / 2


def rgb(text: str, opacity: float = 1.0) -> Color:
    """Converts a hexadecimal colour such as `d2b48c` to RGBA, all from 0 to 1."""
    red, green, blue = (round(int(text[at : at + 2], 16) / 255, 3) for at in (0, 2, 4))
    return red, green, blue, opacity


WHITE = rgb("f4f2ed")
CERAMIC = rgb("fafafa")
STEEL = rgb("c3c8cc")
CHROME = rgb("9aa3aa")
DARK_STEEL = rgb("4a4f55")
BLACK = rgb("25282c")
GLASS = rgb("b9d7e2", 0.4)
MIRROR = rgb("cfe0e8")
SCREEN = rgb("1b2230")

BEARING_M = 0.001
"""Length by which the boxes under a cylinder reach past its end, in metres: it touches nothing, and is not seen."""

_SCHEMES: dict[str, tuple[Color, Color, Color]] = {
    "oak": (rgb("c89f6d"), rgb("dcb888"), rgb("5f7f92")),
    "walnut": (rgb("7a5436"), rgb("94683f"), rgb("c9b79a")),
    "white": (rgb("eceae4"), rgb("faf9f6"), rgb("8fa89b")),
    "grey": (rgb("8d9196"), rgb("a9adb1"), rgb("6f7f8f")),
    "sage": (rgb("8ea58c"), rgb("d9c9a8"), rgb("a8bfa6")),
    "navy": (rgb("3b4d66"), rgb("d0b078"), rgb("465f83")),
    "terracotta": (rgb("a65f43"), rgb("e2c6a5"), rgb("c47b5a")),
    "mustard": (rgb("6b4a2f"), rgb("b98a54"), rgb("d3a545")),
    "steel": (STEEL, rgb("d9dde0"), DARK_STEEL),
    "black": (rgb("34373b"), rgb("4d5156"), rgb("22262b")),
    "ceramic": (CERAMIC, rgb("eef0f1"), rgb("cfdde2")),
}


def styles(form: str, size: tuple[float, float, float], *schemes: str) -> tuple[Style, ...]:
    """Makes one furniture style for each colour scheme; `size` is width, depth, height in metres."""
    return tuple(Style(form, *size, scheme, *_SCHEMES[scheme]) for scheme in schemes)


def box(name: str, x: Span, y: Span, z: Span, color: Color, *, solid: bool = False) -> Part:
    """Makes a box as furniture part, between two bounds on each axis."""
    center = ((x[0] + x[1]) / 2, (y[0] + y[1]) / 2, (z[0] + z[1]) / 2)
    return Part(name, "box", center, (x[1] - x[0], y[1] - y[0], z[1] - z[0]), color, solid)


def upright_cylinder(
    name: str, at: tuple[float, float], diameter: float, z: Span, color: Color, *, solid: bool = False
) -> Part:
    """Makes an upright cylinder as furniture part."""
    center = (at[0], at[1], (z[0] + z[1]) / 2)
    return Part(name, "cylinder", center, (diameter, diameter, z[1] - z[0]), color, solid)


def invisible_box(name: str, x: Span, y: Span, z: Span, color: Color) -> Part:
    """Makes an invisible box that collides, such as the core of a cushion."""
    return replace(box(name, x, y, z, color, solid=True), drawn=False)


def bearings(name: str, at: tuple[float, float], diameter: float, z: Span, color: Color, *angles: float) -> list[Part]:
    """Makes boxes at the end of an upright cylinder so that it rests stably on flat surfaces in MuJoCo.

    What is flat and round touches a level in one point in MuJoCo before 3.8, and creeps or jumps; a box has four.

    Args:
        name: Name of the first; the others are numbered.
        at: The cylinder's middle.
        diameter: Diameter of the cylinder.
        z: Lower and upper height.
        color: Colour for programs that draw collision shapes.
        angles: Angles of the boxes' corners on the circle, in degrees from the x axis; one box for each.
    """
    parts: list[Part] = []
    for index, angle in enumerate(angles, 1):
        x, y = diameter / 2 * cos(radians(angle)), diameter / 2 * sin(radians(angle))
        spans = (at[0] - x, at[0] + x), (at[1] - y, at[1] + y)
        parts.append(invisible_box(name if index == 1 else f"{name}-{index}", *spans, z, color))
    return parts


def level_cylinder(name: str, center: Vector, diameter: float, length: float, axis: Axis, color: Color) -> Part:
    """Makes a horizontal cylinder without collisions, for handles and round doors."""
    size = (length, diameter, diameter) if axis == "x" else (diameter, length, diameter)
    return Part(name, "cylinder", center, size, color, False, axis)


def ellipsoid(name: str, center: Vector, size: Vector, color: Color, *, solid: bool = False) -> Part:
    """Makes an ellipsoid as furniture part."""
    return Part(name, "ellipsoid", center, size, color, solid)


def legs(style: Style, z: Span, thickness: float, color: Color, *, inset: float = 0.03) -> list[Part]:
    """Makes four square legs under the corners of a piece of furniture."""
    x, y = style.half_depth_m - inset - thickness, style.half_width_m - inset - thickness
    spots = {"front-left": (x, y), "front-right": (x, -y - thickness)}
    spots |= {"back-left": (-x - thickness, y), "back-right": (-x - thickness, -y - thickness)}
    return [
        box(f"leg-{name}", (at, at + thickness), (side, side + thickness), z, color, solid=True)
        for name, (at, side) in spots.items()
    ]


_KNOBS = frozenset({"white", "sage", "navy"})
_KNOB: Vector = (0.026, 0.034, 0.034)


def fronts(
    style: Style, columns: int, rows: int, z: Span, color: Color, handle: Color, *, gap: float = 0.015
) -> list[Part]:
    """Makes doors or drawers with handles, in columns and rows on the front.

    Drawers have a bar or, in painted furniture, a knob in the middle; doors have an upright bar on the
    side where they open.
    """
    parts: list[Part] = []
    width = (style.width_m - gap) / columns
    height = (z[1] - z[0]) / rows
    front = style.half_depth_m
    for column in range(columns):
        left = -style.half_width_m + gap + column * width
        for row in range(rows):
            bottom = z[0] + row * height
            name = f"{column + 1}-{row + 1}"
            span, up = (left, left + width - gap), (bottom, bottom + height - gap)
            parts.append(box(f"front-{name}", (front - 0.03, front - 0.012), span, up, color))
            middle = (span[0] + span[1]) / 2
            if height > 0.45:
                # Doors open in pairs; an odd one at the end opens towards the others.
                opens_left = column % 2 == 0 and (columns == 1 or column < columns - 1)
                side = span[1] - 0.04 if opens_left else span[0] + 0.04
                low = bottom + (0.5 * height if height > 1.2 else 0.68 * height)
                parts.append(
                    upright_cylinder(f"handle-{name}", (front - 0.006, side), 0.012, (low - 0.09, low + 0.09), handle)
                )
            elif style.colors in _KNOBS:
                parts.append(ellipsoid(f"handle-{name}", (front - 0.006, middle, bottom + 0.5 * height), _KNOB, handle))
            else:
                center = (front - 0.006, middle, bottom + (0.5 if rows > 1 else 0.62) * height)
                parts.append(level_cylinder(f"handle-{name}", center, 0.012, min(0.14, width / 2), "y", handle))
    return parts


def carcass(style: Style, z: Span, top_m: float, color: Color) -> list[Part]:
    """Makes the body of a cabinet, over a plinth and under a top.

    One box collides for all three, from the floor to the top: plinths are set back a few centimetres, and tops overhang
    by as much, which is too little for two more boxes.
    """
    sides = (-style.half_depth_m, style.half_depth_m - 0.022), (-style.half_width_m, style.half_width_m)
    return [box("body", *sides, z, color), invisible_box("inside", *sides, (0, top_m), color)]


def slab(name: str, style: Style, z: Span, color: Color, *, inset: float = 0.0, solid: bool = False) -> Part:
    """Makes a board over the whole footprint of a piece of furniture.

    `inset` is the distance in metres by which it ends before the footprint's edges, and `z` its lower and upper height.
    """
    x, y = style.half_depth_m - inset, style.half_width_m - inset
    return box(name, (-x, x), (-y, y), z, color, solid=solid)
