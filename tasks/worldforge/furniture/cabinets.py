"""Cupboards, shelves and lamps."""

from ..geometry.parts import (
    BLACK,
    CHROME,
    DARK_STEEL,
    SCREEN,
    STEEL,
    WHITE,
    Color,
    Part,
    Style,
    box,
    carcass,
    ellipsoid,
    fronts,
    invisible_box,
    legs,
    rgb,
    slab,
    upright_cylinder,
)

_PANE = rgb("a9c4cf")
_SPINES: tuple[Color, ...] = (rgb("9c4a3c"), rgb("3f5f7f"), rgb("c79a4b"), rgb("55705a"), rgb("d9d2c0"), rgb("6b4a63"))
# Books on each shelf from right to left: share of its width, share of its height.
_ROWS = (
    ((0.22, 0.78), (0.3, 0.66), (0.18, 0.72)),
    ((0.3, 0.7), (0.16, 0.8), (0.2, 0.62)),
    ((0.18, 0.64), (0.26, 0.76), (0.3, 0.7)),
    ((0.34, 0.74), (0.2, 0.6)),
)


def _chest(style: Style, columns: int, rows: int) -> list[Part]:
    """Builds the parts of a chest: plinth, body, top, and fronts in columns and rows."""
    top = style.height_m
    return [
        slab("plinth", style, (0, 0.07), BLACK, inset=0.04),
        *carcass(style, (0.07, top - 0.03), top, style.main),
        slab("top", style, (top - 0.03, top), style.accent),
        *fronts(style, columns, rows, (0.08, top - 0.04), style.accent, CHROME),
    ]


def dresser(style: Style) -> list[Part]:
    """Builds a chest of drawers from simple shapes."""
    return _chest(style, 2 if style.width_m > 1.1 else 1, 3)


def sideboard(style: Style) -> list[Part]:
    """Builds a sideboard with a plant on it from simple shapes."""
    top = style.height_m
    side = 0.32 * style.width_m
    return [
        *_chest(style, 3, 1),
        upright_cylinder("pot", (0, side), 0.16, (top, top + 0.13), WHITE),
        ellipsoid("plant", (0, side, top + 0.25), (0.26, 0.26, 0.3), rgb("6c9461")),
        box("frame", (-0.17, -0.15), (-side - 0.18, -side + 0.18), (top, top + 0.42), style.main),
        box("print", (-0.155, -0.146), (-side - 0.15, -side + 0.15), (top + 0.03, top + 0.39), style.soft),
    ]


def bar_cabinet(style: Style) -> list[Part]:
    """Builds a bar cabinet with bottles on it from simple shapes."""
    top = style.height_m
    parts = _chest(style, 2, 1)
    for index, color in enumerate((rgb("3f6b4f"), rgb("8c4a2f"), rgb("c9a24a"))):
        spot = (-0.05, -0.2 + 0.13 * index)
        parts.append(upright_cylinder(f"bottle-{index + 1}", spot, 0.075, (top, top + 0.2), color))
        parts.append(upright_cylinder(f"neck-{index + 1}", spot, 0.03, (top + 0.19, top + 0.3), color))
    for index in range(2):
        glass = upright_cylinder(f"glass-{index + 1}", (0.06, 0.18 + 0.1 * index), 0.06, (top, top + 0.1), _PANE)
        parts.append(glass)
    return parts


def media_storage(style: Style) -> list[Part]:
    """Builds a TV bench with a television from simple shapes."""
    x = style.half_depth_m
    unit, screen = 0.5, min(1.3, style.width_m - 0.3) / 2
    low = Style(style.form, style.width_m, style.depth_m, unit, style.colors, style.main, style.accent, style.soft)
    return [
        *_chest(low, 3 if style.width_m > 1.3 else 2, 1),
        *_things(style, unit),
        box("television", (-x + 0.1, -x + 0.14), (-screen, screen), (unit + 0.06, style.height_m), SCREEN, solid=True),
        box("television-foot", (-x + 0.05, -x + 0.25), (-0.2, 0.2), (unit, unit + 0.07), DARK_STEEL),
    ]


def _things(style: Style, top: float) -> list[Part]:
    """Makes a vase and a speaker beside a television; nothing on a cabinet narrower than 1.5 m."""
    if style.width_m < 1.5:
        return []
    side = style.half_width_m - 0.13
    return [
        upright_cylinder("vase", (-0.02, side), 0.1, (top, top + 0.2), style.soft),
        ellipsoid("bunch", (-0.02, side, top + 0.3), (0.2, 0.2, 0.22), rgb("6c9461")),
        box("speaker", (-0.1, 0.06), (-side - 0.06, -side + 0.06), (top, top + 0.24), BLACK),
    ]


def bookcase(style: Style) -> list[Part]:
    """Builds a bookcase with books and a vase from simple shapes."""
    x, y, top = style.half_depth_m, style.half_width_m, style.height_m
    shelves = 2 if top < 1.2 else 4
    step = (top - 0.06) / shelves
    parts = [
        box("body", (-x, x - 0.12), (-y, y), (0, top - 0.03), style.main, solid=True),
        slab("top", style, (top - 0.03, top), style.accent, solid=True),
        box("side-left", (x - 0.12, x), (y - 0.03, y), (0, top - 0.03), style.accent, solid=True),
        box("side-right", (x - 0.12, x), (-y, -y + 0.03), (0, top - 0.03), style.accent, solid=True),
    ]
    for index in range(shelves):
        bottom = 0.05 + index * step
        parts.append(
            box(
                f"shelf-{index + 1}",
                (x - 0.13, x - 0.005),
                (-y + 0.02, y - 0.02),
                (bottom - 0.025, bottom),
                style.accent,
            )
        )
        left = -y + 0.04
        for number, (share, rise) in enumerate(_ROWS[index]):
            width = share * (style.width_m - 0.1)
            span, up = (left, left + width - 0.006), (bottom, bottom + rise * step)
            color = _SPINES[(index + 2 * number) % len(_SPINES)]
            parts.append(box(f"books-{index + 1}-{number + 1}", (x - 0.13, x - 0.03 + 0.008 * number), span, up, color))
            left += width
    vase = (x - 0.065, y - 0.1)
    parts.append(upright_cylinder("vase", vase, 0.09, (0.05 + step, 0.05 + 1.5 * step), WHITE))
    return parts


def corner_cabinet(style: Style) -> list[Part]:
    """Builds a corner cabinet from simple shapes: walls at its back and right, doors on the other sides."""
    x, y, top = style.half_depth_m, style.half_width_m, style.height_m
    is_tall = style.form == "tall"
    low = 0.8 if is_tall else top - 0.04
    parts = [
        box("plinth", (-x + 0.01, x - 0.06), (-y + 0.01, y - 0.06), (0, 0.08), BLACK),
        box("body", (-x, x - 0.02), (-y, y - 0.02), (0.07, top - 0.03), style.main),
        invisible_box("inside", (-x, x - 0.02), (-y, y - 0.02), (0, top), style.main),
        slab("top", style, (top - 0.03, top), style.accent),
        box("door-front", (x - 0.03, x - 0.008), (-y + 0.01, y - 0.03), (0.09, low), style.accent),
        box("door-side", (-x + 0.01, x - 0.03), (y - 0.03, y - 0.008), (0.09, low), style.accent),
        upright_cylinder("handle-front", (x - 0.004, y - 0.08), 0.014, (low - 0.26, low - 0.08), CHROME),
        upright_cylinder("handle-side", (x - 0.08, y - 0.004), 0.014, (low - 0.26, low - 0.08), CHROME),
    ]
    if not is_tall:
        return [*parts, upright_cylinder("vase", (-0.02, 0), 0.13, (top, top + 0.24), style.soft)]
    glass = (low + 0.03, top - 0.07)
    bars = ((low + top) / 2 - 0.03, (low + top) / 2)
    return [
        *parts,
        box("glass-front", (x - 0.03, x - 0.01), (-y + 0.03, y - 0.05), glass, _PANE),
        box("glass-side", (-x + 0.03, x - 0.05), (y - 0.03, y - 0.01), glass, _PANE),
        box("bar-front", (x - 0.028, x - 0.006), (-y + 0.02, y - 0.04), bars, style.accent),
        box("bar-side", (-x + 0.02, x - 0.04), (y - 0.028, y - 0.006), bars, style.accent),
    ]


def storage(style: Style) -> list[Part]:
    """Builds a wardrobe, open shelves, a pantry or a kitchen counter, depending on the style."""
    if style.form.startswith("shelves"):
        return _open_shelves(style)
    if style.form.startswith("counter"):
        return _counter(style)
    if style.form == "pantry":
        return _chest(style, 1, 2)
    doors = 2 if style.width_m < 1.3 else 3
    return _chest(style, doors, 1)


def _open_shelves(style: Style) -> list[Part]:
    top = style.height_m
    boards = [
        slab(f"board-{index + 1}", style, (z, z + 0.03), style.accent, solid=True)
        for index, z in enumerate((0.12, top / 2, top - 0.03))
    ]
    y = style.half_width_m
    crates = [
        box("crate-1", (-0.15, 0.15), (-y + 0.06, -y + 0.36), (0.15, 0.4), style.soft),
        box("crate-2", (-0.15, 0.15), (y - 0.4, y - 0.08), (top / 2 + 0.03, top / 2 + 0.26), rgb("c9a57a")),
        box("crate-3", (-0.14, 0.14), (-y + 0.1, -y + 0.42), (top, top + 0.18), rgb("b58d5f")),
    ]
    return [*boards, *legs(style, (0, top - 0.03), 0.04, style.main, inset=0.005), *crates]


def _counter(style: Style) -> list[Part]:
    """Builds a kitchen counter: a worktop on base units.

    The sink is drawn as a steel rim with a dark basin, and corner units have no fronts.
    """
    top = style.height_m
    x, y = style.half_depth_m, style.half_width_m
    parts = [
        slab("plinth", style, (0, 0.09), BLACK, inset=0.05),
        *carcass(style, (0.09, top - 0.04), top, style.main),
        slab("top", style, (top - 0.04, top), rgb("d8d4cb")),
    ]
    if style.form != "counter-corner":
        columns, rows = (1, 3) if style.form == "counter-drawers" else (2, 1)
        parts += fronts(style, columns, rows, (0.1, top - 0.05), style.main, CHROME)
    if style.form.startswith("counter-sink"):
        parts += [
            box("sink-rim", (-x + 0.1, x - 0.08), (-y + 0.12, y - 0.12), (top, top + 0.008), STEEL),
            box("sink", (-x + 0.14, x - 0.12), (-y + 0.16, y - 0.16), (top, top + 0.012), DARK_STEEL),
            upright_cylinder("tap", (-x + 0.06, 0), 0.035, (top, top + 0.28), CHROME),
            box("spout", (-x + 0.05, -x + 0.24), (-0.015, 0.015), (top + 0.25, top + 0.28), CHROME),
        ]
    return parts


def floor_lamp(style: Style) -> list[Part]:
    """Builds a floor lamp (foot, pole, shade or globe) from simple shapes."""
    top = style.height_m
    if style.form == "globe":
        return [
            upright_cylinder("foot", (0, 0), 0.26, (0, 0.03), style.main, solid=True),
            upright_cylinder("pole", (0, 0), 0.025, (0.03, top - 0.3), style.main, solid=True),
            upright_cylinder("collar", (0, 0), 0.08, (top - 0.36, top - 0.32), style.accent),
            ellipsoid("shade", (0, 0, top - 0.19), (style.width_m, style.width_m, 0.38), rgb("faf0d6"), solid=True),
        ]
    return [
        upright_cylinder("foot", (0, 0), 0.28, (0, 0.03), style.main, solid=True),
        upright_cylinder("pole", (0, 0), 0.03, (0.03, top - 0.24), CHROME, solid=True),
        upright_cylinder("shade", (0, 0), style.width_m, (top - 0.28, top), rgb("f7e6b8"), solid=True),
        upright_cylinder("rim", (0, 0), style.width_m + 0.004, (top - 0.3, top - 0.285), style.main),
    ]
