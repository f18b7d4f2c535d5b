"""Interiors keep the rules that `helpers/room_rules.py` counts, and each rule notices a world that breaks it."""

from collections.abc import Callable, Iterable
from functools import cache

import pytest
from helpers.room_rules import LINE, RULES, TEMPLATES, Case, broken, few_forms, same_pieces

from prefect_robomaker.schemas.worlds.world import Furniture, Preference, World
from prefect_robomaker.tasks.worldforge.generator import generate_world, seeds_for

HOUSE = "house, dense"


@cache
def case(name: str = HOUSE, seed: int = 2) -> Case:
    """A furnished world of one of the templates; that of the house breaks no rule."""
    return Case(TEMPLATES[name], generate_world(TEMPLATES[name], *seeds_for(seed, 0, 0), settle=False))


def with_furniture(furniture: Iterable[Furniture]) -> World:
    return case().world.model_copy(update={"furniture": list(furniture)})


def without(*kinds: str, room: str | None = None) -> World:
    """The house without some kinds of furniture."""
    pieces = case().world.furniture
    return with_furniture(one for one in pieces if one.model_type not in kinds or room not in (None, one.room))


def changed(kind: str, **values: float) -> World:
    """The house with other values of each piece of a kind."""
    pieces = case().world.furniture
    return with_furniture(one.model_copy(update=values) if one.model_type == kind else one for one in pieces)


def without_windows() -> World:
    plan = case().world.floorplan
    kept = [window for window in plan.windows if window.room != "Bath"]
    return case().world.model_copy(update={"floorplan": plan.model_copy(update={"windows": kept})})


def with_something_before_the_fridge() -> World:
    (fridge,) = case().of("Fridges")
    inside = fridge.model_copy(update={"id": "Ottomans_99", "model_type": "Ottomans", "width_m": 0.9, "depth_m": 1.5})
    return with_furniture([*case().world.furniture, inside])


def without_worktop() -> World:
    return with_furniture(
        one
        for one in case().world.furniture
        if one.model_type not in LINE or not one.style.startswith("counter") or one.style.startswith("counter-sink")
    )


def with_few_loose_objects() -> World:
    wish = Preference(path="a.LooseObjects", wish="40", outcome="missed", reason="Bath has place for 4")
    return case().world.model_copy(update={"wishes": [wish]})


SABOTAGES: dict[str, Callable[[], World]] = {
    "bath_windows": without_windows,
    "double_beds": lambda: changed("Beds", width_m=0.98),
    "nightstands": lambda: without("Nightstands"),
    "fronts": with_something_before_the_fridge,
    "desk_chairs": lambda: without("DeskChairs"),
    "screens": lambda: changed("Sofas", yaw=0.0 if case().of("Sofas")[0].yaw else 1.5708),
    "kitchens": without_worktop,
    "dining": lambda: changed("DiningTables", x=30.0),
    "zones": lambda: without("Desks", "DiningTables", room="Living"),
    "density": lambda: without("Storage", "Showers", "Baths", room="Bath"),
    "loose_objects": with_few_loose_objects,
    "bathrooms": lambda: without("Toilets"),
}


@pytest.mark.parametrize("rule", RULES)
def test_a_rule_notices_a_world_that_breaks_it(rule: str) -> None:
    assert list(RULES[rule](case())) == []
    assert list(RULES[rule](Case(TEMPLATES[HOUSE], SABOTAGES[rule]())))


@pytest.mark.parametrize(
    ("name", "seed"), [("flat", 0), *(pytest.param(name, 7, marks=pytest.mark.deep) for name in TEMPLATES)]
)
def test_rooms_are_what_an_architect_would_sign(name: str, seed: int) -> None:
    assert [place for places in broken(case(name, seed)).values() for place in places] == []


def test_kitchens_that_are_all_alike_are_noticed() -> None:
    assert list(few_forms({"line": 19, "L": 1, "U": 1, "line with island": 3})) == [
        "1 of 24 kitchens have the form L",
        "1 of 24 kitchens have the form U",
    ]
    assert list(same_pieces({("Ovens", "Fridges"): 3, ("Ovens",): 1}))
    assert not list(same_pieces({("Ovens", "Fridges"): 1, ("Ovens",): 1}))
