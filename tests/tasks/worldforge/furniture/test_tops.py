"""Tops carry what is put on them: counters, cabinets and vanities as well as tables."""

import itertools

import pytest

from prefect_robomaker.schemas.worlds.world import Furniture
from prefect_robomaker.tasks.worldforge.furniture.catalogue import parts_of, styles_of
from prefect_robomaker.tasks.worldforge.furniture.placed_parts import height_at
from prefect_robomaker.tasks.worldforge.geometry.parts import Style

CUP_M = 0.085
KINDS = ("DishWashers", "Dressers", "KitchenIslandsAndCarts", "Nightstands", "SideboardsAndBuffets", "VanityCounters")
COUNTERS = [("Storage", style) for style in styles_of("Storage") if style.form == "counter"]
LOOKS = [*COUNTERS, *((kind, style) for kind in KINDS for style in styles_of(kind))]


@pytest.mark.parametrize(("kind", "style"), LOOKS, ids=lambda each: each.name if isinstance(each, Style) else each)
def test_a_cup_finds_a_place(kind: str, style: Style) -> None:
    item = Furniture(
        id="it", model_type=kind, style=style.name, room="room", x=0.0, y=0.0, yaw=0.0,
        width_m=style.width_m, depth_m=style.depth_m, height_m=style.height_m,
    )  # fmt: skip
    parts, half = parts_of(item), CUP_M / 2
    spots = itertools.product(*([k / 20 * extent for k in range(-10, 11)] for extent in (style.depth_m, style.width_m)))
    found = {height_at(parts, (x - half, y - half, x + half, y + half)) for x, y in spots} - {None}
    assert len(found) == 1, "one level, free of what is drawn there"
    top = next(part for part in parts if part.name == "top")
    assert found.pop() == pytest.approx(top.center[2] + top.size[2] / 2, abs=1e-9)
