"""Furniture to lie and sit on: beds, sofas, chairs, ottomans, benches."""

from .parts import BLACK, CHROME, WHITE, Part, Style, box, fronts, legs, rounded, slab, upright


def bed(style: Style) -> list[Part]:
    """A bed; the headboard is at the back."""
    x, y = style.half_depth_m, style.half_width_m
    pillows = 2 if style.width_m > 1.3 else 1
    pillow_width = (style.width_m - 0.16) / pillows - 0.06
    parts = [
        box("headboard", (-x, -x + 0.06), (-y, y), (0, style.height_m), style.main, solid=True),
        box("frame", (-x + 0.06, x), (-y, y), (0, 0.26), style.main, solid=True),
        box("mattress", (-x + 0.07, x - 0.03), (-y + 0.03, y - 0.03), (0.26, 0.46), WHITE, solid=True),
        box("duvet", (-x + 0.62, x - 0.012), (-y + 0.012, y - 0.012), (0.3, 0.51), style.soft),
        box("fold", (-x + 0.56, -x + 0.78), (-y + 0.008, y - 0.008), (0.32, 0.53), WHITE),
    ]
    for index in range(pillows):
        middle = -y + 0.11 + (index + 0.5) * (pillow_width + 0.06)
        center = (-x + 0.31, middle, 0.5)
        parts.append(rounded(f"pillow-{index + 1}", center, (0.4, pillow_width, 0.18), WHITE))
    return [*parts, box("throw", (x - 0.5, x - 0.2), (-y + 0.006, y - 0.006), (0.31, 0.525), style.accent)]


def seat(style: Style) -> list[Part]:
    """A sofa or an armchair: plinth, back, arms, one cushion per place."""
    x, y = style.half_depth_m, style.half_width_m
    arm, back = 0.16, 0.2
    places = max(1, round((style.width_m - 2 * arm) / 0.68))
    place = (style.width_m - 2 * arm) / places
    parts = [
        slab("plinth", style, (0, 0.09), BLACK, inset=0.06),
        box("base", (-x + back, x - 0.02), (-y + arm, y - arm), (0.08, 0.31), style.soft, solid=True),
        box("back", (-x, -x + back), (-y, y), (0.08, style.height_m), style.soft, solid=True),
        box("arm-left", (-x + back, x), (y - arm, y), (0.08, 0.6), style.soft, solid=True),
        box("arm-right", (-x + back, x), (-y, -y + arm), (0.08, 0.6), style.soft, solid=True),
    ]
    light = _lighter(style.soft)
    for index in range(places):
        left = -y + arm + index * place
        span = (left + 0.008, left + place - 0.008)
        parts.append(box(f"cushion-{index + 1}", (-x + back + 0.1, x - 0.005), span, (0.3, 0.45), light))
        parts.append(box(f"back-cushion-{index + 1}", (-x + back - 0.01, -x + back + 0.12), span, (0.4, 0.74), light))
    if places > 1:
        parts.append(rounded("pillow", (-x + 0.4, y - arm - 0.2, 0.58), (0.16, 0.38, 0.34), style.accent))
    return parts


def ottoman(style: Style) -> list[Part]:
    """A footstool: feet, upholstered body, cushion; round or square."""
    top = style.height_m
    if style.form == "round":
        return [
            upright("body", (0, 0), style.width_m, (0.04, top - 0.08), style.soft, solid=True),
            upright("foot", (0, 0), style.width_m - 0.08, (0, 0.05), BLACK),
            upright("cushion", (0, 0), style.width_m - 0.02, (top - 0.09, top), _lighter(style.soft)),
        ]
    return [
        slab("body", style, (0.08, top - 0.1), style.soft, solid=True),
        slab("cushion", style, (top - 0.1, top), _lighter(style.soft), inset=0.01),
        slab("feet", style, (0, 0.09), style.main, inset=0.05),
    ]


def dining_chair(style: Style) -> list[Part]:
    """A chair with four legs and a back."""
    x, y = style.half_depth_m, style.half_width_m
    return [
        *legs(style, (0, 0.43), 0.035, style.main, inset=0.01),
        slab("seat", style, (0.42, 0.46), style.main, solid=True),
        box("pad", (-x + 0.05, x - 0.015), (-y + 0.015, y - 0.015), (0.45, 0.485), style.soft),
        box("back", (-x, -x + 0.035), (-y + 0.01, y - 0.01), (0.46, style.height_m), style.main, solid=True),
    ]


def desk_chair(style: Style) -> list[Part]:
    """A swivel chair on a five-star base, shown as a disc."""
    x, y = style.half_depth_m, style.half_width_m
    return [
        upright("base", (0, 0), min(style.depth_m, style.width_m) - 0.04, (0.02, 0.07), BLACK, solid=True),
        upright("column", (0, 0), 0.06, (0.06, 0.42), CHROME, solid=True),
        box("seat", (-x + 0.06, x - 0.02), (-y + 0.05, y - 0.05), (0.42, 0.51), style.soft, solid=True),
        box("back", (-x, -x + 0.08), (-y + 0.06, y - 0.06), (0.55, style.height_m), style.soft, solid=True),
        box("spine", (-x + 0.02, -x + 0.07), (-0.03, 0.03), (0.44, 0.6), BLACK),
        box("arm-left", (-x + 0.14, x - 0.16), (y - 0.05, y), (0.64, 0.68), BLACK),
        box("arm-right", (-x + 0.14, x - 0.16), (-y, -y + 0.05), (0.64, 0.68), BLACK),
    ]


def storage_bench(style: Style) -> list[Part]:
    """A bench with drawers below the cushion."""
    top = style.height_m
    x, y = style.half_depth_m, style.half_width_m
    body = box("body", (-x, x - 0.022), (-y, y), (0.0, top - 0.08), style.main, solid=True)
    cushion = slab("cushion", style, (top - 0.08, top), style.soft)
    columns = 2 if style.width_m < 1.2 else 3
    return [body, cushion, *fronts(style, columns, 1, (0.04, top - 0.09), style.accent, CHROME)]


def _lighter(color: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    red, green, blue = (round(channel + (1 - channel) * 0.14, 3) for channel in color[:3])
    return red, green, blue, color[3]
