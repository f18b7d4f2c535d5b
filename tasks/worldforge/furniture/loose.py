"""Small loose objects: free bodies that lie about and can be pushed."""

from ..geometry.parts import BEARING_M, CERAMIC, Part, Style, bearings, box, rgb, rounded, slab, upright

_TEA = rgb("6b4327")


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


def cup(style: Style) -> list[Part]:
    """A cup with something in it, and a handle."""
    top, width = style.height_m, style.width_m
    return [
        upright("cup", (0, 0), width, (BEARING_M, top), style.soft, solid=True),
        *bearings("foot", (0, 0), width, (0, top / 2), style.soft, 45.0),
        upright("tea", (0, 0), width - 0.012, (top - 0.01, top + 0.001), _TEA),
    ]


def plate(style: Style) -> list[Part]:
    """A dinner plate."""
    return [
        upright("plate", (0, 0), style.width_m, (BEARING_M, style.height_m), CERAMIC, solid=True),
        *bearings("foot", (0, 0), style.width_m, (0, style.height_m / 2), CERAMIC, 45.0),
        upright("well", (0, 0), 0.7 * style.width_m, (style.height_m - 0.01, style.height_m + 0.001), style.soft),
    ]


def shoe(style: Style) -> list[Part]:
    """One shoe; its tip points to the front."""
    x, y, top = style.half_depth_m, style.half_width_m, style.height_m
    return [
        slab("sole", style, (0, 0.5 * top), style.soft, solid=True),
        rounded("upper", (-0.2 * x, 0, 0.5 * top), (1.5 * x, 1.7 * y, top), style.main),
    ]


def clothes(style: Style) -> list[Part]:
    """A pullover that was dropped: two folds."""
    x, y, top = style.half_depth_m, style.half_width_m, style.height_m
    return [
        slab("lower", style, (0, 0.6 * top), style.soft, solid=True),
        rounded("upper", (0.1 * x, -0.15 * y, 0.6 * top), (1.4 * x, 1.3 * y, 0.8 * top), style.soft),
    ]
