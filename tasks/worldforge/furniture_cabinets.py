"""Cupboards, shelves and lamps."""

from .parts import (
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
    fronts,
    legs,
    rgb,
    slab,
    upright,
)

_SPINES: tuple[Color, ...] = (rgb("9c4a3c"), rgb("3f5f7f"), rgb("c79a4b"), rgb("55705a"))


def _chest(style: Style, columns: int, rows: int) -> list[Part]:
    """Plinth, body, top, fronts."""
    top = style.height_m
    return [
        slab("plinth", style, (0, 0.07), BLACK, inset=0.04),
        carcass(style, (0.07, top - 0.03), style.main),
        slab("top", style, (top - 0.03, top), style.accent),
        *fronts(style, columns, rows, (0.08, top - 0.04), style.accent, CHROME),
    ]


def dresser(style: Style) -> list[Part]:
    """A chest of drawers."""
    return _chest(style, 2 if style.width_m > 1.1 else 1, 3)


def sideboard(style: Style) -> list[Part]:
    """A low cupboard for plates, with a plant on it."""
    top = style.height_m
    side = 0.32 * style.width_m
    return [
        *_chest(style, 3, 1),
        upright("pot", (0, side), 0.16, (top, top + 0.13), WHITE),
        upright("plant", (0, side), 0.26, (top + 0.12, top + 0.3), rgb("6c9461")),
    ]


def bar_cabinet(style: Style) -> list[Part]:
    """A cupboard with bottles on it."""
    top = style.height_m
    parts = _chest(style, 2, 1)
    for index, color in enumerate((rgb("3f6b4f"), rgb("8c4a2f"), rgb("c9a24a"))):
        parts.append(upright(f"bottle-{index + 1}", (-0.05, -0.2 + 0.13 * index), 0.075, (top, top + 0.28), color))
    return parts


def media_storage(style: Style) -> list[Part]:
    """A low unit with a television on it."""
    x = style.half_depth_m
    unit, screen = 0.5, min(1.3, style.width_m - 0.3) / 2
    low = Style(style.form, style.width_m, style.depth_m, unit, style.colors, style.main, style.accent, style.soft)
    return [
        *_chest(low, 3 if style.width_m > 1.3 else 2, 1),
        box("television", (-x + 0.1, -x + 0.14), (-screen, screen), (unit + 0.06, style.height_m), SCREEN, solid=True),
        box("television-foot", (-x + 0.05, -x + 0.25), (-0.2, 0.2), (unit, unit + 0.07), DARK_STEEL),
    ]


def bookcase(style: Style) -> list[Part]:
    """Shelves with a row of books on each."""
    x, y, top = style.half_depth_m, style.half_width_m, style.height_m
    shelves = 2 if top < 1.2 else 4
    step = (top - 0.06) / shelves
    parts = [
        box("body", (-x, x - 0.06), (-y, y), (0, top - 0.03), style.main, solid=True),
        slab("top", style, (top - 0.03, top), style.accent),
        box("side-left", (x - 0.06, x), (y - 0.03, y), (0, top - 0.03), style.accent),
        box("side-right", (x - 0.06, x), (-y, -y + 0.03), (0, top - 0.03), style.accent),
    ]
    for index in range(shelves):
        bottom = 0.03 + index * step
        end = y - 0.05 - 0.12 * ((index * 7) % 3)
        books = box(
            f"books-{index + 1}", (x - 0.07, x - 0.02), (-y + 0.04, end), (bottom, bottom + 0.72 * step), _SPINES[index]
        )
        board = box(
            f"shelf-{index + 1}", (x - 0.07, x - 0.005), (-y + 0.02, y - 0.02), (bottom - 0.02, bottom), style.accent
        )
        parts += [board, books]
    return parts


def corner_cabinet(style: Style) -> list[Part]:
    """A cupboard for a corner: walls at its back and at its right, doors on the other two sides."""
    x, y, top = style.half_depth_m, style.half_width_m, style.height_m
    body, low = (0.07, top - 0.03), 0.8
    return [
        box("plinth", (-x + 0.01, x - 0.06), (-y + 0.01, y - 0.06), (0, 0.08), BLACK),
        box("body", (-x, x - 0.02), (-y, y - 0.02), body, style.main, solid=True),
        slab("top", style, (top - 0.03, top), style.accent),
        box("door-front", (x - 0.03, x - 0.008), (-y + 0.01, y - 0.03), (0.09, low), style.accent),
        box("door-side", (-x + 0.01, x - 0.03), (y - 0.03, y - 0.008), (0.09, low), style.accent),
        box("glass-front", (x - 0.03, x - 0.01), (-y + 0.03, y - 0.05), (low + 0.03, top - 0.07), rgb("a9c4cf")),
        box("glass-side", (-x + 0.03, x - 0.05), (y - 0.03, y - 0.01), (low + 0.03, top - 0.07), rgb("a9c4cf")),
    ]


def storage(style: Style) -> list[Part]:
    """A wardrobe, open shelves, or a kitchen counter with a sink."""
    if style.form == "shelves":
        return _open_shelves(style)
    if style.form.startswith("counter"):
        return _counter(style)
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
    """Worktop on base units; the sink is drawn as a steel rim with a dark basin."""
    top = style.height_m
    x, y = style.half_depth_m, style.half_width_m
    parts = [
        slab("plinth", style, (0, 0.09), BLACK, inset=0.05),
        carcass(style, (0.09, top - 0.04), style.main),
        slab("top", style, (top - 0.04, top), rgb("d8d4cb")),
        *fronts(style, 2 if style.width_m > 0.7 else 1, 1, (0.1, top - 0.05), style.main, CHROME),
    ]
    if style.form == "counter-sink":
        parts += [
            box("sink-rim", (-x + 0.1, x - 0.08), (-y + 0.12, y - 0.12), (top, top + 0.008), STEEL),
            box("sink", (-x + 0.14, x - 0.12), (-y + 0.16, y - 0.16), (top, top + 0.012), DARK_STEEL),
            upright("tap", (-x + 0.06, 0), 0.035, (top, top + 0.28), CHROME),
            box("spout", (-x + 0.05, -x + 0.24), (-0.015, 0.015), (top + 0.25, top + 0.28), CHROME),
        ]
    return parts


def floor_lamp(style: Style) -> list[Part]:
    """Foot, pole and shade."""
    top = style.height_m
    return [
        upright("foot", (0, 0), 0.28, (0, 0.03), style.main, solid=True),
        upright("pole", (0, 0), 0.03, (0.03, top - 0.24), CHROME, solid=True),
        upright("shade", (0, 0), style.width_m, (top - 0.28, top), rgb("f7e6b8"), solid=True),
    ]
