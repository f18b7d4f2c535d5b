"""Interiors keep the rules that `helpers/room_rules.py` counts, and each rule notices a world that breaks it."""

import re
from collections.abc import Callable, Iterable
from functools import cache

import pytest
from helpers.paths import TESTS
from helpers.room_rules import DENSE_SHARES, LINE, RULES, TEMPLATES, Case, broken, few_forms, is_fine, same_pieces

from prefect_robomaker.schemas.worlds.world import Furniture, World
from prefect_robomaker.tasks.worldforge.generator import generate_world, seeds_for
from prefect_robomaker.tasks.worldforge.interiors import room_density

HOUSE, LOFT = "house, dense", "loft, 40 loose objects"
DOCS = TESTS.parent / "docs"


@cache
def case(name: str = HOUSE, seed: int = 3) -> Case:
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
    """The loft without one of the loose objects asked for; its report still says that all are there."""
    world = case(LOFT).world
    one_of_them = next(one for one in world.furniture if one.movable and one.room == "Loft")
    return world.model_copy(update={"furniture": [one for one in world.furniture if one is not one_of_them]})


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
    whole = case(LOFT if rule == "loose_objects" else HOUSE)
    assert list(RULES[rule](whole)) == []
    assert list(RULES[rule](Case(whole.body, SABOTAGES[rule]())))


def test_shares_of_dense_rooms_are_those_of_the_documentation(monkeypatch: pytest.MonkeyPatch) -> None:
    emptied = {kind: (0.0, 0.0, full_m2) for kind, (_, _, full_m2) in room_density._SHARES.items()}
    monkeypatch.setattr(room_density, "_SHARES", emptied)
    assert list(RULES["density"](Case(TEMPLATES[HOUSE], SABOTAGES["density"]())))
    told = re.findall(r"^\| (\w+) \| \d+ % \| (\d+) % \| (\d+) m² \|$", (DOCS / "worlds.md").read_text(), re.MULTILINE)
    assert {kind: (int(share) / 100, float(full_m2)) for kind, share, full_m2 in told} == DENSE_SHARES


def test_a_failed_proof_or_many_broken_rules_fail_the_count() -> None:
    assert is_fine({"kitchens": ["a"] * 5, "proofs": []}, most=5)
    assert not is_fine({"kitchens": ["a"] * 6, "proofs": []}, most=5)
    assert not is_fine({"kitchens": [], "proofs": ["a"]}, most=5)


@pytest.mark.parametrize(
    ("name", "seed"), [("flat", 0), *(pytest.param(name, 7, marks=pytest.mark.deep) for name in TEMPLATES)]
)
def test_rooms_are_what_an_architect_would_sign(name: str, seed: int) -> None:
    assert [place for places in broken(case(name, seed)).values() for place in places] == []


def test_a_narrow_kitchen_has_fewer_pieces_rather_than_no_worktop() -> None:
    narrow = Case(TEMPLATES["house"], generate_world(TEMPLATES["house"], *seeds_for(7, 5, 0), settle=False))
    assert list(RULES["kitchens"](narrow)) == []


@pytest.mark.parametrize("name", ["flat", "flat, dense, without doors"])
def test_a_kitchen_with_windows_in_its_corners_has_worktop_between_sink_and_stove(name: str) -> None:
    # One wall is gone, and windows in the three others leave no corner for a tall fridge.
    world = generate_world(TEMPLATES[name], *seeds_for(7, 20, 0), settle=False)
    assert [place for place in RULES["kitchens"](Case(TEMPLATES[name], world)) if "worktop" in place] == []


def test_kitchens_that_are_all_alike_are_noticed() -> None:
    assert list(few_forms({"line": 19, "L": 1, "U": 1, "line with island": 3})) == [
        "1 of 24 kitchens have the form L",
        "1 of 24 kitchens have the form U",
    ]
    assert list(same_pieces({("Ovens", "Fridges"): 3, ("Ovens",): 1}))
    assert not list(same_pieces({("Ovens", "Fridges"): 1, ("Ovens",): 1}))
