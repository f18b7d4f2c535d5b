"""Worlds that only the extensions of templates allow: a robot enters each of their rooms, and all proofs hold."""

import json
from typing import Any

import pytest
from helpers.extended_templates import extended_template, not_entered

from prefect_robomaker.schemas.templates.body import LEAST_AREAS_M2, WorldTemplateBody
from prefect_robomaker.schemas.templates.parsing import parse_template_body
from prefect_robomaker.schemas.worlds.world import INDOOR_ROOM_TYPES, FurnishedRoomType, Furniture, World
from prefect_robomaker.tasks.worldforge.generator import generate_world, seeds_for
from prefect_robomaker.tasks.worldforge.interiors.candidate_poses import sits_at
from prefect_robomaker.tasks.worldforge.pictures.plan_svg import floorplan_svg
from prefect_robomaker.tasks.worldforge.proofs.guarantees import violations

Wished = tuple[str, FurnishedRoomType, float, float]


def template(rooms: list[Wished], ways: list[tuple[str, str]], version: str = "2") -> WorldTemplateBody:
    wishes = [
        {"Name": name, "Type": kind, "DesiredShape": {"Area": area, "AspectRatio": {"x": ratio, "y": 1}}}
        for name, kind, area, ratio in rooms
    ]
    doorways = [{"Location": way, "ConnectionType": "Doorway"} for way in ways]
    floor: dict[str, Any] = {"Floorplan": {"Rooms": wishes, "DesiredConnections": doorways}}
    return parse_template_body(json.dumps({"Version": version, "Buildings": [{"Floors": [floor]}]}))


def check(world: World) -> None:
    assert world.checks is not None
    assert violations(world.checks) == []
    assert not_entered(world) == []


def kinds_in(world: World, room: str) -> set[str]:
    return {item.model_type for item in world.furniture if item.room == room}


SWEEP = [3, pytest.param(8, marks=pytest.mark.deep), pytest.param(30, marks=pytest.mark.endurance)]
OF_SIZES = [
    *((size, 3) for size in ("small", "large")),
    pytest.param("middle", 8, marks=pytest.mark.deep),
    *(pytest.param(size, 30, marks=pytest.mark.endurance) for size in ("small", "middle", "large")),
]
"""Few worlds of the smallest and the largest rooms, more of those between; a sweep is for endurance runs."""


@pytest.mark.parametrize("worlds", SWEEP)
def test_a_robot_enters_all_rooms_of_random_templates_of_small_rooms(worlds: int) -> None:
    for number in range(worlds):
        check(generate_world(extended_template(number), *seeds_for(number, 0, 0), settle=worlds > 3))


@pytest.mark.parametrize(
    "worlds", [pytest.param(2, marks=pytest.mark.deep), pytest.param(15, marks=pytest.mark.endurance)]
)
def test_a_robot_enters_all_rooms_of_random_templates_of_many_rooms(worlds: int) -> None:
    for number in range(worlds):
        body = extended_template(number, rooms=(7, 12), most_ways=16)
        world = generate_world(body, *seeds_for(number, 0, 0), settle=True)
        check(world)
        assert [room.name for room in world.floorplan.rooms] == [room.Name for room in body.floorplan.Rooms]
        granted = [abs(room.floor_m2 / room.desired_area_m2 - 1) <= 0.05 for room in world.floorplan.rooms]
        assert sum(granted) >= 0.8 * len(granted)


def test_a_room_behind_furniture_is_not_entered() -> None:
    """The independent look can fail: a cupboard before a doorway, and an unjoined room."""
    world = generate_world(template(FLAT, WAYS), *seeds_for(5, 0, 0), settle=False)
    assert not_entered(world) == []
    way = next(each for each in world.floorplan.passages if "Bath" in each.rooms)
    x, y = ((a + b) / 2 for a, b in zip(way.start, way.end, strict=True))
    plug = Furniture(
        id="plug", model_type="Storage", room="Bath", x=x, y=y, yaw=0.0, width_m=0.7, depth_m=0.7, height_m=1.0
    )
    assert not_entered(world.model_copy(update={"furniture": [*world.furniture, plug]})) == ["Bath"]


FLAT: list[Wished] = [
    ("Hall", "Hallway", 6.0, 2.0),
    ("Living", "Living", 22.0, 1.3),
    ("Kitchen", "Kitchen", 8.0, 1.3),
    ("Bed", "Bedroom", 13.0, 1.2),
    ("Bath", "Bathroom", 4.0, 1.2),
    ("Closet", "Closet", 3.0, 1.3),
]
WAYS = [("Hall", "Living"), ("Hall", "Bed"), ("Hall", "Bath"), ("Hall", "Closet"), ("Living", "Kitchen")]


@pytest.mark.parametrize(("size", "worlds"), OF_SIZES)
def test_a_small_bathroom_has_a_toilet_a_basin_and_a_shower_or_says_why_not(size: str, worlds: int) -> None:
    area = {"small": 4.0, "middle": 5.0, "large": 8.0}[size]
    rooms: list[Wished] = [(name, kind, area if name == "Bath" else size, ratio) for name, kind, size, ratio in FLAT]
    complete = 0
    for number in range(worlds):
        world = generate_world(template(rooms, WAYS), *seeds_for(5, number, 0), settle=False)
        check(world)
        assert world.checks is not None
        assert min(way.clear_width_m for way in world.checks.room_graph if "Bath" in way.rooms) >= 0.8
        kinds = kinds_in(world, "Bath")
        missed = " ".join(wish.wish for wish in world.wishes if wish.outcome == "missed" and "Bath" in wish.wish)
        lacking = [
            group
            for group in (("Toilets",), ("Showers", "Baths"), ("VanityCounters",))
            if not kinds.intersection(group)
        ]
        assert all(" or ".join(group) in missed for group in lacking), (number, kinds, missed)
        complete += not lacking
    assert complete >= 0.6 * worlds


@pytest.mark.parametrize(("size", "worlds"), OF_SIZES)
def test_an_office_has_desk_chair_and_shelves_and_a_storage_room_shelves(size: str, worlds: int) -> None:
    office, storage = {"small": (6.0, 3.0), "middle": (9.0, 4.0), "large": (16.0, 12.0)}[size]
    rooms: list[Wished] = [*FLAT[:4], ("Office", "Office", office, 1.2), ("Store", "Storage", storage, 1.3)]
    ways = [("Hall", "Living"), ("Hall", "Bed"), ("Hall", "Office"), ("Living", "Kitchen"), ("Kitchen", "Store")]
    lit = complete = 0
    for number in range(worlds):
        world = generate_world(template(rooms, ways), *seeds_for(5, number, 0), settle=False)
        check(world)
        desks = [item for item in world.furniture if item.model_type == "Desks" and item.room == "Office"]
        chairs = [item for item in world.furniture if item.model_type == "DeskChairs" and item.room == "Office"]
        assert all(any(sits_at(chair, desk) for desk in desks) for chair in chairs)
        complete += bool(desks) and len(chairs) >= 1 and bool({"Bookcases", "Storage"} & kinds_in(world, "Office"))
        assert {"Bookcases", "Storage"} & kinds_in(world, "Store")
        lit += any(window.room == "Office" for window in world.floorplan.windows)
    assert complete >= 0.6 * worlds
    assert lit >= 0.9 * worlds


def test_a_plan_says_colours_of_further_types_only_where_it_has_them() -> None:
    rooms: list[Wished] = [("Living", "Living", 12.0, 1.2), ("It", "Office", 8.0, 1.0)]
    has, has_not = (
        floorplan_svg(generate_world(template(some, []), *seeds_for(1, 0, 0), settle=False))
        for some in (rooms, rooms[:1])
    )
    assert has.count(".fp-Office{fill:") == 2
    assert 'class="fp-Office"' in has
    assert "fp-Office" not in has_not


@pytest.mark.parametrize("kind", INDOOR_ROOM_TYPES)
def test_each_type_can_have_its_least_area(kind: FurnishedRoomType) -> None:
    least = LEAST_AREAS_M2[kind]
    alone = generate_world(template([("Only", kind, least, 1.0)], []), *seeds_for(1, 0, 0), settle=False)
    check(alone)
    rooms: list[Wished] = [("Hall", "Hallway", 5.0, 2.0), ("Living", "Living", 12.0, 1.2), ("It", kind, least, 1.0)]
    world = generate_world(template(rooms, [("Hall", "It")]), *seeds_for(1, 0, 0), settle=False)
    check(world)
    assert world.floorplan.rooms[2].floor_m2 == pytest.approx(least, rel=0.25)


def test_compact_pieces_stand_in_small_rooms_only() -> None:
    large: list[Wished] = [(name, kind, max(area, 10.0), ratio) for name, kind, area, ratio in FLAT]
    for rooms, has_compact in ((FLAT, True), (large, False)):
        styles = {
            item.style
            for number in range(3)
            for item in generate_world(template(rooms, WAYS), *seeds_for(5, number, 0), settle=False).furniture
        }
        assert any(" compact" in style for style in styles) == has_compact
