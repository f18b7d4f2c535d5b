"""Interiors: who gets which furniture, and where it stands."""

from collections import Counter
from itertools import combinations
from typing import Any

import numpy as np
import pytest

from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.schemas.worlds.world import MODEL_TYPES, Floorplan, Furniture, Preference, Room, contains
from prefect_robomaker.tasks.worldforge.floorplans.floorplan import generate_floorplan
from prefect_robomaker.tasks.worldforge.furniture.catalogue import LOOSE_TYPES
from prefect_robomaker.tasks.worldforge.furniture.usual_furniture import usual_types
from prefect_robomaker.tasks.worldforge.generator import generate_world
from prefect_robomaker.tasks.worldforge.geometry.occupancy import (
    furniture_corners,
    occupancy_grid,
    reachable,
    wall_corners,
)
from prefect_robomaker.tasks.worldforge.interiors.interior import furnish

from ..conftest import MakeBody

SEEDS = range(4)


def interior(body: WorldTemplateBody, seed: int) -> tuple[Floorplan, list[Furniture], list[Preference]]:
    plan = generate_floorplan(body, seed)
    furniture, wishes, rooms = furnish(body, plan, np.random.default_rng(seed))
    return plan.model_copy(update={"rooms": rooms}), furniture, wishes


def arrangement(name: str, kinds: list[str] | None, density: str = "Moderate", **target: list[str]) -> dict[str, Any]:
    made: dict[str, Any] = {"Name": name, "TargetSet": target, "DesiredSpatialDensity": density}
    return made if kinds is None else made | {"SampleSet": {"ModelTypes": kinds}}


def extent(corners: list[tuple[float, float]]) -> tuple[float, float, float, float]:
    xs, ys = zip(*corners, strict=True)
    return min(xs), min(ys), max(xs), max(ys)


def shared_m(a: Furniture, b: Furniture) -> float:
    one, other = extent(furniture_corners(a)), extent(furniture_corners(b))
    return min(min(one[i + 2], other[i + 2]) - max(one[i], other[i]) for i in (0, 1))


def of_kind(furniture: list[Furniture], kind: str) -> list[Furniture]:
    return [item for item in furniture if item.model_type == kind]


def front(item: Furniture) -> np.ndarray:
    return np.array([np.cos(item.yaw), np.sin(item.yaw)])


@pytest.mark.parametrize("seed", SEEDS)
def test_furniture_stands_in_its_room_and_nowhere_else(make_body: MakeBody, seed: int) -> None:
    plan, furniture, _ = interior(make_body(), seed)
    rooms = {room.name: room for room in plan.rooms}
    walls = [extent(wall_corners(wall)) for wall in plan.walls if not wall.lintel]
    for item in furniture:
        x0, y0, x1, y1 = extent(furniture_corners(item))
        assert all(contains(rooms[item.room].polygon, *corner) for corner in furniture_corners(item)), item.id
        assert all(min(x1, w[2]) - max(x0, w[0]) < 1e-6 or min(y1, w[3]) - max(y0, w[1]) < 1e-6 for w in walls), item.id
    seats = {"DiningChairs", "DeskChairs"}
    for a, b in combinations([item for item in furniture if not item.movable], 2):
        tucked = 0.14 if seats & {a.model_type, b.model_type} else 0.002
        assert shared_m(a, b) < tucked, (a.id, b.id)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_robot_reaches_every_goal_and_the_origin_is_clear(make_body: MakeBody, seed: int) -> None:
    everything = arrangement("all", list(MODEL_TYPES), "Dense", RoomTypes=["Living", "Kitchen", "Bedroom", "Bathroom"])
    plan, furniture, _ = interior(make_body(furniture=[everything]), seed)
    grid = occupancy_grid(plan, furniture)
    reached = reachable(grid, (0.0, 0.0), 0.2)
    for room in plan.rooms:
        assert contains(room.polygon, *room.goal)
        assert reached[grid.cell(room.goal)], room.name
    for item in furniture:
        x0, y0, x1, y1 = extent(furniture_corners(item))
        assert np.hypot(max(x0, -x1, 0), max(y0, -y1, 0)) >= 0.5, item.id


def test_density_differs_measurably(make_body: MakeBody) -> None:
    covered: dict[str, list[float]] = {}
    for density in ("Sparse", "Moderate", "Dense"):
        wish = arrangement("all", None, density, RoomTypes=["Living", "Kitchen", "Bedroom", "Bathroom"])
        for seed in SEEDS:
            plan, furniture, _ = interior(make_body(furniture=[wish]), seed)
            area = sum(item.width_m * item.depth_m for item in furniture if not item.movable)
            covered.setdefault(density, []).append(area / sum(room.area_m2 for room in plan.rooms))
    means = {density: float(np.mean(shares)) for density, shares in covered.items()}
    assert means["Sparse"] * 1.3 < means["Moderate"]
    assert means["Moderate"] * 1.15 < means["Dense"]


def test_a_density_that_is_not_reached_is_told_with_what_was(make_body: MakeBody) -> None:
    body = make_body(
        furniture=[
            arrangement("lone bed", ["Beds"], "Dense", RoomNames=["Bedroom"]),
            arrangement("lone sofa", ["Sofas"], "Sparse", RoomNames=["Living Room"]),
        ]
    )
    plan, furniture, wishes = interior(body, 0)
    found = {wish.wish: wish for wish in wishes if wish.path.endswith("DesiredSpatialDensity")}
    assert found["Sparse furniture in lone sofa"].outcome == "satisfied"
    (bed,) = of_kind(furniture, "Beds")
    area = next(room.floor_m2 for room in plan.rooms if room.name == "Bedroom")
    share = bed.width_m * bed.depth_m / area
    assert found["Dense furniture in lone bed"].outcome == "missed"
    assert found["Dense furniture in lone bed"].reason.startswith(f"furniture covers {share:.0%} of Bedroom")


def test_no_model_types_means_no_furniture(make_body: MakeBody) -> None:
    plan, furniture, wishes = interior(make_body(furniture=[arrangement("bare", [], RoomNames=["Kitchen"])]), 0)
    assert {item.room for item in furniture} == {room.name for room in plan.rooms} - {"Kitchen"}
    assert not [wish for wish in wishes if "Furniture" in wish.path]


def test_a_set_for_the_rooms_name_beats_one_for_its_type(make_body: MakeBody) -> None:
    body = make_body(
        furniture=[
            arrangement("by type", ["Beds"], "Sparse", RoomTypes=["Living"]),
            arrangement("by name", ["Desks"], "Sparse", RoomNames=["Living Room"]),
        ]
    )
    _, furniture, wishes = interior(body, 0)
    assert {item.model_type for item in furniture if item.room == "Living Room" and not item.movable} == {"Desks"}
    outcomes = {wish.wish: (wish.outcome, wish.reason) for wish in wishes}
    assert outcomes["Desks in by name"] == ("satisfied", "")
    assert outcomes["Beds in by type"] == ("contradictory", "its rooms follow by name")


def test_what_does_not_fit_is_told_with_its_reason(make_body: MakeBody) -> None:
    body = make_body(
        (("Lounge", "Living", 20.0), ("Store", "Closet", 10.0)),
        furniture=[
            arrangement("crammed", list(MODEL_TYPES), "Dense", RoomNames=["Store"]),
            arrangement("nowhere", ["Ovens"], RoomTypes=["Kitchen"]),
        ],
    )
    _, furniture, wishes = interior(body, 3)
    present = {item.model_type for item in furniture if item.room == "Store"}
    listed = {
        wish.wish.split()[0]: wish for wish in wishes if wish.wish.endswith("crammed") and "ModelTypes" in wish.path
    }
    assert set(listed) == set(MODEL_TYPES)
    assert {kind for kind, wish in listed.items() if wish.outcome == "satisfied"} == present - set(LOOSE_TYPES)
    missed = [wish for wish in listed.values() if wish.outcome == "missed"]
    assert missed
    assert all("Store" in wish.reason for wish in missed)
    (ovens,) = [wish for wish in wishes if wish.wish == "Ovens in nowhere"]
    assert (ovens.outcome, ovens.reason) == ("missed", "the plan has no room Kitchen")
    assert ovens.path == "Buildings[0].Floors[0].Interior.Furniture.FurnitureArrangements[1].SampleSet.ModelTypes[0]"


@pytest.mark.parametrize("seed", SEEDS)
def test_beds_have_their_head_at_a_wall_and_nightstands_beside_it(make_body: MakeBody, seed: int) -> None:
    body = make_body(
        (("Hall", "Hallway", 12.0), ("Bedroom", "Bedroom", 24.0)),
        furniture=[arrangement("night", ["Beds", "Nightstands"], RoomNames=["Bedroom"])],
    )
    plan, furniture, _ = interior(body, seed)
    bed = of_kind(furniture, "Beds")[0]
    assert gap_behind(bed, plan) < MOST_GAP_M
    stand = of_kind(furniture, "Nightstands")[0]
    assert stand.yaw == bed.yaw
    offset = np.array([stand.x - bed.x, stand.y - bed.y])
    assert abs(offset @ front(bed) + (bed.depth_m - stand.depth_m) / 2) < 0.01
    assert shared_m(stand, bed) > -0.06


MOST_GAP_M = 0.07
"""Furniture keeps the same distance all along a line that is partly an outer wall, 5 cm thicker on this side."""


def gap_behind(item: Furniture, plan: Floorplan) -> float:
    """Distance from a piece's back to the nearest wall behind it."""
    back = np.array([item.x, item.y]) - front(item) * item.depth_m / 2
    gaps: list[float] = []
    for wall in plan.walls:
        x0, y0, x1, y1 = extent(wall_corners(wall))
        gaps.append(float(np.hypot(max(x0 - back[0], back[0] - x1, 0), max(y0 - back[1], back[1] - y1, 0))))
    return min(gaps)


@pytest.mark.parametrize("seed", SEEDS)
def test_dining_chairs_face_their_table(make_body: MakeBody, seed: int) -> None:
    body = make_body((("Dining", "Dining", 24.0), ("Hall", "Hallway", 12.0)))
    _, furniture, _ = interior(body, seed)
    (table,) = of_kind(furniture, "DiningTables")
    chairs = of_kind(furniture, "DiningChairs")
    assert len(chairs) >= 2
    for chair in chairs:
        to_table = np.array([table.x - chair.x, table.y - chair.y])
        assert to_table @ front(chair) > 0.3
        assert shared_m(chair, table) > 0.05


def test_sofas_look_at_the_television_and_have_their_table_before_them(make_body: MakeBody) -> None:
    body = make_body((("Lounge", "Living", 28.0), ("Hall", "Hallway", 12.0)))
    facing = 0
    for seed in range(8):
        _, furniture, _ = interior(body, seed)
        screen, sofa = of_kind(furniture, "MediaStorage")[0], of_kind(furniture, "Sofas")[0]
        to_screen = np.array([screen.x - sofa.x, screen.y - sofa.y])
        facing += bool(to_screen @ front(sofa) > 1.0 and front(sofa) @ front(screen) < -0.9)
    assert facing >= 6


@pytest.mark.parametrize("seed", SEEDS)
def test_kitchens_and_bathrooms_line_their_walls(make_body: MakeBody, seed: int) -> None:
    plan, furniture, _ = interior(make_body(), seed)
    fixtures = {"Fridges", "Ovens", "DishWashers", "Storage", "Toilets", "VanityCounters", "Baths", "Showers"}
    lined = [item for item in furniture if item.model_type in fixtures and item.room in ("Kitchen", "Bath")]
    assert {"Fridges", "Ovens", "Toilets", "VanityCounters"} <= {item.model_type for item in lined}
    for item in lined:
        assert gap_behind(item, plan) < MOST_GAP_M, item.id


def test_rooms_hold_what_their_type_suggests() -> None:
    assert {"Beds", "Nightstands"} <= set(usual_types("Bedroom", "Sparse"))
    assert set(usual_types("Kitchen", "Sparse")) < set(usual_types("Kitchen", "Moderate"))
    assert set(usual_types("Living", "Moderate")) < set(usual_types("Living", "Dense"))


def test_materials_follow_the_template_and_every_listed_one_appears_where_rooms_allow(make_body: MakeBody) -> None:
    body = make_body(
        flooring=[
            {
                "Name": "floors",
                "TargetSet": {"RoomNames": ["Kitchen", "Bath"]},
                "SampleSet": {"MaterialTypes": ["Concrete", "Linoleum"]},
            }
        ],
        walls=[
            {
                "Name": "walls",
                "TargetSet": {"RoomTypes": ["Bedroom"]},
                "SampleSet": {"MaterialTypes": ["Brick", "Stone", "Tiles"]},
            }
        ],
    )
    plan, _, wishes = interior(body, 0)
    rooms: dict[str, Room] = {room.name: room for room in plan.rooms}
    assert {rooms["Kitchen"].floor_material, rooms["Bath"].floor_material} == {"Concrete", "Linoleum"}
    assert rooms["Bedroom"].wall_material in ("Brick", "Stone", "Tiles")
    outcomes = Counter(wish.outcome for wish in wishes if "Walls" in wish.path)
    assert outcomes == {"satisfied": 1, "missed": 2}
    assert {wish.reason for wish in wishes if wish.outcome == "missed"} == {"3 materials for 1 rooms"}


def test_same_generator_state_same_interior(make_body: MakeBody) -> None:
    assert interior(make_body(), 5) == interior(make_body(), 5)
    assert interior(make_body(), 5)[1] != interior(make_body(), 6)[1]


def test_chairs_of_one_table_are_alike(make_body: MakeBody) -> None:
    seen = 0
    for seed in range(6):
        world = generate_world(make_body((("Dining", "Dining", 18.0),)), seed, seed, settle=False)
        styles = [item.style for item in world.furniture if item.model_type == "DiningChairs"]
        seen += len(styles)
        assert len(set(styles)) <= 1
    assert seen > 12


def test_a_large_living_room_has_zones_and_one_screen(make_body: MakeBody) -> None:
    rooms = (("Hall", "Living", 300.0), ("Kitchen", "Kitchen", 20.0))
    for seed in SEEDS:
        plan, furniture, _ = interior(make_body(rooms, furniture=[arrangement("all", None, RoomNames=["Hall"])]), seed)
        found = Counter(item.model_type for item in furniture if item.room == "Hall")
        assert found["MediaStorage"] == found["DiningTables"] == 1
        assert found["Desks"] >= 1
        assert found["Bookcases"] >= 1
        assert found["CoffeeTables"] >= 4
        assert found["Sofas"] >= 4
        (table,) = [item for item in of_kind(furniture, "DiningTables") if item.room == "Hall"]
        xs, ys = zip(*next(room for room in plan.rooms if room.name == "Hall").polygon, strict=True)
        off = max(abs(table.x - np.mean(xs)) / np.ptp(xs), abs(table.y - np.mean(ys)) / np.ptp(ys))
        assert off > 0.25  # one dines in a corner


def test_a_density_is_a_share_of_the_floor_that_rooms_of_each_type_hold(make_body: MakeBody) -> None:
    names = ["Living Room", "Kitchen", "Bedroom", "Bath"]
    for density in ("Moderate", "Dense"):
        wishes = [
            wish
            for seed in range(6)
            for wish in interior(
                make_body(furniture=[arrangement(n, None, density, RoomNames=[n]) for n in names]), seed
            )[2]
            if wish.path.endswith("DesiredSpatialDensity")
        ]
        assert len(wishes) == 24
        assert sum(wish.outcome == "satisfied" for wish in wishes) >= 19, [wish.reason for wish in wishes]


def test_a_density_that_is_not_asked_for_is_not_told(make_body: MakeBody) -> None:
    _, _, wishes = interior(make_body(furniture=[{"Name": "all", "TargetSet": {"RoomNames": ["Kitchen"]}}]), 0)
    assert not [wish for wish in wishes if wish.path.endswith("DesiredSpatialDensity")]


def test_loose_objects_are_as_many_as_a_template_asks_for(make_body: MakeBody) -> None:
    asked = arrangement("all", None, "Dense", RoomNames=["Living Room"]) | {"LooseObjects": 14}
    none = arrangement("none", None, RoomNames=["Kitchen"]) | {"LooseObjects": 0}
    world = generate_world(make_body(furniture=[asked, none]), 1, 2)
    loose = Counter(item.room for item in world.furniture if item.movable)
    assert (loose["Living Room"], loose["Kitchen"]) == (14, 0)
    assert world.checks
    assert (world.checks.settled_share, world.checks.penetrations) == (1.0, 0)
    assert {wish.outcome for wish in world.wishes if wish.path.endswith("LooseObjects")} == {"satisfied"}
    on_tops = [item for item in world.furniture if item.movable and item.base_m > 0]
    for one, other in combinations(on_tops, 2):
        assert np.hypot(one.x - other.x, one.y - other.y) >= min(one.width_m, other.width_m), (one.id, other.id)


def test_kitchens_and_baths_get_loose_objects_and_a_room_that_is_short_of_them_says_so(make_body: MakeBody) -> None:
    asked = [
        arrangement(name, None, RoomNames=[name]) | {"LooseObjects": count}
        for name, count in (("Kitchen", 5), ("Bath", 40))
    ]
    for seed in SEEDS:
        _, furniture, wishes = interior(make_body(furniture=asked), seed)
        loose = Counter(item.room for item in furniture if item.movable)
        counters = [item for item in furniture if item.movable and item.room == "Kitchen" and item.base_m > 0.8]
        assert loose["Kitchen"] == 5
        assert counters
        # As many as the floor allows, which is most of them.
        assert 20 <= loose["Bath"] <= 40
        told = {wish.wish: (wish.outcome, wish.reason) for wish in wishes if wish.path.endswith("LooseObjects")}
        assert told["5 loose objects in each room of Kitchen"] == ("satisfied", "")
        short = f"Bath has place for {loose['Bath']}, on tops and on the floor"
        full = loose["Bath"] == 40
        assert told["40 loose objects in each room of Bath"] == (("satisfied", "") if full else ("missed", short))
