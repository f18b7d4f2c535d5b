"""Tables, desks, carts and the small things that stand on them."""

from .parts import (
    BLACK,
    CHROME,
    DARK_STEEL,
    SCREEN,
    STEEL,
    WHITE,
    Part,
    Style,
    box,
    carcass,
    fronts,
    legs,
    rgb,
    rounded,
    slab,
    upright,
)

_LEAF = rgb("5f8a56")
_CLAY = rgb("b5694a")


def coffee_table(style: Style) -> list[Part]:
    """A low table, round on a pedestal or square with a shelf."""
    if style.form == "round":
        return _pedestal(style, foot=0.6)
    top = style.height_m
    return [
        slab("top", style, (top - 0.04, top), style.accent, solid=True),
        slab("shelf", style, (0.12, 0.14), style.accent, inset=0.06),
        *legs(style, (0, top - 0.04), 0.05, style.main),
        box("magazine", (-0.1, 0.18), (0.12, 0.33), (top, top + 0.02), style.soft),
    ]


def dining_table(style: Style) -> list[Part]:
    """A table to eat at, with a bowl on it."""
    top = style.height_m
    parts = _pedestal(style, foot=0.5) if style.form == "round" else _four_legged(style, 0.07)
    return [
        *parts,
        upright("bowl", (0, 0), 0.26, (top, top + 0.06), WHITE),
        rounded("fruit", (0, 0, top + 0.06), (0.2, 0.2, 0.1), _CLAY),
    ]


def side_table(style: Style) -> list[Part]:
    """An end table with something on it."""
    top = style.height_m
    if style.form == "round":
        return [*_pedestal(style, foot=0.7), upright("cup", (0.08, 0.06), 0.08, (top, top + 0.1), style.soft)]
    return [
        *_four_legged(style, 0.035),
        slab("shelf", style, (0.18, 0.2), style.main, inset=0.05),
        rounded("plant", (0, 0, top + 0.16), (0.22, 0.22, 0.2), _LEAF),
        upright("pot", (0, 0), 0.13, (top, top + 0.11), _CLAY),
    ]


def console_table(style: Style) -> list[Part]:
    """A narrow table for a hall."""
    top = style.height_m
    return [
        *_four_legged(style, 0.04),
        slab("shelf", style, (0.2, 0.225), style.accent, inset=0.035),
        upright("vase", (0, 0.3 * style.width_m), 0.12, (top, top + 0.22), style.soft),
        rounded("bunch", (0, 0.3 * style.width_m, top + 0.3), (0.22, 0.22, 0.24), _LEAF),
        box("tray", (-0.1, 0.1), (-0.38 * style.width_m, -0.12 * style.width_m), (top, top + 0.02), style.main),
    ]


def nightstand(style: Style) -> list[Part]:
    """Two drawers and a lamp beside a bed."""
    top = style.height_m
    return [
        carcass(style, (0.06, top - 0.025), style.main),
        slab("plinth", style, (0, 0.06), BLACK, inset=0.04),
        slab("top", style, (top - 0.025, top), style.accent),
        *fronts(style, 1, 2, (0.08, top - 0.03), style.accent, CHROME),
        upright("lamp-foot", (-0.04, 0), 0.05, (top, top + 0.16), CHROME),
        upright("lamp-shade", (-0.04, 0), 0.22, (top + 0.15, top + 0.33), rgb("f6e7c1")),
    ]


def desk(style: Style) -> list[Part]:
    """A desk with drawers on one side and a screen at the back."""
    top = style.height_m
    x, y = style.half_depth_m, style.half_width_m
    return [
        slab("top", style, (top - 0.035, top), style.accent, solid=True),
        box("drawers", (-x + 0.02, x - 0.05), (-y + 0.02, -y + 0.42), (0.0, top - 0.035), style.main, solid=True),
        box("drawer-upper", (x - 0.06, x - 0.035), (-y + 0.035, -y + 0.405), (0.38, top - 0.06), style.accent),
        box("drawer-lower", (x - 0.06, x - 0.035), (-y + 0.035, -y + 0.405), (0.04, 0.36), style.accent),
        box("side", (-x + 0.03, x - 0.04), (y - 0.05, y - 0.02), (0, top - 0.035), style.main, solid=True),
        box("screen", (-x + 0.14, -x + 0.17), (-0.3, 0.3), (top + 0.1, top + 0.46), SCREEN),
        upright("stand", (-x + 0.13, 0), 0.05, (top, top + 0.3), DARK_STEEL),
        box("keyboard", (0.05, 0.19), (-0.21, 0.21), (top, top + 0.018), BLACK),
    ]


def serving_cart(style: Style) -> list[Part]:
    """Two trays on four posts, with bottles."""
    top = style.height_m
    x, y = style.half_depth_m, style.half_width_m
    posts = [
        upright(f"post-{index + 1}", (i * (x - 0.03), j * (y - 0.03)), 0.03, (0, top), style.accent, solid=True)
        for index, (i, j) in enumerate([(1, 1), (1, -1), (-1, 1), (-1, -1)])
    ]
    return [
        *posts,
        slab("tray-upper", style, (top - 0.12, top - 0.09), style.main, inset=0.01, solid=True),
        slab("tray-lower", style, (0.18, 0.21), style.main, inset=0.01, solid=True),
        upright("bottle", (0, 0.12), 0.08, (top - 0.09, top + 0.14), rgb("3f6b4f")),
        upright("teapot", (0.02, -0.14), 0.15, (top - 0.09, top + 0.02), WHITE),
    ]


def kitchen_island(style: Style) -> list[Part]:
    """A block with a worktop, drawers on the front, or a cart on legs with a shelf."""
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
        carcass(style, (0.08, top - 0.04), style.main),
        slab("plinth", style, (0, 0.08), BLACK, inset=0.05),
        slab("top", style, (top - 0.04, top), STEEL if style.colors == "black" else WHITE),
        *fronts(style, 3, 2, (0.1, top - 0.06), style.main, CHROME),
        board,
        upright("bowl", (0.05, 0.3 * style.width_m), 0.24, (top, top + 0.08), style.soft),
    ]


def _four_legged(style: Style, thickness: float) -> list[Part]:
    top = style.height_m
    board = slab("top", style, (top - 0.035, top), style.accent, solid=True)
    return [board, *legs(style, (0, top - 0.035), thickness, style.main, inset=0.02)]


def _pedestal(style: Style, foot: float) -> list[Part]:
    """A round top on a column; `foot` is the base's share of the width."""
    top = style.height_m
    return [
        upright("top", (0, 0), style.width_m, (top - 0.035, top), style.accent, solid=True),
        upright("column", (0, 0), 0.08, (0.02, top - 0.035), style.main, solid=True),
        upright("foot", (0, 0), foot * style.width_m, (0, 0.035), style.main, solid=True),
    ]
