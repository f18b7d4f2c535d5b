"""Fixtures: bathroom fittings and household appliances."""

from ..geometry.parts import (
    BLACK,
    CERAMIC,
    CHROME,
    DARK_STEEL,
    GLASS,
    MIRROR,
    STEEL,
    Part,
    Style,
    box,
    carcass,
    ellipsoid,
    fronts,
    level_cylinder,
    rgb,
    slab,
    upright_cylinder,
)

_WATER = rgb("a9d3e0")


def bath(style: Style) -> list[Part]:
    """Builds a bathtub with water and taps from simple shapes."""
    x, y, top = style.half_depth_m, style.half_width_m, style.height_m
    rim = 0.07
    return [
        box("front", (x - rim, x), (-y, y), (0, top), style.main, solid=True),
        box("back", (-x, -x + rim), (-y, y), (0, top), style.main, solid=True),
        box("left", (-x + rim, x - rim), (y - rim - 0.06, y), (0, top), style.main, solid=True),
        box("right", (-x + rim, x - rim), (-y, -y + rim), (0, top), style.main, solid=True),
        box("water", (-x + rim, x - rim), (-y + rim, y - rim - 0.06), (0.1, top - 0.14), _WATER, solid=True),
        upright_cylinder("tap-hot", (0.09, y - 0.06), 0.04, (top, top + 0.09), CHROME),
        upright_cylinder("tap-cold", (-0.09, y - 0.06), 0.04, (top, top + 0.09), CHROME),
        box("spout", (-0.02, 0.02), (y - 0.2, y - 0.04), (top + 0.06, top + 0.09), CHROME),
    ]


def shower(style: Style) -> list[Part]:
    """Builds a shower (tray and glass walls) from simple shapes."""
    x, y, top = style.half_depth_m, style.half_width_m, style.height_m
    panes = ["right"] if style.form == "walk-in" else ["left", "right"]
    glass: list[Part] = []
    for name in panes:
        side = y - 0.02 if name == "left" else -y + 0.02
        glass += [
            box(
                f"glass-{name}",
                (-x + 0.02, x - 0.02),
                (side - 0.008, side + 0.008),
                (0.1, top - 0.01),
                GLASS,
                solid=True,
            ),
            box(f"rail-{name}", (-x + 0.012, x - 0.012), (side - 0.014, side + 0.014), (top - 0.02, top), CHROME),
            upright_cylinder(f"post-{name}", (x - 0.03, side), 0.028, (0.1, top - 0.015), CHROME),
        ]
    return [
        *glass,
        box("valve", (-x + 0.03, -x + 0.075), (-0.14, 0.14), (1.05, 1.1), CHROME),
        ellipsoid("soap", (-x + 0.08, 0.25 * style.width_m, 1.06), (0.07, 0.1, 0.03), rgb("cfe3d2")),
        box(
            "shelf",
            (-x + 0.03, -x + 0.13),
            (0.25 * style.width_m - 0.1, 0.25 * style.width_m + 0.1),
            (1.02, 1.045),
            CHROME,
        ),
        slab("tray", style, (0, 0.1), style.main, solid=True),
        slab("floor", style, (0.09, 0.107), style.soft, inset=0.06),
        upright_cylinder("drain", (0, 0), 0.1, (0.1, 0.112), CHROME),
        box("back", (-x, -x + 0.03), (-y + 0.036, y - 0.036), (0.1, top - 0.004), style.accent, solid=True),
        upright_cylinder("pipe", (-x + 0.06, 0), 0.03, (0.9, top - 0.05), CHROME),
        upright_cylinder("head", (-x + 0.2, 0), 0.22, (top - 0.09, top - 0.06), CHROME),
    ]


def toilet(style: Style) -> list[Part]:
    """Builds a toilet from simple shapes, standing or wall-hung."""
    x, y = style.half_depth_m, style.half_width_m
    middle = 0.1 * style.depth_m
    bowl = [
        ellipsoid("bowl", (middle, 0, 0.3), (0.54, style.width_m - 0.02, 0.28), style.main, solid=True),
        Part("seat", "ellipsoid", (middle, 0, 0.42), (0.53, style.width_m - 0.03, 0.07), CERAMIC, False),
        Part("opening", "ellipsoid", (middle + 0.03, 0, 0.44), (0.32, 0.21, 0.045), style.soft, False),
    ]
    if style.form == "wall-hung":
        top = style.height_m
        return [
            box("box", (-x, -x + 0.16), (-y, y), (0, top - 0.025), style.accent, solid=True),
            box("ledge", (-x, -x + 0.17), (-y, y), (top - 0.025, top), rgb("b9a58a"), solid=True),
            box("neck", (-x + 0.15, middle), (-0.13, 0.13), (0.2, 0.38), style.main, solid=True),
            *bowl,
            box("plate", (-x + 0.155, -x + 0.17), (-0.11, 0.11), (0.86, 1.0), CHROME),
        ]
    return [
        *bowl,
        box("tank", (-x, -x + 0.19), (-y, y), (0.36, style.height_m - 0.03), style.main, solid=True),
        box("tank-lid", (-x, -x + 0.2), (-y - 0.005, y + 0.005), (style.height_m - 0.03, style.height_m), style.accent),
        box("foot", (-x + 0.02, x - 0.16), (-0.11, 0.11), (0, 0.37), style.main, solid=True),
        upright_cylinder("button", (-x + 0.1, 0), 0.05, (style.height_m, style.height_m + 0.01), CHROME),
    ]


def vanity(style: Style) -> list[Part]:
    """Builds a washstand with one or two basins and a mirror from simple shapes."""
    x, y, top = style.half_depth_m, style.half_width_m, 0.86
    parts = [
        slab("plinth", style, (0, 0.08), BLACK, inset=0.05),
        *carcass(style, (0.08, top - 0.035), top, style.main),
        slab("top", style, (top - 0.035, top), rgb("efece6")),
        *fronts(style, 2, 1, (0.1, top - 0.05), style.main, CHROME),
        box("mirror", (-x, -x + 0.02), (-y + 0.06, y - 0.06), (top + 0.2, style.height_m), MIRROR),
    ]
    # A narrow one leaves a place for a cup beside its basin.
    basin_m, bowl_m = (0.38, 0.31) if style.width_m > 0.7 else (0.32, 0.26)
    for index, side in enumerate((-y / 2, y / 2) if style.width_m > 1.1 else (0.0,)):
        parts += [
            upright_cylinder(f"basin-{index + 1}", (0.03, side), basin_m, (top, top + 0.09), CERAMIC, solid=True),
            upright_cylinder(f"bowl-{index + 1}", (0.03, side), bowl_m, (top, top + 0.096), rgb("c5d5db")),
            upright_cylinder(f"tap-{index + 1}", (-x + 0.07, side), 0.035, (top, top + 0.2), CHROME),
            box(
                f"spout-{index + 1}",
                (-x + 0.06, -x + 0.2),
                (side - 0.012, side + 0.012),
                (top + 0.17, top + 0.2),
                CHROME,
            ),
        ]
    return parts


def fridge(style: Style) -> list[Part]:
    """Builds a refrigerator from simple shapes, with freezer below or two doors."""
    x, y, top = style.half_depth_m, style.half_width_m, style.height_m
    if style.form == "side-by-side":
        doors = ((-y + 0.004, -0.005), (0.005, y - 0.004))
        return [
            box("body", (-x, x - 0.06), (-y, y), (0.03, top), style.main, solid=True),
            box("plinth", (-x + 0.03, x - 0.08), (-y + 0.02, y - 0.02), (0, 0.03), BLACK),
            *[
                box(f"door-{i}", (x - 0.06, x - 0.015), span, (0.05, top - 0.005), style.accent)
                for i, span in enumerate(doors)
            ],
            *[
                upright_cylinder(f"handle-{i}", (x - 0.008, side), 0.02, (0.6, 1.4), CHROME)
                for i, side in enumerate((-0.05, 0.05))
            ],
            box("dispenser", (x - 0.03, x - 0.01), (-y + 0.1, -0.12), (1.0, 1.3), BLACK),
        ]
    split = 0.38 * top
    return [
        box("body", (-x, x - 0.06), (-y, y), (0.03, top), style.main, solid=True),
        box("plinth", (-x + 0.03, x - 0.08), (-y + 0.02, y - 0.02), (0, 0.03), BLACK),
        box("door-upper", (x - 0.06, x - 0.015), (-y + 0.004, y - 0.004), (split + 0.01, top - 0.005), style.accent),
        box("door-lower", (x - 0.06, x - 0.015), (-y + 0.004, y - 0.004), (0.05, split - 0.01), style.accent),
        upright_cylinder("handle-upper", (x - 0.008, -y + 0.06), 0.016, (split + 0.08, split + 0.6), CHROME),
        upright_cylinder("handle-lower", (x - 0.008, -y + 0.06), 0.016, (split - 0.4, split - 0.08), CHROME),
    ]


def oven(style: Style) -> list[Part]:
    """Builds a kitchen stove from simple shapes: oven door, knobs, hobs."""
    x, y, top = style.half_depth_m, style.half_width_m, style.height_m
    is_range = style.form == "range"
    knobs = [
        level_cylinder(
            f"knob-{index + 1}",
            (x - 0.006, (index - 2) * 0.2 * style.width_m * 0.8, top - 0.12),
            0.04,
            0.03,
            "x",
            STEEL,
        )
        for index in range(5)
    ]
    plates = [
        upright_cylinder(f"plate-{index + 1}", (i * 0.13, j * 0.13), d, (top - 0.02, top + 0.006), rgb("6a6f75"))
        for index, (i, j, d) in enumerate([(1, 1, 0.18), (1, -1, 0.15), (-1, 1, 0.15), (-1, -1, 0.2)])
    ]
    if is_range:
        plates = [
            part
            for index, (at, side) in enumerate([(0.13, 0.26), (0.13, -0.26), (-0.13, 0.26), (-0.13, -0.26), (0.0, 0.0)])
            for part in (
                upright_cylinder(f"burner-{index + 1}", (at, side), 0.12, (top - 0.02, top + 0.012), rgb("6a6f75")),
                upright_cylinder(f"cap-{index + 1}", (at, side), 0.07, (top - 0.02, top + 0.022), BLACK),
            )
        ]
        plates.append(
            box("splashback", (-x + 0.003, -x + 0.03), (-y + 0.005, y - 0.005), (top - 0.01, top + 0.12), STEEL)
        )
    return [
        *knobs,
        *carcass(style, (0.05, top - 0.03), top, style.main),
        slab("plinth", style, (0, 0.05), BLACK, inset=0.03),
        slab("hob", style, (top - 0.03, top), BLACK),
        *plates,
        box("door", (x - 0.03, x - 0.012), (-y + 0.02, y - 0.02), (0.12, 0.66), style.accent),
        box("window", (x - 0.02, x - 0.009), (-y + 0.09, y - 0.09), (0.22, 0.52), BLACK),
        level_cylinder("handle", (x - 0.01, 0, 0.61), 0.018, style.width_m - 0.16, "y", CHROME),
        box("controls", (x - 0.03, x - 0.008), (-y + 0.02, y - 0.02), (0.7, top - 0.05), DARK_STEEL),
    ]


def dishwasher(style: Style) -> list[Part]:
    """Builds a dishwasher from simple shapes."""
    x, y, top = style.half_depth_m, style.half_width_m, style.height_m
    return [
        *carcass(style, (0.08, top - 0.04), top, style.main),
        slab("plinth", style, (0, 0.08), BLACK, inset=0.04),
        slab("top", style, (top - 0.04, top), rgb("d8d4cb")),
        box("door", (x - 0.03, x - 0.012), (-y + 0.01, y - 0.01), (0.1, top - 0.17), style.accent),
        box("controls", (x - 0.03, x - 0.01), (-y + 0.01, y - 0.01), (top - 0.16, top - 0.05), DARK_STEEL),
        level_cylinder("handle", (x - 0.01, 0, top - 0.22), 0.016, style.width_m - 0.2, "y", CHROME),
    ]


def washing_machine(style: Style) -> list[Part]:
    """Builds a washing machine from simple shapes, in one style with a dryer on top."""
    x, y = style.half_depth_m, style.half_width_m
    machines = 2 if style.form == "stacked" else 1
    height = style.height_m / machines
    parts: list[Part] = [box("body", (-x, x - 0.03), (-y, y), (0, style.height_m), style.main, solid=True)]
    for index in range(machines):
        middle, name = (index + 0.46) * height, f"-{index + 1}"
        parts += [
            level_cylinder("ring" + name, (x - 0.022, 0, middle), 0.38, 0.03, "x", STEEL),
            level_cylinder("door" + name, (x - 0.014, 0, middle), 0.29, 0.026, "x", DARK_STEEL),
            box(
                "controls" + name,
                (x - 0.04, x - 0.022),
                (-y + 0.02, y - 0.02),
                ((index + 0.83) * height, (index + 0.96) * height),
                style.accent,
            ),
        ]
    return [*parts, slab("top", style, (style.height_m - 0.02, style.height_m + 0.004), style.accent, inset=0.006)]
