"""Worlds with balconies: they lie outside, have a railing and a glazed door, and change nothing else."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import json
from pathlib import Path
from typing import Any

import mujoco
import pytest
from helpers.extended_templates import not_entered
from helpers.random_templates import random_template
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.schemas.templates.parsing import parse_template_body
from prefect_robomaker.schemas.wire.errors import InvalidParameterException
from prefect_robomaker.schemas.worlds.world import Fault, World, contains
from prefect_robomaker.tasks.worldforge.balconies.balconies import whole_floorplan, without_balconies
from prefect_robomaker.tasks.worldforge.balconies.sites import fitting_size
from prefect_robomaker.tasks.worldforge.bundle.bundle import read_world, write_bundle
from prefect_robomaker.tasks.worldforge.bundle.proving import prove
from prefect_robomaker.tasks.worldforge.exports.export_scene import read_scene
from prefect_robomaker.tasks.worldforge.floorplans.floorplan import generate_floorplan
from prefect_robomaker.tasks.worldforge.generator import generate_world, seeds_for
from prefect_robomaker.tasks.worldforge.geometry.occupancy import occupancy_grid, room_cells
from prefect_robomaker.tasks.worldforge.model.mjcf import world_mjcf
from prefect_robomaker.tasks.worldforge.proofs.guarantees import violations

ROOMS = (
    ("Balcony", "Balcony", 6.0, 2.5),
    ("Living", "Living", 22.0, 1.3),
    ("Bed", "Bedroom", 13.0, 1.2),
    ("Loggia", "Balcony", 3.0, 1.5),
    ("Bath", "Bathroom", 5.0, 1.2),
)
WAYS = (("Living", "Bed"), ("Balcony", "Living"), ("Living", "Bath"), ("Bed", "Loggia"))
OUTSIDE = ("Balcony", "Loggia")


def document(
    rooms: tuple[tuple[str, str, float, float], ...] = ROOMS, ways: tuple[Any, ...] = WAYS, kind: str = "Doorway"
) -> str:
    wished = [
        {"Name": name, "Type": of, "DesiredShape": {"Area": area, "AspectRatio": {"x": ratio, "y": 1}}}
        for name, of, area, ratio in rooms
    ]
    floor = {
        "Floorplan": {"Rooms": wished, "DesiredConnections": [{"Location": w, "ConnectionType": kind} for w in ways]}
    }
    return json.dumps({"Version": "2", "Buildings": [{"Floors": [floor]}]})


BODY = parse_template_body(document())


@pytest.fixture(scope="module")
def flat() -> World:
    return generate_world(BODY, *seeds_for(7, 1, 0), settle=False)


@pytest.fixture(scope="module")
def bundle(flat: World, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("balcony") / "flat"
    write_bundle(flat, folder)
    return folder


def check(world: World) -> None:
    assert world.checks is not None
    assert violations(world.checks) == []
    assert not_entered(world) == []


def test_balconies_lie_outside_behind_a_glazed_door_that_opens_into_the_room(flat: World) -> None:
    check(flat)
    plan = flat.floorplan
    assert [room.name for room in plan.rooms] == [name for name, *_ in ROOMS]
    ways = {way.rooms: way.door for way in plan.passages if {*way.rooms} & {*OUTSIDE}}
    assert [*ways] == [("Balcony", "Living"), ("Bed", "Loggia")]
    assert all(door and door.style.startswith("glazed ") for door in ways.values())
    assert [door.room for door in ways.values() if door] == ["Living", "Bed"]
    inside = [room for room in plan.rooms if room.name not in OUTSIDE]
    for room in plan.rooms:
        if room.is_outdoor:
            assert not any(contains(other.polygon, *room.goal) for other in inside)
            assert room.floor_m2 == pytest.approx(room.desired_area_m2, rel=0.05)
    assert all(contains(plan.footprint, *room.goal) for room in plan.rooms)


def test_a_railing_of_a_metre_collides_and_no_ceiling_hides_a_balcony(flat: World) -> None:
    model = mujoco.MjModel.from_xml_string(world_mjcf(flat))
    railings = [number for number, wall in enumerate(flat.floorplan.walls) if wall.rooms in (["Balcony"], ["Loggia"])]
    assert len(railings) == 6
    for number in railings:
        names = [f"wall_{number}", f"wall_{number}_left", f"wall_{number}_right"]
        parts = [geom for geom in range(model.ngeom) if model.geom(geom).name in names]
        assert parts
        assert {round(float(model.geom_pos[geom][2] + model.geom_size[geom][1]), 6) for geom in parts} == {1.0}
        assert all(model.geom_contype[geom] for geom in parts)
    ceilings = {
        model.geom(geom).name.split("_")[1] for geom in range(model.ngeom) if "ceiling_" in model.geom(geom).name
    }
    assert ceilings == {str(number) for number, room in enumerate(flat.floorplan.rooms) if not room.is_outdoor}


def test_a_robot_sees_the_railing_on_its_map(flat: World) -> None:
    """The map knows each cell of a balcony, and no free cell has an unknown one beside it."""
    grid = occupancy_grid(flat.floorplan)
    for room in flat.floorplan.rooms:
        if room.is_outdoor:
            inside = room_cells(grid, room)
            assert grid.known[inside].all()
            doorway_m2 = 0.9 * 0.1  # the outer half of the wall is the balcony's
            free_m2 = (grid.free & inside).sum() * grid.resolution_m**2
            assert free_m2 == pytest.approx(room.floor_m2 + doorway_m2, abs=1e-6)
    free, unknown = grid.free, ~grid.known
    assert not (free[1:] & unknown[:-1]).any()
    assert not (free[:, 1:] & unknown[:, :-1]).any()
    assert not (free[:-1] & unknown[1:]).any()
    assert not (free[:, :-1] & unknown[:, 1:]).any()


def test_two_chairs_face_each_other_across_a_table(flat: World) -> None:
    for name in OUTSIDE:
        pieces = [item for item in flat.furniture if item.room == name]
        (table,) = (item for item in pieces if item.model_type == "EndAndSideTables")
        one, other = (item for item in pieces if item.model_type == "DiningChairs")
        assert (one.x + other.x, one.y + other.y) == pytest.approx((2 * table.x, 2 * table.y), abs=0.01)
        assert abs(one.yaw - other.yaw) == pytest.approx(3.14159, abs=0.01)


def test_the_building_is_the_one_that_the_template_without_balconies_has() -> None:
    inside = without_balconies(BODY)
    assert [room.Name for room in inside.floorplan.Rooms] == ["Living", "Bed", "Bath"]
    assert without_balconies(inside) is inside
    for number in range(3):
        seed = seeds_for(7, number, 0)[0]
        plan, less = whole_floorplan(BODY, seed), generate_floorplan(inside, seed)
        assert [room for room in plan.rooms if not room.is_outdoor] == less.rooms
        assert whole_floorplan(inside, seed) == less
        assert whole_floorplan(BODY, seed) == plan


def test_wishes_have_the_paths_and_the_order_of_the_template(flat: World) -> None:
    paths = [wish.path.partition("Floorplan.")[2] for wish in flat.floorplan.wishes]
    shapes = [f"Rooms[{number}].DesiredShape.{of}" for number in range(5) for of in ("Area", "AspectRatio")]
    ways = [f"DesiredConnections[{number}]" for number in range(4)]
    assert paths == ["Footprint.DesiredAspectRatio", "Ceiling.Height", *shapes, *ways]
    told = {wish.path.partition("Floorplan.")[2]: wish.wish for wish in flat.floorplan.wishes}
    assert told["Rooms[3].DesiredShape.Area"].startswith("Loggia of 3 m2")
    assert told["Rooms[4].DesiredShape.Area"].startswith("Bath of 5 m2")
    assert told["DesiredConnections[3]"] == "Doorway between Bed and Loggia"


def test_a_balcony_misses_no_default() -> None:
    """A square balcony is too deep for any; its area is another one's default."""
    whole = json.loads(
        document((("Balcony", "Balcony", 8.0, 1), *ROOMS[1:3], ("Loggia", "Balcony", 20.0, 1), ROOMS[4]))
    )
    unstated = json.loads(json.dumps(whole))
    rooms = unstated["Buildings"][0]["Floors"][0]["Floorplan"]["Rooms"]
    rooms[0]["DesiredShape"]["AspectRatio"] = {}
    del rooms[3]["DesiredShape"]
    missed = [
        {wish.path.partition("Floorplan.")[2] for wish in plan.wishes if wish.outcome == "missed"}
        for plan in (whole_floorplan(parse_template_body(json.dumps(each)), 1) for each in (whole, unstated))
    ]
    assert missed[0] - missed[1] == {
        "Rooms[0].DesiredShape.AspectRatio", "Rooms[3].DesiredShape.Area", "Rooms[3].DesiredShape.AspectRatio",
    }  # fmt: skip
    assert missed[1] <= missed[0]


def test_only_railings_have_a_height_in_the_world_file(flat: World) -> None:
    tops = [wall.get("top_m", "none") for wall in json.loads(flat.to_text())["floorplan"]["walls"]]
    assert tops.count(1.0) == 6
    assert tops.count("none") == len(tops) - 6
    assert World.model_validate_json(flat.to_text()) == flat


def test_exports_have_the_balcony(bundle: Path) -> None:
    building = read_scene(bundle).things[0]
    low = [shape for shape in building.shapes if shape.name.startswith("wall_") and shape.collides]
    tops = {round(float(shape.position[2] + max(shape.rotation[2] @ shape.half, shape.half[1])), 3) for shape in low}
    assert 1.0 in tops
    assert sum(shape.ceiling for shape in building.shapes) == 3


@pytest.mark.parametrize(
    ("of", "change", "said"),
    [
        ("size", lambda size: [size[0], size[1] / 2, size[2]], "is not as world.json has it"),
        ("pos", lambda pos: [pos[0] + 0.2, *pos[1:]], "is not as world.json has it"),
    ],
)
def test_a_spoiled_railing_is_noticed(bundle: Path, tmp_path: Path, of: str, change: Any, said: str) -> None:
    world = read_world(bundle)
    number = next(number for number, wall in enumerate(world.floorplan.walls) if wall.top_m is not None)
    assert faults(world, bundle) == []
    spoiled = tmp_path / "flat"
    write_bundle(world, spoiled)
    lines = (spoiled / "world.xml").read_text().splitlines()
    at = next(index for index, line in enumerate(lines) if f'name="wall_{number}' in line and "_seen" not in line)
    before = lines[at].partition(f'{of}="')[2].partition('"')[0]
    after = " ".join(f"{value:g}" for value in change([float(word) for word in before.split()]))
    lines[at] = lines[at].replace(f'{of}="{before}"', f'{of}="{after}"')
    (spoiled / "world.xml").write_text("\n".join(lines))
    first = next(fault.said for fault in faults(world, spoiled) if fault.guarantee == "parts")
    assert first.startswith(f"the wall wall_{number} {said}")


def faults(world: World, folder: Path) -> list[Fault]:
    found = prove(world, folder).faults
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (document(ROOMS[:1], ()), "Rooms: only of type Balcony; a room inside besides would be right"),
        (
            document((*ROOMS, ("Terrace", "Balcony", 5.0, 2.0)), ()),
            "Rooms: 3 of type Balcony; 2 at most would be right",
        ),
        (document(ways=(("Balcony", "Loggia"),)), r"DesiredConnections\[0\].Location: .*: two balconies; one room"),
        (document(ways=WAYS[1:2], kind="Opening"), '"Opening": "Doorway" would be right for a Balcony'),
        (
            document(ways=(*WAYS, ("Bed", "Balcony"))),
            r"DesiredConnections\[4\].Location: .*has one door; leave one out",
        ),
        (
            document((("It", "Balcony", 2.0, 1.0), ROOMS[1]), ()).replace("2.0,", "1.5,"),
            "1.5: 2 or more would be right",
        ),
    ],
)
def test_what_no_balcony_can_have_is_refused(text: str, said: str) -> None:
    with pytest.raises(InvalidParameterException, match=said):
        parse_template_body(text)


@given(longest=st.integers(0, 200), area_m2=st.floats(2, 300), ratio=st.floats(1, 4))
def test_a_floor_fits_its_wall_and_is_as_deep_as_a_balcony(longest: int, area_m2: float, ratio: float) -> None:
    size = fitting_size(longest, area_m2 * 400, ratio)
    assert (size is None) == (longest < 30)
    if size is not None:
        assert 30 <= size.long <= longest
        assert 1.2 <= size.deep / 20 <= 2.5


@pytest.mark.parametrize(
    "templates", [pytest.param(5, marks=pytest.mark.deep), pytest.param(20, marks=pytest.mark.endurance)]
)
def test_a_robot_enters_all_rooms_of_random_templates_with_balconies(templates: int) -> None:
    for number in range(templates):
        body: WorldTemplateBody = random_template(number, balconies=True)
        world = generate_world(body, *seeds_for(number, 0, 0))
        check(world)
        assert sum(room.is_outdoor for room in world.floorplan.rooms) in (1, 2)
