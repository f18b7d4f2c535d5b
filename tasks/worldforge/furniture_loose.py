"""Small loose objects: free bodies that lie about and can be pushed."""

from .parts import Part, Style, box, rounded, slab


def book(style: Style) -> list[Part]:
    """A closed book; the pages show at three sides."""
    x, y = style.half_depth_m, style.half_width_m
    pages = box("pages", (-x + 0.01, x + 0.002), (-y - 0.002, y + 0.002), (0.006, style.height_m - 0.006), style.accent)
    return [slab("cover", style, (0, style.height_m), style.soft, solid=True), pages]


def ball(style: Style) -> list[Part]:
    """A ball."""
    diameter = style.width_m
    return [rounded("ball", (0, 0, diameter / 2), (diameter, diameter, diameter), style.soft, solid=True)]


def toy_block(style: Style) -> list[Part]:
    """A wooden cube."""
    return [slab("block", style, (0, style.height_m), style.soft, solid=True)]


def carton(style: Style) -> list[Part]:
    """A closed cardboard box with a strip of tape."""
    x, y, top = style.half_depth_m, style.half_width_m, style.height_m
    tape = box("tape", (-x - 0.002, x + 0.002), (-0.03, 0.03), (top - 0.08, top + 0.002), style.accent)
    return [box("carton", (-x, x), (-y, y), (0, top), style.main, solid=True), tape]
