"""Interiors work for people: clearances, kitchen lines, seats that face something, things where they belong."""

from itertools import combinations, pairwise
from typing import Any

import numpy as np
import pytest

from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.schemas.worlds.world import MODEL_TYPES, Floorplan, Furniture
from prefect_robomaker.tasks.worldforge.floorplans.floorplan import generate_floorplan
from prefect_robomaker.tasks.worldforge.furniture.usual_furniture import RULES
from prefect_robomaker.tasks.worldforge.generator import generate_world
from prefect_robomaker.tasks.worldforge.geometry.occupancy import furniture_corners
from prefect_robomaker.tasks.worldforge.interiors.candidate_poses import sits_at
from prefect_robomaker.tasks.worldforge.interiors.interior import furnish

from ..conftest import MakeBody
from .test_interior import arrangement, extent, front, interior, of_kind, shared_m

SEEDS = [0, 1, 2, *(pytest.param(seed, marks=pytest.mark.deep) for seed in (3, 4, 5))]
SIX = (
    ("Lounge", "Living", 26.0),
    ("Kitchen", "Kitchen", 14.0),
    ("Dining", "Dining", 16.0),
    ("Bedroom", "Bedroom", 18.0),
    ("Bath", "Bathroom", 10.0),
    ("Hall", "Hallway", 10.0),
)
TYPES = ["Living", "Kitchen", "Dining", "Bedroom", "Bathroom", "Hallway"]
TUCKED = {("Desks", "DeskChairs"), ("DiningTables", "DiningChairs")}


def zone(item: Furniture, depth_m: float) -> Furniture:
    """The place before a piece, as a piece itself."""
    at = np.array([item.x, item.y]) + front(item) * (item.depth_m + depth_m) / 2
    return item.model_copy(update={"x": at[0], "y": at[1], "depth_m": depth_m})


def blocked_m(item: Furniture, depth_m: float, furniture: list[Furniture]) -> list[tuple[str, float]]:
    before = zone(item, depth_m)
    others = [other for other in furniture if other.id != item.id and not other.movable]
    return [(other.model_type, shared_m(before, other)) for other in others if shared_m(before, other) > 0.005]


@pytest.mark.parametrize("seed", SEEDS)
def test_what_is_opened_or_worked_at_has_its_clearance(make_body: MakeBody, seed: int) -> None:
    plan, furniture, _ = interior(make_body(SIX, furniture=[arrangement("all", None, "Dense", RoomTypes=TYPES)]), seed)
    hall = {room.name for room in plan.rooms if room.type == "Hallway"}
    corner_counters = 0
    for item in furniture:
        if item.movable or item.model_type in ("Sofas", "LivingRoomChairs", "Beds", "Desks"):
            continue
        depth = max(RULES[item.model_type].front_m, 0.9 if item.room in hall else 0.0)
        if not depth:
            continue
        found = blocked_m(item, depth, furniture)
        if found and item.room == "Kitchen" and item.model_type == "Storage":
            corner_counters += 1
            continue
        assert found == [], item.id
    assert corner_counters <= 2  # kitchens in U have two corners


@pytest.mark.parametrize("seed", SEEDS)
def test_beds_for_two_can_be_left_on_both_sides(make_body: MakeBody, seed: int) -> None:
    wish = [arrangement("all", None, "Dense", RoomTypes=["Bedroom"])]
    plan, furniture, _ = interior(
        make_body((("Hall", "Hallway", 12.0), ("Bedroom", "Bedroom", 24.0)), furniture=wish), seed
    )
    (bed,) = of_kind(furniture, "Beds")
    if bed.width_m < 1.2:
        return
    walls = [extent_of(wall) for wall in plan.walls if not wall.lintel]
    side = np.array([-np.sin(bed.yaw), np.cos(bed.yaw)])
    for sign in (1, -1):
        at = np.array([bed.x, bed.y]) + sign * side * (bed.width_m / 2 + 0.25)
        strip = bed.model_copy(update={"x": at[0], "y": at[1], "width_m": 0.5})
        x0, y0, x1, y1 = extent(furniture_corners(strip))
        assert all(min(x1, w[2]) - max(x0, w[0]) < 0.01 or min(y1, w[3]) - max(y0, w[1]) < 0.01 for w in walls)
        inside = {item.model_type for item in furniture if not item.movable and shared_m(strip, item) > 0.005}
        assert inside - {"Beds"} <= {"Nightstands"}


def extent_of(wall: Any) -> tuple[float, float, float, float]:
    half = wall.thickness_m / 2
    (x0, x1), (y0, y1) = sorted((wall.start[0], wall.end[0])), sorted((wall.start[1], wall.end[1]))
    return (x0, y0 - half, x1, y1 + half) if x1 - x0 > y1 - y0 else (x0 - half, y0, x1 + half, y1)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_kitchens_line_is_unbroken_and_in_the_order_of_the_work(make_body: MakeBody, seed: int) -> None:
    _, furniture, _ = interior(make_body((("Kitchen", "Kitchen", 16.0), ("Hall", "Hallway", 12.0))), seed)
    line = [
        item
        for item in of_room(furniture, "Kitchen")
        if item.model_type in ("Fridges", "Ovens", "DishWashers", "Storage")
    ]
    (fridge,), (oven,), (washer,) = (of_kind(line, kind) for kind in ("Fridges", "Ovens", "DishWashers"))
    (sink,) = [item for item in line if item.style.startswith("counter-sink")]
    runs = [[item for item in line if item.yaw == yaw] for yaw in sorted({item.yaw for item in line})]
    assert len(runs) <= 3
    for run in runs:
        along = [along_wall(item) for item in run]
        run = [item for _, item in sorted(zip(along, run, strict=True), key=lambda pair: pair[0])]
        for one, other in pairwise(run):
            assert along_wall(other) - along_wall(one) == pytest.approx((one.width_m + other.width_m) / 2, abs=0.008)
        backs = [np.array([item.x, item.y]) @ front(item) - item.depth_m / 2 for item in run]
        assert np.ptp(backs) < 0.004
        if fridge in run:
            assert run.index(fridge) in (0, len(run) - 1)
            assert oven in run
        if sink in run:
            assert abs(run.index(sink) - run.index(washer)) == 1


def along_wall(item: Furniture) -> float:
    return float(np.array([item.x, item.y]) @ np.array([-np.sin(item.yaw), np.cos(item.yaw)]))


def of_room(furniture: list[Furniture], room: str) -> list[Furniture]:
    return [item for item in furniture if item.room == room]


@pytest.mark.parametrize("seed", SEEDS)
def test_every_desk_has_a_chair_that_looks_at_it(make_body: MakeBody, seed: int) -> None:
    office = [arrangement("office", ["Desks", "DeskChairs", "Bookcases"], "Dense", RoomTypes=["Living"])]
    _, furniture, _ = interior(
        make_body((("Office", "Living", 20.0), ("Hall", "Hallway", 12.0)), furniture=office), seed
    )
    desks, chairs = of_kind(furniture, "Desks"), of_kind(furniture, "DeskChairs")
    assert len(desks) == len(chairs) >= 1
    for desk in desks:
        (chair,) = [one for one in chairs if shared_m(one, desk) > 0.05]
        assert front(chair) @ front(desk) < -0.9


@pytest.mark.parametrize("seed", SEEDS)
def test_the_line_of_sight_from_sofa_to_screen_is_free(make_body: MakeBody, seed: int) -> None:
    _, furniture, _ = interior(make_body((("Lounge", "Living", 28.0), ("Hall", "Hallway", 12.0))), seed)
    screen, sofa = of_kind(furniture, "MediaStorage")[0], of_kind(furniture, "Sofas")[0]
    offset = np.array([screen.x - sofa.x, screen.y - sofa.y])
    assert front(sofa) @ front(screen) == pytest.approx(-1.0)
    assert 1.7 <= offset @ front(sofa) - (sofa.depth_m + screen.depth_m) / 2 <= 4.3
    assert abs(offset[0] * front(sofa)[1] - offset[1] * front(sofa)[0]) <= 0.36
    tall = [item for item in furniture if item.height_m > 0.6 and item.model_type not in ("Sofas", "MediaStorage")]
    for share in np.linspace(0.15, 0.85, 20):
        x, y = np.array([sofa.x, sofa.y]) + share * offset
        for item in tall:
            x0, y0, x1, y1 = extent(furniture_corners(item))
            assert not (x0 < x < x1 and y0 < y < y1), item.id
    (table,) = of_kind(furniture, "CoffeeTables")
    gap = np.array([table.x - sofa.x, table.y - sofa.y]) @ front(sofa) - (table.depth_m + sofa.depth_m) / 2
    assert gap == pytest.approx(0.4, abs=0.01)


@pytest.mark.parametrize("seed", SEEDS)
def test_nothing_tall_stands_before_a_window_and_nothing_where_a_door_swings(make_body: MakeBody, seed: int) -> None:
    body = make_body(SIX, furniture=[arrangement("all", list(MODEL_TYPES), "Dense", RoomTypes=TYPES)])
    plan, furniture = with_doors(body, seed)
    for window in plan.windows:
        (x0, x1), (y0, y1) = sorted((window.start[0], window.end[0])), sorted((window.start[1], window.end[1]))
        for item in furniture:
            u0, v0, u1, v1 = extent(furniture_corners(item))
            along, across = (0, 1) if x1 - x0 > y1 - y0 else (1, 0)
            overlap = (min(u1, x1) - max(u0, x0), min(v1, y1) - max(v0, y0))
            hides = overlap[along] > 0.005 and overlap[across] > -0.3
            assert not (hides and item.height_m > 1.2 and item.room == window.room), item.id
    doors = [passage.door for passage in plan.passages if passage.door]
    assert doors
    for door in doors:
        for item in furniture:
            if item.base_m < 0.1:
                assert not any(
                    inside(item, leaf_point(door, angle, reach)) for angle in turns(door) for reach in REACHES
                )


REACHES = np.linspace(0.1, 1.0, 8)


def turns(door: Any) -> list[float]:
    return [float(angle) for angle in np.linspace(0, door.max_angle_rad, 12)]


def leaf_point(door: Any, angle: float, share: float) -> tuple[float, float]:
    yaw = door.closed_yaw + door.swing * angle
    reach = share * door.leaf_width_m
    return door.hinge[0] + reach * np.cos(yaw), door.hinge[1] + reach * np.sin(yaw)


def inside(item: Furniture, point: tuple[float, float]) -> bool:
    x, y = point[0] - item.x, point[1] - item.y
    c, s = np.cos(item.yaw), np.sin(item.yaw)
    return abs(x * c + y * s) < item.depth_m / 2 and abs(y * c - x * s) < item.width_m / 2


def with_doors(body: WorldTemplateBody, seed: int) -> tuple[Floorplan, list[Furniture]]:
    hinged = body.model_copy(update={"Version": "2"})
    plan = generate_floorplan(hinged, seed)
    return plan, furnish(hinged, plan, np.random.default_rng(seed))[0]


def test_denser_rooms_hold_more_pieces(make_body: MakeBody) -> None:
    counts: dict[str, list[int]] = {}
    for density in ("Sparse", "Moderate", "Dense"):
        body = make_body(SIX, furniture=[arrangement("all", None, density, RoomTypes=TYPES)])
        counts[density] = [sum(not item.movable for item in interior(body, seed)[1]) for seed in range(3)]
    assert all(a < b < c for a, b, c in zip(*counts.values(), strict=True))
    assert np.mean(counts["Sparse"]) * 1.4 < np.mean(counts["Moderate"]) < np.mean(counts["Dense"]) / 1.25


def test_small_things_lie_where_people_leave_them_and_stay_there(make_body: MakeBody) -> None:
    kinds = set[str]()
    for seed in range(5):
        world = generate_world(
            make_body(SIX, furniture=[arrangement("all", None, "Dense", RoomTypes=TYPES)]), seed, seed
        )
        assert world.checks is not None
        assert world.checks.settled_share == 1.0
        loose = [item for item in world.furniture if item.movable]
        kinds |= {item.model_type for item in loose}
        for one, other in combinations([item for item in loose if item.base_m > 0], 2):
            assert np.hypot(one.x - other.x, one.y - other.y) > 0.1, (one.id, other.id)
        rooms = {room.name: room.type for room in world.floorplan.rooms}
        for item in loose:
            if item.model_type in ("Plate", "Cup"):
                assert item.base_m > 0.35, item.id
            if item.model_type in ("Clothes", "Shoe"):
                assert rooms[item.room] in ("Bedroom", "Bathroom", "Hallway", "Closet"), item.id
    assert {"Book", "Cup", "Plate", "Clothes", "Shoe"} <= kinds


def test_a_piece_that_needs_another_says_so(make_body: MakeBody) -> None:
    tiny = (("Lounge", "Living", 24.0), ("Store", "Closet", 10.0))
    kinds = ["Storage", "Dressers", "Bookcases", "Beds", "DiningTables", "DiningChairs", "Nightstands"]
    found: dict[str, list[str]] = {}
    for seed in range(8):
        _, _, wishes = interior(
            make_body(tiny, furniture=[arrangement("all", kinds, "Dense", RoomNames=["Store"])]), seed
        )
        for wish in wishes:
            if wish.outcome == "missed" and "ModelTypes" in wish.path:
                found.setdefault(wish.wish, []).append(wish.reason)
    assert "DiningTables found no place in Store" in found["DiningChairs in all"]
    assert any(" m x " in reason and "room around it" in reason for reason in found["DiningTables in all"])


@pytest.mark.parametrize("seed", range(3))
def test_each_table_of_a_room_has_chairs(make_body: MakeBody, seed: int) -> None:
    rooms = (("Hall", "Hallway", 12.0), ("Dining", "Dining", 60.0))
    dense = arrangement("all", None, "Dense", RoomTypes=["Dining"])
    _, furniture, _ = interior(make_body(rooms, furniture=[dense]), seed)
    tables = [item for item in furniture if item.model_type == "DiningTables"]
    chairs = [item for item in furniture if item.model_type == "DiningChairs"]
    seats = [sum(sits_at(chair, table) for chair in chairs) for table in tables]
    assert len(tables) >= 2
    assert min(seats) >= 3, seats
    assert sum(seats) == len(chairs)
