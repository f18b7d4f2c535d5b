"""Worlds of templates drawn at random, kept unfiltered: hardly any fails, and rooms get the shapes they are wished."""

import json
from typing import Any

import numpy as np
import pytest
from helpers.random_templates import random_template

from prefect_robomaker.schemas.templates.parsing import parse_template_body
from prefect_robomaker.schemas.wire.errors import WorldGenerationError
from prefect_robomaker.schemas.worlds.world import Room, World
from prefect_robomaker.tasks.worldforge.floorplans.floorplan import generate_floorplan
from prefect_robomaker.tasks.worldforge.generator import generate_world, seeds_for

TEMPLATES = 100
FEW_TEMPLATES = 25
WORLDS_EACH = 20
SEATS = {"Sofas", "LivingRoomChairs"}


def worlds_of(templates: int, each: int, *, settle: bool) -> tuple[list[World], list[str]]:
    """The worlds of the first templates, and why others failed."""
    made: list[World] = []
    failures: list[str] = []
    for number in range(templates):
        body = random_template(number)
        for index in range(each):
            try:
                made.append(generate_world(body, *seeds_for(number, index, 0), settle=settle))
            except WorldGenerationError as error:
                failures.append(f"template {number}: {error}")
    return made, failures


def check(worlds: list[World]) -> None:
    rooms = [room for world in worlds for room in world.floorplan.rooms]
    off = [abs(room.floor_m2 / room.desired_area_m2 - 1) for room in rooms]
    assert np.mean([share <= 0.05 for share in off]) > 0.98
    assert max(off) < 0.15
    ratios = [abs(np.log((room.aspect_ratio or 1) / room.desired_aspect_ratio)) for room in rooms]
    assert np.mean([ratio <= np.log(1.15) for ratio in ratios]) > 0.95
    assert np.percentile(ratios, 90) < 0.13


@pytest.mark.deep
def test_a_sample_of_random_templates_gives_worlds_with_the_shapes_they_wish() -> None:
    worlds, failures = worlds_of(FEW_TEMPLATES, 1, settle=False)
    assert failures == []
    check(worlds)


@pytest.mark.endurance
@pytest.mark.timeout(3600)
def test_at_most_one_in_a_thousand_worlds_of_random_templates_fails() -> None:
    worlds, failures = worlds_of(TEMPLATES, WORLDS_EACH, settle=True)
    assert len(failures) <= TEMPLATES * WORLDS_EACH / 1000, failures
    check(worlds)


def house(rooms: list[tuple[str, str, float, float]], ways: list[tuple[str, str]], version: str) -> Any:
    wishes = [
        {"Name": name, "Type": kind, "DesiredShape": {"Area": area, "AspectRatio": {"x": ratio, "y": 1}}}
        for name, kind, area, ratio in rooms
    ]
    doorways = [{"Location": way, "ConnectionType": "Doorway"} for way in ways]
    floorplan = {"Rooms": wishes, "DesiredConnections": doorways}
    return parse_template_body(json.dumps({"Version": version, "Buildings": [{"Floors": [{"Floorplan": floorplan}]}]}))


AROUND = [
    ("Hall", "Hallway", 12.0, 3.0),
    ("Living", "Living", 24.0, 1.3),
    ("Kitchen", "Kitchen", 12.0, 1.2),
    ("Bed", "Bedroom", 16.0, 1.2),
    ("Bath", "Bathroom", 10.0, 1.5),
    ("Guests", "Bedroom", 13.0, 1.2),
]


@pytest.mark.parametrize("worlds", [6, pytest.param(30, marks=pytest.mark.deep)])
def test_a_long_hallway_with_four_doors_fails_in_no_world(worlds: int) -> None:
    body = house(AROUND, [("Hall", name) for name, *_ in AROUND[1:5]], "2")
    for index in range(worlds):
        world = generate_world(body, *seeds_for(5, index, 0), settle=False)
        assert world.interior_attempt == 0
        assert all(wish.outcome == "satisfied" for wish in world.floorplan.wishes if "Doorway" in wish.wish)


@pytest.mark.parametrize("worlds", [8, pytest.param(40, marks=pytest.mark.deep)])
def test_small_kitchens_have_ovens_and_small_living_rooms_seats(worlds: int) -> None:
    body = house(
        [("Kitchen", "Kitchen", 10.0, 2.5), ("Living", "Living", 10.0, 2.2), ("Hall", "Hallway", 10.0, 3.0)],
        [("Hall", "Kitchen"), ("Hall", "Kitchen"), ("Hall", "Living"), ("Kitchen", "Living")],
        "2",
    )
    for index in range(worlds):
        world = generate_world(body, *seeds_for(3, index, 0), settle=False)
        assert any(item.model_type == "Ovens" and item.room == "Kitchen" for item in world.furniture), index
        assert any(item.model_type in SEATS and item.room == "Living" for item in world.furniture), index


STRIP_AND_SQUARE = [("Strip", "Living", 24.0, 4.0), ("Square", "Bedroom", 24.0, 1.0)]
ALIKE = [("Strip", "Living", 24.0, 1.5), ("Square", "Bedroom", 24.0, 1.5)]


def test_the_best_plan_of_rooms_that_fill_a_rectangle_has_floors_of_exactly_their_sides() -> None:
    plan = generate_floorplan(house(ALIKE, [], "1"), seeds_for(1, 0, 0, diverse=False)[0])
    assert len(plan.footprint) == 4
    for room in plan.rooms:
        long, short = floor_sides(room, plan.footprint)
        assert room.floor_area_m2 == pytest.approx(long * short)
        assert room.aspect_ratio == pytest.approx(long / short, abs=1e-4)


@pytest.mark.parametrize("diverse", [False, True])
@pytest.mark.parametrize("rooms", [STRIP_AND_SQUARE, ALIKE], ids=["strip and square", "alike"])
def test_a_room_is_longer_for_its_width_on_its_floor_than_between_its_walls(rooms: Any, *, diverse: bool) -> None:
    for number in range(3):
        plan = generate_floorplan(house(rooms, [], "1"), seeds_for(1, number, 0, diverse=diverse)[0])
        # A line that is partly an outer wall takes 5 cm more of the floor there.
        least = 1.0 if len(plan.footprint) == 4 else 0.97
        for room in plan.rooms:
            long, short = floor_sides(room, plan.footprint)
            assert room.floor_area_m2 is not None
            assert least * long * short - 1e-9 <= room.floor_area_m2 <= long * short + 1e-9
            assert room.aspect_ratio == pytest.approx(long / short, rel=1.0001 - least)
            assert room.floor_area_m2 < room.area_m2


def floor_sides(room: Room, footprint: list[tuple[float, float]]) -> tuple[float, float]:
    """The longer and the shorter side between the faces of the walls: 10 cm from the outline, 5 cm from other lines."""
    sides = []
    for axis in (0, 1):
        ends, limits = ([point[axis] for point in corners] for corners in (room.polygon, footprint))
        outer = [min(ends) == min(limits), max(ends) == max(limits)]
        sides.append(max(ends) - min(ends) - sum(0.1 if there else 0.05 for there in outer))
    return max(sides), min(sides)
