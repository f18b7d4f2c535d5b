"""Doors: hung where nothing is in their way, open as wished, and the account of the wishes about them."""

from math import cos, hypot, pi, sin
from typing import Any

import mujoco
import numpy as np
import pytest
from helpers.examples import examples
from hypothesis import Phase, given
from hypothesis import strategies as st

from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.schemas.worlds.world import INDOOR_ROOM_TYPES, Door, Floorplan, World
from prefect_robomaker.tasks.worldforge.doors.door_parts import leaf_corners, swept_box
from prefect_robomaker.tasks.worldforge.doors.doors import hang_doors
from prefect_robomaker.tasks.worldforge.doors.styles_and_openings import dress_doors
from prefect_robomaker.tasks.worldforge.floorplans.floorplan import generate_floorplan
from prefect_robomaker.tasks.worldforge.generator import generate_world
from prefect_robomaker.tasks.worldforge.model.mjcf import world_mjcf
from prefect_robomaker.tasks.worldforge.pictures.plan_svg import floorplan_svg
from prefect_robomaker.tasks.worldforge.proofs.guarantees import violations

UNSHRUNK = (Phase.explicit, Phase.reuse, Phase.generate)
"""A world takes a tenth of a second: finding a smaller example of a failure would take minutes."""

SETS = "Buildings[0].Floors[0].Interior.Doorways.DoorwaySets"
FLAT = (("Living", "Living", 26.0), ("Kitchen", "Kitchen", 14.0), ("Bed", "Bedroom", 16.0), ("Bath", "Bathroom", 10.0))


def template(
    rooms: tuple[tuple[str, str, float], ...] = FLAT,
    sets: tuple[dict[str, Any], ...] = (),
    ways: tuple[tuple[str, str, str], ...] = (),
    version: str = "2",
) -> WorldTemplateBody:
    floor = {
        "Floorplan": {
            "Rooms": [
                {"Name": name, "Type": kind, "DesiredShape": {"Area": area, "AspectRatio": {"x": 4.0, "y": 3.0}}}
                for name, kind, area in rooms
            ],
            "DesiredConnections": [{"Location": [one, other], "ConnectionType": kind} for one, other, kind in ways],
        },
        "Interior": {"Doorways": {"DoorwaySets": list(sets)}} if version == "2" else {},
    }
    return WorldTemplateBody.model_validate({"Version": version, "Buildings": [{"Floors": [floor]}]})


def doorway_set(name: str, target: Any, percent: Any) -> dict[str, Any]:
    return {"Name": name, "TargetSet": target, "Door": {"InitialState": {"OpenPosition": {"Percent": percent}}}}


def between(one: list[str], other: list[str]) -> dict[str, Any]:
    ends = [{"RoomTypes" if set(end) <= set(INDOOR_ROOM_TYPES) else "RoomNames": end} for end in (one, other)]
    return {"From": ends[0], "To": ends[1]}


def doors(plan: Floorplan) -> list[Door]:
    return [passage.door for passage in plan.passages if passage.door]


@st.composite
def bodies(draw: st.DrawFn) -> WorldTemplateBody:
    areas = st.sampled_from([10.0, 12.0, 20.0, 45.0])
    kinds = draw(st.lists(st.tuples(st.sampled_from(INDOOR_ROOM_TYPES), areas), min_size=2, max_size=6))
    rooms = tuple((f"room {number}", kind, area) for number, (kind, area) in enumerate(kinds))
    pairs = st.tuples(st.integers(0, len(rooms) - 1), st.integers(0, len(rooms) - 1)).filter(lambda p: p[0] < p[1])
    asked = draw(st.lists(pairs, max_size=4, unique=True))
    percents = st.one_of(st.just("Random"), st.sampled_from([0, 100]), st.floats(0, 100))
    sets = [doorway_set("all", "Target.All", draw(percents))]
    sets += [doorway_set(f"{a}-{b}", between([f"room {a}"], [f"room {b}"]), draw(percents)) for a, b in asked]
    return template(rooms, tuple(sets), tuple((f"room {a}", f"room {b}", "Doorway") for a, b in asked))


@examples(12, phases=UNSHRUNK)
@given(body=bodies(), seed=st.integers(0, 2**32 - 1))
def test_doors_swing_free_open_as_wished_and_every_room_is_reached(body: WorldTemplateBody, seed: int) -> None:
    world = generate_world(body, seed, seed + 1, settle=False)
    assert world.checks is not None
    assert violations(world.checks) == []
    assert world.checks.max_penetration_m == 0.0 or doors_apart_from_loose_objects(world)
    model = mujoco.MjModel.from_xml_string(world_mjcf(world))
    for door in doors(world.floorplan):
        assert model.qpos0[model.joint(door.id).qposadr[0]] == pytest.approx(door.open_angle_rad, abs=1e-4)
    honoured(body, world)
    nothing_touches_a_door(model, world)
    everything_near_a_door_is_clear(world)


def doors_apart_from_loose_objects(world: World) -> bool:
    return all(item.movable or item.base_m == 0.0 for item in world.furniture)


def honoured(body: WorldTemplateBody, world: World) -> None:
    """Every pair follows its own set, if there is one, else the set for all."""
    assert body.interior.Doorways is not None
    wished = {one.Name: one.Door.InitialState.OpenPosition.Percent for one in body.interior.Doorways.DoorwaySets}
    for passage in world.floorplan.passages:
        if passage.door is None:
            continue
        low, high = sorted(int(name.removeprefix("room ")) for name in passage.rooms)
        percent = wished.get(f"{low}-{high}", wished["all"])
        assert percent == "Random" or passage.door.open_percent == percent
        assert passage.door.clear_width_m >= 0.8
    reasons = {wish.path: wish for wish in world.wishes if wish.path.startswith(SETS)}
    assert list(reasons) == [f"{SETS}[{number}]" for number in range(len(wished))]
    assert all((wish.reason == "") == (wish.outcome == "satisfied") for wish in reasons.values())


def nothing_touches_a_door(model: mujoco.MjModel, world: World) -> None:
    """In MuJoCo's own eyes, at nine openings of all doors at once, and of each with the others fully open."""
    data = mujoco.MjData(model)
    hung = doors(world.floorplan)
    bodies_of_doors = {model.body(door.id).id for door in hung}
    for moving in [None, *hung]:
        for step in range(9):
            for door in hung:
                share = step / 8 if moving in (None, door) else 1.0
                data.qpos[model.joint(door.id).qposadr[0]] = share * door.max_angle_rad
            mujoco.mj_forward(model, data)
            touching = {(model.geom(contact.geom1).name, model.geom(contact.geom2).name) for contact in data.contact}
            bodies_met = {int(body) for contact in data.contact for body in model.geom_bodyid[contact.geom]}
            assert not bodies_met & bodies_of_doors, touching


def everything_near_a_door_is_clear(world: World) -> None:
    """No furniture, loose object or goal where a leaf passes, measured without the generator's own geometry."""
    for door in doors(world.floorplan):
        spots = [
            (door.hinge[0] + reach * cos(door.yaw_at(angle)), door.hinge[1] + reach * sin(door.yaw_at(angle)))
            for reach in np.linspace(0.02, door.leaf_width_m, 12)
            for angle in np.linspace(0, door.max_angle_rad, 16)
        ]
        for item in world.furniture:
            if item.base_m > door.leaf_height_m:
                continue
            for x, y in spots:
                dx, dy = x - item.x, y - item.y
                along = abs(dx * cos(item.yaw) + dy * sin(item.yaw))
                across = abs(dy * cos(item.yaw) - dx * sin(item.yaw))
                inside = along < item.depth_m / 2 - 1e-3 and across < item.width_m / 2 - 1e-3
                assert not inside, f"{item.id} stands where {door.id} swings"


@examples(15, phases=UNSHRUNK)
@given(body=bodies(), seed=st.integers(0, 2**32 - 1))
def test_nearly_every_doorway_gets_a_door_that_closes_it(body: WorldTemplateBody, seed: int) -> None:
    plan = generate_floorplan(body, seed)
    hung, reasons = hang_doors(plan)
    assert hung == plan, "hanging doors again changes nothing"
    for index, passage in enumerate(plan.passages):
        door = passage.door
        if passage.kind == "Opening":
            assert door is None
            continue
        if door is None:
            assert reasons[index]
            continue
        assert door.room in passage.rooms
        (x0, y0), (x1, y1) = passage.start, passage.end
        closed = leaf_corners(door, 0.0)
        along = 0 if abs(x1 - x0) > abs(y1 - y0) else 1
        low, high = sorted((passage.start[along], passage.end[along]))
        assert min(corner[along] for corner in closed) == pytest.approx(low + 0.005, abs=1e-5)
        assert max(corner[along] for corner in closed) == pytest.approx(high - 0.005, abs=1e-5)
        # Open, it stands in the room it says, as far in as it is wide.
        tip = leaf_corners(door, door.max_angle_rad)
        line = passage.start[1 - along]
        assert max(abs(corner[1 - along] - line) for corner in tip) == pytest.approx(0.05 + door.leaf_width_m, abs=1e-5)


def test_the_origin_stays_clear_of_every_swing() -> None:
    for seed in range(40):
        plan = generate_floorplan(template(), seed)
        for door in doors(plan):
            for angle in np.linspace(0, door.max_angle_rad, 30):
                assert all(hypot(*corner) >= 0.55 for corner in leaf_corners(door, float(angle)))


def test_doors_rather_open_into_small_rooms_than_into_hallways_and_closets() -> None:
    rooms = (("Hall", "Hallway", 12.0), *FLAT, ("Closet", "Closet", 10.0))
    plans = [generate_floorplan(template(rooms), seed) for seed in range(30)]
    types = {name: kind for name, kind, _ in rooms}
    at_closets = [
        types[passage.door.room]
        for plan in plans
        for passage in plan.passages
        if passage.door and "Closet" in passage.rooms and "Hall" not in passage.rooms
    ]
    at_hallways = [
        types[passage.door.room]
        for plan in plans
        for passage in plan.passages
        if passage.door and "Hall" in passage.rooms
    ]
    assert min(len(at_hallways), len(at_closets)) >= 10
    # The clear space at the origin and other doors leave some no choice.
    assert at_hallways.count("Hallway") <= 0.2 * len(at_hallways)
    assert at_closets.count("Closet") <= len(at_closets) / 3


def test_worlds_of_version_1_have_no_doors() -> None:
    world = generate_world(template(version="1"), 3, 4, settle=False)
    assert world.template_version == "1"
    assert any(passage.kind == "Doorway" for passage in world.floorplan.passages)
    assert doors(world.floorplan) == []
    assert "hinge" not in world_mjcf(world)


def test_upgrading_a_template_leaves_walls_and_furniture_nearly_as_they_were() -> None:
    first, second = (generate_floorplan(template(version=version), 5) for version in "12")
    assert first.walls == second.walls
    assert first.windows == second.windows
    assert [passage.model_copy(update={"door": None}) for passage in second.passages] == first.passages


def plan_with(ways: tuple[tuple[str, str, str], ...], seed: int = 3) -> tuple[WorldTemplateBody, Floorplan]:
    body = template(ways=ways)
    return body, generate_floorplan(body, seed)


WAYS = (("Bed", "Living", "Doorway"), ("Bath", "Living", "Doorway"), ("Kitchen", "Living", "Opening"))


def dressed(*sets: dict[str, Any], seed: int = 1) -> tuple[dict[frozenset[str], float], list[tuple[str, str]]]:
    """Opening of each door by its rooms, and outcome and reason of each set."""
    _, plan = plan_with(WAYS)
    kinds = {frozenset(passage.rooms): passage.kind for passage in plan.passages}
    assert kinds == {frozenset((one, other)): kind for one, other, kind in WAYS}
    hung, wishes = dress_doors(template(sets=sets, ways=WAYS), plan, np.random.default_rng(seed))
    openings = {frozenset(passage.rooms): passage.door.open_percent for passage in hung.passages if passage.door}
    return openings, [(wish.outcome, wish.reason) for wish in wishes]


BED, BATH = frozenset(("Bed", "Living")), frozenset(("Bath", "Living"))


def test_names_beat_types_and_types_beat_all() -> None:
    openings, outcomes = dressed(
        doorway_set("every", "Target.All", 10),
        doorway_set("types", between(["Bedroom", "Bathroom"], ["Living", "Hallway"]), 20),
        doorway_set("mixed", between(["Living", "Kitchen"], ["Bed"]), 30),
        doorway_set("named", between(["Bed"], ["Living"]), 40),
        doorway_set("later", between(["Living"], ["Bed"]), 50),
    )
    # "Living" and "Kitchen" are names as well as types; alone they are read as types by this test's helper.
    assert openings == {BED: 30.0, BATH: 20.0}
    assert outcomes[0] == ("contradictory", "its doorways follow mixed, types")
    assert outcomes[1] == outcomes[2] == ("satisfied", "")
    assert outcomes[3] == outcomes[4] == ("contradictory", "its doorways follow mixed")


def test_two_names_beat_one() -> None:
    named = {"From": {"RoomNames": ["Living"]}, "To": {"RoomNames": ["Bed"]}}
    openings, outcomes = dressed(
        doorway_set("mixed", between(["Living"], ["Bed", "Bath"]), 30), doorway_set("named", named, 40)
    )
    assert openings == {BED: 40.0, BATH: 30.0}
    assert [outcome for outcome, _ in outcomes] == ["satisfied", "satisfied"]


def test_doorways_that_no_set_names_are_fully_open() -> None:
    openings, _ = dressed(doorway_set("bed", between(["Bedroom"], ["Living"]), 0))
    assert openings == {BED: 0.0, BATH: 100.0}
    assert dressed()[0] == {BED: 100.0, BATH: 100.0}


def test_random_openings_differ_between_doors_and_seeds_but_not_between_runs() -> None:
    every = doorway_set("every", "Target.All", "Random")
    drawn = [tuple(dressed(every, seed=seed)[0].values()) for seed in range(30)]
    assert drawn == [tuple(dressed(every, seed=seed)[0].values()) for seed in range(30)]
    assert len(set(drawn)) > 20
    assert any(one != other for one, other in drawn)
    assert min(min(pair) for pair in drawn) < 20 < 80 < max(max(pair) for pair in drawn)


@pytest.mark.parametrize(
    ("target", "reason"),
    [
        (between(["Bedroom"], ["Bathroom"]), "no doorway joins Bedroom with Bathroom"),
        (between(["Closet"], ["Living"]), "no doorway joins Closet with Living"),
        (between(["Bed"], ["Bath"]), "Bed and Bath are not joined by a doorway"),
        (
            {"From": {"RoomNames": ["Living"]}, "To": {"RoomNames": ["Kitchen", "Bath", "Living"]}},
            "Living and Kitchen are joined by an opening, which has no door",
        ),
    ],
)
def test_a_wish_for_doors_where_there_are_none_is_missed_with_the_reason(target: Any, reason: str) -> None:
    _, outcomes = dressed(doorway_set("wish", target, 50))
    assert outcomes == [("missed", reason)]


def test_a_single_room_has_no_doorway_for_a_set_for_all() -> None:
    body = template((("Living", "Living", 20.0),), (doorway_set("every", "Target.All", 50),))
    plan, wishes = dress_doors(body, generate_floorplan(body, 1), np.random.default_rng(1))
    assert doors(plan) == []
    assert [(wish.path, wish.wish, wish.outcome, wish.reason) for wish in wishes] == [
        (f"{SETS}[0]", "doors of every open 50 %", "missed", "the plan has no doorway")
    ]


def test_rooms_behind_closed_doors_are_told() -> None:
    everything = generate_world(template(sets=(doorway_set("every", "Target.All", 100),)), 3, 4, settle=False)
    closed = generate_world(template(sets=(doorway_set("every", "Target.All", 0),)), 3, 4, settle=False)
    assert everything.checks is not None
    assert closed.checks is not None
    assert everything.checks.closed_off_rooms == []
    assert closed.checks.closed_off_rooms
    assert closed.checks.reachable_cells == everything.checks.reachable_cells


@pytest.fixture(scope="module")
def ajar() -> World:
    """A flat whose doors are 30 % open."""
    return generate_world(template(sets=(doorway_set("every", "Target.All", 30),)), 3, 4)


def test_a_door_stays_where_it_is_until_it_is_pushed_and_then_again(ajar: World) -> None:
    model = mujoco.MjModel.from_xml_string(world_mjcf(ajar))
    data = mujoco.MjData(model)
    door = doors(ajar.floorplan)[0]
    joint = model.joint(door.id)
    at, freedom = int(joint.qposadr[0]), int(joint.dofadr[0])
    assert 15 <= float(model.body(door.id).mass[0]) <= 25
    mujoco.mj_step(model, data, nstep=1000)
    assert data.qpos[at] == model.qpos0[at]
    # 7 N at 0.4 m from the hinge: two wheels of a robot of a few kilograms.
    data.qfrc_applied[freedom] = 7 * 0.4
    mujoco.mj_step(model, data, nstep=1500)
    assert data.qpos[at] > model.qpos0[at] + 0.5
    assert data.qpos[at] <= door.max_angle_rad + 0.01
    data.qfrc_applied[freedom] = 0
    mujoco.mj_step(model, data, nstep=1000)
    rest = float(data.qpos[at])
    mujoco.mj_step(model, data, nstep=5000)
    assert data.qpos[at] == pytest.approx(rest, abs=1e-4)


def test_the_plan_draws_each_leaf_as_it_stands_and_its_swing(ajar: World) -> None:
    svg = floorplan_svg(ajar)
    for door in doors(ajar.floorplan):
        assert f"<title>{door.id}: 30 % open</title>" in svg
    assert svg.count('class="fp-swing"') == svg.count('class="fp-door"') == len(doors(ajar.floorplan)) > 0


def test_a_leaf_and_its_sweep_are_where_the_hinge_says() -> None:
    door = Door(
        id="door-1", hinge=(1.0, 2.0), closed_yaw=0.0, swing=1, room="A", leaf_width_m=0.9, leaf_height_m=2.0,
        thickness_m=0.04, max_angle_rad=pi / 2, open_percent=50.0, clear_width_m=0.85,
    )  # fmt: skip
    assert door.open_angle_rad == pytest.approx(pi / 4)
    assert np.allclose(sorted(leaf_corners(door, 0.0)), [(1.0, 1.96), (1.0, 2.0), (1.9, 1.96), (1.9, 2.0)])
    assert np.allclose(sorted(leaf_corners(door, pi / 2)), [(1.0, 2.0), (1.0, 2.9), (1.04, 2.0), (1.04, 2.9)])
    assert np.allclose(swept_box(door), (0.94, 2.0, 1.9, 2.9))
    other = door.model_copy(update={"swing": -1})
    assert np.allclose(swept_box(other), (0.94, 1.1, 1.9, 2.0))
    assert np.allclose(sorted(leaf_corners(other, pi / 2)), [(1.0, 1.1), (1.0, 2.0), (1.04, 1.1), (1.04, 2.0)])
