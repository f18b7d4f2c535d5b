"""Furniture to lie and sit on: beds, sofas, chairs, ottomans, benches; and small loose objects."""

from ..geometry.parts import (
    BEARING_M,
    BLACK,
    CERAMIC,
    CHROME,
    DARK_STEEL,
    WHITE,
    Part,
    Style,
    bearings,
    box,
    ellipsoid,
    fronts,
    invisible_box,
    legs,
    rgb,
    slab,
    upright_cylinder,
)

_SINK_DEPTH_M = 0.02
"""Depth that objects sink into a cushion, in metres."""


def bed(style: Style) -> list[Part]:
    """Builds a bed from simple shapes; the headboard is at the back."""
    x, y, top = style.half_depth_m, style.half_width_m, style.height_m
    pillows = 2 if style.width_m > 1.3 else 1
    pillow_width = (style.width_m - 0.16) / pillows - 0.06
    parts = [
        box("headboard", (-x, -x + 0.06), (-y, y), (0.0, top), style.main, solid=True),
        box("frame", (-x + 0.06, x), (-y, y), (0.1, 0.27), style.main, solid=True),
        box("mattress", (-x + 0.07, x - 0.03), (-y + 0.03, y - 0.03), (0.26, 0.46), WHITE),
        invisible_box("filling", (-x + 0.07, x - 0.03), (-y + 0.03, y - 0.03), (0.26, 0.51 - _SINK_DEPTH_M), WHITE),
        box("duvet", (-x + 0.62, x - 0.012), (-y + 0.012, y - 0.012), (0.3, 0.51), style.soft),
        box("fold", (-x + 0.56, -x + 0.78), (-y + 0.008, y - 0.008), (0.32, 0.53), WHITE),
        box("throw", (x - 0.5, x - 0.2), (-y + 0.006, y - 0.006), (0.31, 0.54), style.accent),
    ]
    if style.form.endswith("padded"):
        tufts = 3 if style.width_m > 1.3 else 2
        step = (style.width_m - 0.04) / tufts
        for index in range(tufts):
            middle = -y + 0.02 + (index + 0.5) * step
            pad = (0.07, step - 0.02, top - 0.52)
            parts.append(ellipsoid(f"pad-{index + 1}", (-x + 0.065, middle, (top + 0.5) / 2), pad, style.soft))
    else:
        parts.append(box("panel", (-x + 0.05, -x + 0.068), (-y + 0.08, y - 0.08), (0.5, top - 0.08), style.accent))
    for index, (at, side) in enumerate([(x - 0.08, y - 0.08), (x - 0.08, -y + 0.08)]):
        parts.append(upright_cylinder(f"foot-{index + 1}", (at, side), 0.06, (0, 0.11), BLACK))
    for index in range(pillows):
        middle = -y + 0.11 + (index + 0.5) * (pillow_width + 0.06)
        parts.append(ellipsoid(f"pillow-{index + 1}", (-x + 0.31, middle, 0.5), (0.4, pillow_width, 0.18), WHITE))
        small = (0.2, 0.62 * pillow_width, 0.2)
        parts.append(ellipsoid(f"cushion-{index + 1}", (-x + 0.5, middle, 0.56), small, style.accent))
    return parts


def sofa(style: Style) -> list[Part]:
    """Builds a sofa or armchair with one cushion for each seat from simple shapes."""
    x, y = style.half_depth_m, style.half_width_m
    slim = style.form.startswith("scandi")
    arm, back, low = (0.08, 0.16, 0.17) if slim else (0.16, 0.2, 0.08)
    places = max(1, round((style.width_m - 2 * arm) / 0.68))
    place = (style.width_m - 2 * arm) / places
    arm_top = 0.56 if slim else 0.6
    inside = (-x + back, x - 0.02)
    floor = low if slim else 0.0  # a plinth is set back a little, and collides with all above it
    parts = [
        box("base", inside, (-y + arm, y - arm), (low, 0.31), style.soft),
        box("back", (-x, -x + back), (-y, y), (low, style.height_m), style.soft),
        box("arm-left", (-x + back, x), (y - arm, y), (low, arm_top), style.soft),
        box("arm-right", (-x + back, x), (-y, -y + arm), (low, arm_top), style.soft),
        invisible_box("filling", inside, (-y + arm, y - arm), (floor, 0.44 - _SINK_DEPTH_M), style.soft),
        invisible_box("inside-back", (-x, -x + back), (-y, y), (floor, style.height_m), style.soft),
        invisible_box("inside-left", (-x + back, x), (y - arm, y), (floor, arm_top), style.soft),
        invisible_box("inside-right", (-x + back, x), (-y, -y + arm), (floor, arm_top), style.soft),
    ]
    if slim:
        wood = rgb("a5764a")
        spots = [(x - 0.09, y - 0.08), (x - 0.09, -y + 0.08), (-x + 0.09, y - 0.08), (-x + 0.09, -y + 0.08)]
        parts += [
            upright_cylinder(f"leg-{index + 1}", spot, 0.045, (0, low + 0.01), wood) for index, spot in enumerate(spots)
        ]
    else:
        parts.append(slab("plinth", style, (0, 0.09), BLACK, inset=0.06))
    light = _lighter(style.soft)
    for index in range(places):
        left = -y + arm + index * place
        span = (left + 0.008, left + place - 0.008)
        parts.append(box(f"cushion-{index + 1}", (-x + back + 0.1, x - 0.005), span, (0.3, 0.44), light))
        parts.append(box(f"back-cushion-{index + 1}", (-x + back - 0.01, -x + back + 0.12), span, (0.4, 0.74), light))
    if places > 1:
        parts.append(ellipsoid("pillow", (-x + 0.44, y - arm - 0.22, 0.62), (0.17, 0.4, 0.36), style.accent))
        parts.append(ellipsoid("pillow-2", (-x + 0.43, -y + arm + 0.2, 0.6), (0.16, 0.36, 0.33), style.main))
    return parts


def tub_chair(style: Style) -> list[Part]:
    """Builds a round armchair from simple shapes."""
    x, y, top = style.half_depth_m, style.half_width_m, style.height_m
    light = _lighter(style.soft)
    legs_at = [(0.6 * x, 0.6 * y), (0.6 * x, -0.6 * y), (-0.6 * x, 0.6 * y), (-0.6 * x, -0.6 * y)]
    return [
        *[upright_cylinder(f"leg-{i + 1}", spot, 0.04, (0, 0.16), style.main) for i, spot in enumerate(legs_at)],
        upright_cylinder("body", (0, 0), style.width_m - 0.02, (0.15, 0.36), style.soft, solid=True),
        box("back", (-x, -x + 0.17), (-y + 0.12, y - 0.12), (0.2, top), style.soft, solid=True),
        ellipsoid("back-bow", (-x + 0.13, 0, top - 0.12), (0.25, style.width_m - 0.1, 0.3), style.soft),
        box("arm-left", (-x + 0.1, x - 0.2), (y - 0.13, y), (0.2, 0.56), style.soft, solid=True),
        box("arm-right", (-x + 0.1, x - 0.2), (-y, -y + 0.13), (0.2, 0.56), style.soft, solid=True),
        upright_cylinder("arm-left-end", (x - 0.2, y - 0.065), 0.13, (0.2, 0.56), style.soft),
        upright_cylinder("arm-right-end", (x - 0.2, -y + 0.065), 0.13, (0.2, 0.56), style.soft),
        upright_cylinder("cushion", (0.03, 0), style.width_m - 0.24, (0.35, 0.45), light),
        *bearings("filling", (0.03, 0), style.width_m - 0.24, (0.35, 0.45 - _SINK_DEPTH_M), light, 45.0),
    ]


def armchair(style: Style) -> list[Part]:
    """Builds an armchair from simple shapes: square, slim or round."""
    return tub_chair(style) if style.form == "tub" else sofa(style)


def ottoman(style: Style) -> list[Part]:
    """Builds a footstool from simple shapes, round or square."""
    x, y, top = style.half_depth_m, style.half_width_m, style.height_m
    if style.form == "round":
        return [
            upright_cylinder("body", (0, 0), style.width_m, (0.04, top - 0.08), style.soft, solid=True),
            upright_cylinder("foot", (0, 0), style.width_m - 0.08, (0, 0.05), BLACK),
            upright_cylinder("cushion", (0, 0), style.width_m - 0.02, (top - 0.09, top), _lighter(style.soft)),
            *bearings("filling", (0, 0), style.width_m - 0.02, (top - 0.09, top - _SINK_DEPTH_M), style.soft, 45.0),
        ]
    return [
        slab("body", style, (0.08, top - 0.1), style.soft),
        slab("cushion", style, (top - 0.1, top), _lighter(style.soft), inset=0.01),
        invisible_box("filling", (-x, x), (-y, y), (0.08, top - _SINK_DEPTH_M), style.soft),
        slab("feet", style, (0, 0.09), style.main, inset=0.05),
    ]


def dining_chair(style: Style) -> list[Part]:
    """Builds a dining chair from simple shapes."""
    x, y, top = style.half_depth_m, style.half_width_m, style.height_m
    if style.form == "shell":
        return [
            *legs(style, (0, 0.43), 0.028, rgb("b88a5a"), inset=0.04),
            box("seat", (-x + 0.02, x), (-y, y), (0.43, 0.455), style.soft, solid=True),
            box("back", (-x, -x + 0.025), (-y + 0.03, y - 0.03), (0.44, top), style.soft, solid=True),
        ]
    seat_and_pad = [
        slab("seat", style, (0.42, 0.46), style.main, solid=True),
        box("pad", (-x + 0.05, x - 0.015), (-y + 0.015, y - 0.015), (0.45, 0.485), style.soft),
    ]
    if style.form == "ladder":
        corners = legs(style, (0, 0.43), 0.035, style.main, inset=0.004)
        posts = [
            box(f"post-{name}", (-x + 0.004, -x + 0.039), span, (0.44, top), style.main, solid=True)
            for name, span in (("left", (y - 0.039, y - 0.004)), ("right", (-y + 0.004, -y + 0.039)))
        ]
        rungs = [
            box(f"rung-{i + 1}", (-x + 0.01, -x + 0.032), (-y + 0.03, y - 0.03), (z, z + 0.07), style.accent)
            for i, z in enumerate((0.56, 0.68, top - 0.08))
        ]
        return [*corners, *seat_and_pad, *posts, *rungs]
    return [
        *legs(style, (0, 0.43), 0.035, style.main, inset=0.01),
        *seat_and_pad,
        box("back", (-x, -x + 0.035), (-y + 0.01, y - 0.01), (0.6, top), style.main, solid=True),
        box("upright-left", (-x + 0.004, -x + 0.03), (y - 0.07, y - 0.04), (0.46, 0.61), style.main),
        box("upright-right", (-x + 0.004, -x + 0.03), (-y + 0.04, -y + 0.07), (0.46, 0.61), style.main),
    ]


def desk_chair(style: Style) -> list[Part]:
    """Builds a swivel chair with castors from simple shapes."""
    x, y, top = style.half_depth_m, style.half_width_m, style.height_m
    reach = min(x, y) - 0.01
    castors = [(reach - 0.03, 0.0), (-reach + 0.03, 0.0), (0.0, reach - 0.03), (0.0, -reach + 0.03)]
    parts = [
        box("cross-x", (-reach, reach), (-0.025, 0.025), (0.045, 0.085), BLACK, solid=True),
        box("cross-y", (-0.025, 0.025), (-reach, reach), (0.046, 0.084), BLACK, solid=True),
        *[upright_cylinder(f"castor-{i + 1}", spot, 0.05, (0.001, 0.05), DARK_STEEL) for i, spot in enumerate(castors)],
        upright_cylinder("column", (0, 0), 0.06, (0.06, 0.42), CHROME, solid=True),
        box("seat", (-x + 0.06, x - 0.02), (-y + 0.05, y - 0.05), (0.42, 0.49), style.soft, solid=True),
        ellipsoid("cushion", (0.02, 0, 0.49), (2 * x - 0.1, 2 * y - 0.12, 0.07), _lighter(style.soft)),
        box("back", (-x, -x + 0.07), (-y + 0.06, y - 0.06), (0.55, top), style.soft, solid=True),
        ellipsoid("lumbar", (-x + 0.07, 0, 0.72), (0.07, 2 * y - 0.16, 0.28), _lighter(style.soft)),
        box("spine", (-x + 0.02, -x + 0.06), (-0.03, 0.03), (0.44, 0.6), BLACK),
    ]
    if style.form == "swivel":
        for name, side in (("left", y - 0.025), ("right", -y + 0.025)):
            parts.append(box(f"arm-{name}", (-x + 0.14, x - 0.16), (side - 0.025, side + 0.025), (0.64, 0.67), BLACK))
            parts.append(box(f"arm-post-{name}", (-0.02, 0.02), (side - 0.015, side + 0.015), (0.47, 0.65), DARK_STEEL))
    return parts


def storage_bench(style: Style) -> list[Part]:
    """Builds a bench with drawers below the cushion from simple shapes."""
    top = style.height_m
    x, y = style.half_depth_m, style.half_width_m
    body = box("body", (-x, x - 0.022), (-y, y), (0.0, top - 0.08), style.main)
    cushion = slab("cushion", style, (top - 0.08, top), style.soft)
    filling = invisible_box("filling", (-x, x - 0.022), (-y, y), (0, top - _SINK_DEPTH_M), style.soft)
    columns = 2 if style.width_m < 1.2 else 3
    return [body, cushion, filling, *fronts(style, columns, 1, (0.04, top - 0.09), style.accent, CHROME)]


def _lighter(color: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    red, green, blue = (round(channel + (1 - channel) * 0.14, 3) for channel in color[:3])
    return red, green, blue, color[3]


_TEA = rgb("6b4327")


def book(style: Style) -> list[Part]:
    """Builds a closed book from simple shapes."""
    x, y = style.half_depth_m, style.half_width_m
    pages = box("pages", (-x + 0.01, x + 0.002), (-y - 0.002, y + 0.002), (0.006, style.height_m - 0.006), style.accent)
    return [slab("cover", style, (0, style.height_m), style.soft, solid=True), pages]


def ball(style: Style) -> list[Part]:
    """Builds a ball."""
    diameter = style.width_m
    return [ellipsoid("ball", (0, 0, diameter / 2), (diameter, diameter, diameter), style.soft, solid=True)]


def toy_block(style: Style) -> list[Part]:
    """Builds a wooden toy cube."""
    return [slab("block", style, (0, style.height_m), style.soft, solid=True)]


def carton(style: Style) -> list[Part]:
    """Builds a closed cardboard box with tape."""
    x, y, top = style.half_depth_m, style.half_width_m, style.height_m
    tape = box("tape", (-x - 0.002, x + 0.002), (-0.03, 0.03), (top - 0.08, top + 0.002), style.accent)
    return [box("carton", (-x, x), (-y, y), (0, top), style.main, solid=True), tape]


def cup(style: Style) -> list[Part]:
    """Builds a filled cup with a handle from simple shapes."""
    top, width = style.height_m, style.width_m
    return [
        upright_cylinder("cup", (0, 0), width, (BEARING_M, top), style.soft, solid=True),
        *bearings("foot", (0, 0), width, (0, top / 2), style.soft, 45.0),
        upright_cylinder("tea", (0, 0), width - 0.012, (top - 0.01, top + 0.001), _TEA),
    ]


def plate(style: Style) -> list[Part]:
    """Builds a dinner plate from simple shapes."""
    return [
        upright_cylinder("plate", (0, 0), style.width_m, (BEARING_M, style.height_m), CERAMIC, solid=True),
        *bearings("foot", (0, 0), style.width_m, (0, style.height_m / 2), CERAMIC, 45.0),
        upright_cylinder(
            "well", (0, 0), 0.7 * style.width_m, (style.height_m - 0.01, style.height_m + 0.001), style.soft
        ),
    ]


def shoe(style: Style) -> list[Part]:
    """Builds one shoe from simple shapes; its tip points to the front."""
    x, y, top = style.half_depth_m, style.half_width_m, style.height_m
    return [
        slab("sole", style, (0, 0.5 * top), style.soft, solid=True),
        ellipsoid("upper", (-0.2 * x, 0, 0.5 * top), (1.5 * x, 1.7 * y, top), style.main),
    ]


def clothes(style: Style) -> list[Part]:
    """Builds a dropped pullover from simple shapes."""
    x, y, top = style.half_depth_m, style.half_width_m, style.height_m
    return [
        slab("lower", style, (0, 0.6 * top), style.soft, solid=True),
        ellipsoid("upper", (0.1 * x, -0.15 * y, 0.6 * top), (1.4 * x, 1.3 * y, 0.8 * top), style.soft),
    ]
