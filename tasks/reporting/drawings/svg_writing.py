"""Safe writing of SVG, and conversion of metres on the ground to units of a drawing."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from markupsafe import Markup, escape

from ....schemas.worlds.world import Point, World

Number = float | int


def number(value: Number) -> str:
    """Formats an SVG coordinate with at most one decimal."""
    text = f"{value:.1f}".removesuffix(".0")
    return "0" if text == "-0" else text


def element(tag: str, *children: str | Markup, **attributes: str | Number | None) -> Markup:
    """Makes one SVG or HTML element.

    Args:
        tag: Name of the element.
        *children: Content; plain strings are escaped.
        **attributes: `class_` becomes `class`, other underscores become hyphens; None leaves one out.

    Returns:
        Markup that can be put into a page as it is.
    """
    written = "".join(
        f' {name.rstrip("_").replace("_", "-")}="{escape(value if isinstance(value, str) else number(value))}"'
        for name, value in attributes.items()
        if value is not None
    )
    inside = "".join(escape(child) for child in children)
    return Markup(f"<{tag}{written}>{inside}</{tag}>") if inside else Markup(f"<{tag}{written}/>")  # noqa: S704


def group(children: Iterable[Markup], **attributes: str | Number | None) -> Markup:
    """Makes an SVG group (`<g>`) around children; empty if there are none."""
    inside = list(children)
    return element("g", *inside, **attributes) if inside else Markup()


def points(pairs: Iterable[tuple[float, float]]) -> str:
    """Formats the `points` attribute of an SVG polygon or polyline."""
    return " ".join(f"{number(x)},{number(y)}" for x, y in pairs)


EXTENT = 1000.0
"""Length of the longer side of every drawing, so that the style sheet can have fixed line widths and letters."""

_MARGIN_M = 0.35
_FOOT = 44.0  # room for the scale bar below the plan


@dataclass(frozen=True)
class Frame:
    """The area of the ground (metres) that a drawing shows, and its mapping to SVG coordinates."""

    left_m: float
    top_m: float
    scale: float
    """Units of the drawing per metre."""
    width: float
    height: float
    """Height in units of the drawing, including the strip for the scale bar."""

    def at(self, point: Point) -> Point:
        """Converts a point on the ground (metres) to drawing coordinates."""
        return (point[0] - self.left_m) * self.scale, (self.top_m - point[1]) * self.scale

    @property
    def view_box(self) -> str:
        """The drawing's SVG `viewBox` attribute."""
        return f"0 0 {math.ceil(self.width)} {math.ceil(self.height)}"

    @property
    def foot(self) -> float:
        """Vertical coordinate of the middle of the strip below the floor plan."""
        return self.height - _FOOT / 2

    @classmethod
    def around(cls, points: Iterable[Point]) -> "Frame":
        """Makes the frame that shows all given points with a margin.

        Raises:
            ValueError: No points are given, or some are not finite.
        """
        xs, ys = zip(*points, strict=True)
        if not all(map(math.isfinite, (*xs, *ys))):
            raise ValueError("some coordinates are not finite")
        left, right = min(xs) - _MARGIN_M, max(xs) + _MARGIN_M
        bottom, top = min(ys) - _MARGIN_M, max(ys) + _MARGIN_M
        scale = EXTENT / max(right - left, top - bottom)
        return cls(left, top, scale, (right - left) * scale, (top - bottom) * scale + _FOOT)

    @classmethod
    def of_world(cls, world: World) -> "Frame":
        """Makes the frame that shows a whole building."""
        corners = [*world.floorplan.footprint, *(corner for room in world.floorplan.rooms for corner in room.polygon)]
        return cls.around(corners)
