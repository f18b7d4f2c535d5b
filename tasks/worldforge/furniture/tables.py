"""Tables, desks, carts and the small things that stand on them."""

from ..geometry.parts import (
    BEARING_M,
    BLACK,
    CHROME,
    DARK_STEEL,
    SCREEN,
    STEEL,
    WHITE,
    Part,
    Style,
    bearings,
    box,
    carcass,
    ellipsoid,
    fronts,
    legs,
    level_cylinder,
    rgb,
    slab,
    upright_cylinder,
)

_LEAF = rgb("5f8a56")
_CLAY = rgb("b5694a")
_SUPPORT_ANGLES_DEG = (20.0, 45.0, 70.0)
"""Angles of the three boxes that support a round table top, in degrees; they cover nine tenths of it."""


def coffee_table(style: Style) -> list[Part]:
    """Builds a coffee table from simple shapes."""
    top = style.height_m
    if style.form == "round":
        return [*_pedestal(style, foot=0.6), *_tray(style, top)]
    if style.form == "chest":
        return [
            *carcass(style, (0.06, top - 0.035), top, style.main),
            slab("plinth", style, (0, 0.06), BLACK, inset=0.05),
            slab("top", style, (top - 0.035, top), style.accent),
            *fronts(style, 2, 1, (0.08, top - 0.045), style.accent, CHROME),
            *_tray(style, top),
        ]
    return [
        slab("top", style, (top - 0.04, top), style.accent, solid=True),
        slab("shelf", style, (0.12, 0.14), style.accent, inset=0.06),
        *legs(style, (0, top - 0.04), 0.05, style.main),
        box("magazine", (-0.1, 0.18), (0.12, 0.33), (top, top + 0.012), style.soft),
        box("magazine-2", (-0.06, 0.17), (0.15, 0.35), (top + 0.011, top + 0.02), WHITE),
    ]


def _tray(style: Style, top: float) -> list[Part]:
    """Builds a small decorative bowl with moss."""
    return [
        upright_cylinder("tray", (-0.08, -0.1), 0.2, (top, top + 0.03), style.soft),
        ellipsoid("moss", (-0.08, -0.1, top + 0.035), (0.17, 0.17, 0.06), _LEAF),
    ]


def dining_table(style: Style) -> list[Part]:
    """Builds a dining table with a bowl on it from simple shapes."""
    top = style.height_m
    parts = _pedestal(style, foot=0.5) if style.form == "round" else _four_legged(style, 0.07)
    if style.form == "six":
        parts += [
            box("apron-front", (style.half_depth_m - 0.08, style.half_depth_m - 0.055), *_apron(style), style.main),
            box("apron-back", (-style.half_depth_m + 0.055, -style.half_depth_m + 0.08), *_apron(style), style.main),
        ]
    return [
        *parts,
        upright_cylinder("bowl", (0, 0), 0.26, (top, top + 0.06), WHITE),
        ellipsoid("fruit", (0, 0, top + 0.06), (0.2, 0.2, 0.1), _CLAY),
    ]


def _apron(style: Style) -> tuple[tuple[float, float], tuple[float, float]]:
    """Returns left and right end, and bottom and top, of the board below a table's top."""
    side = style.half_width_m - 0.06
    return (-side, side), (style.height_m - 0.12, style.height_m - 0.03)


def side_table(style: Style) -> list[Part]:
    """Builds a side table with an object on it from simple shapes."""
    top = style.height_m
    if style.form == "round":
        return [*_pedestal(style, foot=0.7), upright_cylinder("cup", (0.08, 0.06), 0.08, (top, top + 0.1), style.soft)]
    return [
        *_four_legged(style, 0.035),
        slab("shelf", style, (0.18, 0.2), style.main, inset=0.05),
        ellipsoid("plant", (0, 0, top + 0.16), (0.22, 0.22, 0.2), _LEAF),
        upright_cylinder("pot", (0, 0), 0.13, (top, top + 0.11), _CLAY),
    ]


def console_table(style: Style) -> list[Part]:
    """Builds a narrow hall table from simple shapes, plain or with two drawers."""
    top = style.height_m
    x = style.half_depth_m
    drawers: list[Part] = []
    if style.form == "drawers":
        half = style.half_width_m - 0.06
        drawers.append(slab("chest", style, (top - 0.17, top - 0.03), style.main, inset=0.03))
        for name, side in (("left", half / 2), ("right", -half / 2)):
            span = (side - half / 2 + 0.02, side + half / 2 - 0.02)
            drawers.append(box(f"drawer-{name}", (x - 0.05, x - 0.018), span, (top - 0.155, top - 0.045), style.accent))
            drawers.append(ellipsoid(f"knob-{name}", (x - 0.014, side, top - 0.1), (0.024, 0.03, 0.03), CHROME))
    return [
        *drawers,
        *_four_legged(style, 0.04),
        slab("shelf", style, (0.2, 0.225), style.accent, inset=0.035),
        upright_cylinder("vase", (0, 0.3 * style.width_m), 0.12, (top, top + 0.22), style.soft),
        ellipsoid("bunch", (0, 0.3 * style.width_m, top + 0.3), (0.22, 0.22, 0.24), _LEAF),
        box("tray", (-0.1, 0.1), (-0.38 * style.width_m, -0.12 * style.width_m), (top, top + 0.02), style.main),
    ]


def nightstand(style: Style) -> list[Part]:
    """Builds a nightstand with a lamp from simple shapes."""
    top = style.height_m
    lamp = [
        upright_cylinder("lamp-foot", (-0.04, 0), 0.11, (top, top + 0.02), style.main),
        upright_cylinder("lamp-pole", (-0.04, 0), 0.03, (top + 0.01, top + 0.17), CHROME),
        upright_cylinder("lamp-shade", (-0.04, 0), 0.22, (top + 0.15, top + 0.33), rgb("f6e7c1")),
    ]
    if style.form == "open":
        x, y = style.half_depth_m, style.half_width_m
        return [
            slab("top", style, (top - 0.025, top), style.accent, solid=True),
            box(
                "drawer", (-x + 0.01, x - 0.02), (-y + 0.02, y - 0.02), (top - 0.18, top - 0.02), style.main, solid=True
            ),
            ellipsoid("knob", (x - 0.014, 0, top - 0.1), (0.024, 0.032, 0.032), CHROME),
            *legs(style, (0, top - 0.02), 0.032, style.main, inset=0.008),
            slab("shelf", style, (0.16, 0.18), style.accent, inset=0.014),
            box("books", (-0.08, 0.1), (-0.1, 0.08), (0.18, 0.23), style.soft),
            *lamp,
        ]
    return [
        *lamp,
        *carcass(style, (0.06, top - 0.025), top, style.main),
        slab("plinth", style, (0, 0.06), BLACK, inset=0.04),
        slab("top", style, (top - 0.025, top), style.accent),
        *fronts(style, 1, 2, (0.08, top - 0.03), style.accent, CHROME),
    ]


def desk(style: Style) -> list[Part]:
    """Builds a desk with a screen or laptop from simple shapes."""
    top = style.height_m
    x, y = style.half_depth_m, style.half_width_m
    lamp = [
        upright_cylinder("lamp-foot", (-x + 0.14, y - 0.18), 0.14, (top, top + 0.02), BLACK),
        upright_cylinder("lamp-pole", (-x + 0.14, y - 0.18), 0.022, (top + 0.01, top + 0.36), BLACK),
        upright_cylinder("lamp-shade", (-x + 0.18, y - 0.18), 0.16, (top + 0.32, top + 0.42), rgb("f6e7c1")),
    ]
    if style.form == "legs":
        return [
            *_four_legged(style, 0.045),
            box("modesty", (-x + 0.03, -x + 0.05), (-y + 0.06, y - 0.06), (top - 0.3, top - 0.03), style.main),
            box("laptop", (-0.08, 0.14), (-0.16, 0.16), (top, top + 0.016), STEEL),
            box("laptop-keys", (-0.02, 0.06), (-0.14, 0.14), (top, top + 0.018), BLACK),
            box("laptop-lid", (-0.095, -0.08), (-0.16, 0.16), (top, top + 0.21), STEEL),
            box("laptop-screen", (-0.09, -0.078), (-0.15, 0.15), (top + 0.02, top + 0.2), SCREEN),
            *lamp,
        ]
    return [
        *lamp,
        slab("top", style, (top - 0.035, top), style.accent, solid=True),
        box("drawers", (-x + 0.02, x - 0.05), (-y + 0.02, -y + 0.42), (0.0, top - 0.035), style.main, solid=True),
        box("drawer-upper", (x - 0.06, x - 0.035), (-y + 0.035, -y + 0.405), (0.38, top - 0.06), style.accent),
        box("drawer-lower", (x - 0.06, x - 0.035), (-y + 0.035, -y + 0.405), (0.04, 0.36), style.accent),
        *[
            level_cylinder(f"handle-{i}", (x - 0.03, -y + 0.22, z), 0.012, 0.14, "y", CHROME)
            for i, z in enumerate((0.55, 0.24), 1)
        ],
        box("mouse", (0.08, 0.16), (0.26, 0.31), (top, top + 0.022), DARK_STEEL),
        box("screen-foot", (-x + 0.08, -x + 0.24), (-0.11, 0.11), (top, top + 0.012), DARK_STEEL),
        box("side", (-x + 0.03, x - 0.04), (y - 0.05, y - 0.02), (0, top - 0.035), style.main, solid=True),
        box("screen", (-x + 0.14, -x + 0.17), (-0.3, 0.3), (top + 0.1, top + 0.46), SCREEN),
        upright_cylinder("stand", (-x + 0.13, 0), 0.05, (top, top + 0.3), DARK_STEEL),
        box("keyboard", (0.05, 0.19), (-0.21, 0.21), (top, top + 0.018), BLACK),
    ]


def serving_cart(style: Style) -> list[Part]:
    """Builds a serving cart with bottles from simple shapes."""
    top = style.height_m
    x, y = style.half_depth_m, style.half_width_m
    posts = [
        upright_cylinder(
            f"post-{index + 1}", (i * (x - 0.03), j * (y - 0.03)), 0.03, (0, top), style.accent, solid=True
        )
        for index, (i, j) in enumerate([(1, 1), (1, -1), (-1, 1), (-1, -1)])
    ]
    wheels = [
        level_cylinder(f"wheel-{index + 1}", (i * (x - 0.03), j * (y - 0.03), 0.034), 0.068, 0.034, "y", BLACK)
        for index, (i, j) in enumerate([(1, 1), (1, -1), (-1, 1), (-1, -1)])
    ]
    return [
        *posts,
        *wheels,
        level_cylinder("push-bar", (0, y - 0.03, top - 0.012), 0.022, 2 * x - 0.06, "x", CHROME),
        upright_cylinder("neck", (0, 0.12), 0.03, (top + 0.13, top + 0.2), rgb("3f6b4f")),
        upright_cylinder("glass-1", (0.08, 0.0), 0.06, (top - 0.09, top + 0.0), rgb("cfe0e8")),
        upright_cylinder("glass-2", (-0.06, 0.0), 0.06, (top - 0.09, top + 0.0), rgb("cfe0e8")),
        box("crate", (-0.13, 0.13), (-0.2, 0.04), (0.21, 0.36), rgb("b58d5f")),
        slab("tray-upper", style, (top - 0.12, top - 0.09), style.main, inset=0.01, solid=True),
        slab("tray-lower", style, (0.18, 0.21), style.main, inset=0.01, solid=True),
        upright_cylinder("bottle", (0, 0.12), 0.08, (top - 0.09, top + 0.14), rgb("3f6b4f")),
        upright_cylinder("teapot", (0.02, -0.14), 0.15, (top - 0.09, top + 0.02), WHITE),
    ]


def kitchen_island(style: Style) -> list[Part]:
    """Builds a kitchen island from simple shapes."""
    top = style.height_m
    board = box("board", (-0.15, 0.12), (-0.3, 0.1), (top, top + 0.03), rgb("b98a54"))
    if style.form == "cart":
        return [
            slab("top", style, (top - 0.05, top), rgb("c89f6d"), solid=True),
            *legs(style, (0, top - 0.05), 0.06, style.main, inset=0.02),
            slab("shelf", style, (0.25, 0.28), style.accent, inset=0.03, solid=True),
            slab("drawer", style, (top - 0.22, top - 0.05), style.main, inset=0.025),
            board,
        ]
    return [
        *carcass(style, (0.08, top - 0.04), top, style.main),
        slab("plinth", style, (0, 0.08), BLACK, inset=0.05),
        slab("top", style, (top - 0.04, top), STEEL if style.colors == "black" else WHITE),
        *fronts(style, 3, 2, (0.1, top - 0.06), style.main, CHROME),
        board,
        upright_cylinder("bowl", (0.05, 0.3 * style.width_m), 0.24, (top, top + 0.08), style.soft),
    ]


def _four_legged(style: Style, thickness: float) -> list[Part]:
    top = style.height_m
    board = slab("top", style, (top - 0.035, top), style.accent, solid=True)
    return [board, *legs(style, (0, top - 0.035), thickness, style.main, inset=0.02)]


def _pedestal(style: Style, foot: float) -> list[Part]:
    """Builds a round table top on a column; `foot` is the base's width as a share of the top's."""
    top = style.height_m
    return [
        upright_cylinder("top", (0, 0), style.width_m, (top - 0.035, top - BEARING_M), style.accent, solid=True),
        *bearings("bearing", (0, 0), style.width_m, (top - 0.03, top), style.accent, *_SUPPORT_ANGLES_DEG),
        upright_cylinder("column", (0, 0), 0.08, (0.02, top - 0.035), style.main, solid=True),
        upright_cylinder("foot", (0, 0), foot * style.width_m, (0, 0.035), style.main, solid=True),
    ]
