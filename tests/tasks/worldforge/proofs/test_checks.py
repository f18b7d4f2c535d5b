"""Checks find what is wrong with a world, and nothing in a good one."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

from dataclasses import replace
from typing import Any

import mujoco
import pytest

from prefect_robomaker.schemas.worlds.world import Furniture, Room, World, WorldChecks
from prefect_robomaker.tasks.worldforge.furniture.catalogue import styles_of
from prefect_robomaker.tasks.worldforge.model.mjcf import proof_mjcf, world_mjcf
from prefect_robomaker.tasks.worldforge.proofs.checks import Site, check_world, planned_site
from prefect_robomaker.tasks.worldforge.proofs.guarantees import SETTLE_S, proof_lines, violations


def checked(world: World, settle_s: float | None = SETTLE_S) -> WorldChecks:
    return check_world(world, site_of(world, proof_mjcf(world)), settle_s=settle_s)


def site_of(world: World, mjcf: str) -> Site:
    return planned_site(world, mujoco.MjModel.from_xml_string(mjcf))


def with_piece(world: World, kind: str, x: float, y: float, **more: Any) -> World:
    style = styles_of(kind)[0]
    size = {"width_m": style.width_m, "depth_m": style.depth_m, "height_m": style.height_m}
    piece = Furniture(id=f"{kind}_99", model_type=kind, style=style.name, room="", x=x, y=y, yaw=0.0, **size, **more)
    return world.model_copy(update={"furniture": [*world.furniture, piece]})


def test_a_generated_world_breaks_nothing(flat: World) -> None:
    checks = checked(flat)
    assert violations(checks) == []
    assert checks == flat.checks
    assert checks.reachable_share > 0.9
    assert checks.settled_share == 1.0


def test_a_piece_at_the_origin_is_found(flat: World) -> None:
    assert "the cylinder of 1 m diameter at the origin is not clear" in violations(
        checked(with_piece(flat, "FloorLamps", 0.4, 0.3))
    )


def test_a_blocked_doorway_is_found(flat: World) -> None:
    bath = next(room for room in flat.floorplan.rooms if room.name == "Bath")
    world = flat
    for number, door in enumerate(p for p in flat.floorplan.passages if "Bath" in p.rooms):
        x, y = (door.start[0] + door.end[0]) / 2, (door.start[1] + door.end[1]) / 2
        world = with_piece(world, "CornerCabinets", x, y)
        world.furniture[-1] = world.furniture[-1].model_copy(update={"id": f"block_{number}"})
    found = violations(checked(world))
    assert "Bath: a robot of 0.2 m radius reaches 0 cells, not 5" in found
    assert "Bath: its goal is out of a robot's reach" in found
    assert checked(world).reachable_cells[bath.name] == 0


def test_a_goal_inside_furniture_is_found(flat: World) -> None:
    piece = next(item for item in flat.furniture if item.model_type == "Beds")
    rooms: list[Room] = [
        room.model_copy(update={"goal": (piece.x, piece.y)}) if room.name == piece.room else room
        for room in flat.floorplan.rooms
    ]
    world = flat.model_copy(update={"floorplan": flat.floorplan.model_copy(update={"rooms": rooms})})
    assert violations(checked(world)) == [f"{piece.room}: its goal is out of a robot's reach"]


def test_a_floating_object_is_found_although_it_sleeps(flat: World) -> None:
    world = with_piece(flat, "Carton", 0.0, 0.0, base_m=1.0, movable=True)
    checks = checked(world)
    assert checks.settled_share is not None
    assert checks.settled_share < 1
    assert any("free bodies stay within 0.01 m" in problem for problem in violations(checks))
    assert checked(world, settle_s=None).settled_share is None


def test_bodies_that_overlap_are_found(flat: World) -> None:
    world = with_piece(flat, "Carton", 0.0, 0.0, base_m=-0.02, movable=True)
    assert checked(world).max_penetration_m == pytest.approx(0.02, abs=0.002)
    assert any("parts overlap by 0.02" in problem for problem in violations(checked(world)))


def test_a_passage_narrower_than_the_robot_is_found(flat: World) -> None:
    checks = flat.checks
    assert checks is not None
    assert checks.narrowest_passage_m == min(passage.width_m for passage in flat.floorplan.passages)
    narrow = checks.model_copy(update={"narrowest_passage_m": 0.35})
    assert violations(narrow) == ["a passage is 0.35 m wide, not 0.8 m"]


def test_the_room_graph_is_measured_on_the_walls(flat: World) -> None:
    checks = flat.checks
    assert checks is not None
    passages = flat.floorplan.passages
    assert [(way.rooms, way.kind) for way in checks.room_graph] == [(each.rooms, each.kind) for each in passages]
    assert [way.clear_width_m for way in checks.room_graph] == [each.width_m for each in passages]


def test_a_wall_that_reaches_into_a_passage_makes_it_narrower(flat: World) -> None:
    door = next(each for each in flat.floorplan.passages if each.kind == "Doorway")
    walls = []
    for wall in flat.floorplan.walls:
        if wall.end == door.start and not wall.lintel:
            longer = tuple(a + 0.25 * (b - a) for a, b in zip(door.start, door.end, strict=True))
            wall = wall.model_copy(update={"end": longer})
        walls.append(wall)
    world = flat.model_copy(update={"floorplan": flat.floorplan.model_copy(update={"walls": walls})})
    narrow = round(0.75 * door.width_m, 4)
    assert checked(world, settle_s=None).narrowest_passage_m == narrow
    assert f"a passage is {narrow} m wide, not 0.8 m" in violations(checked(world, settle_s=None))


def test_errors_of_area_and_aspect_ratio_are_told_as_numbers(flat: World) -> None:
    checks = flat.checks
    assert checks is not None
    for room, measures in zip(flat.floorplan.rooms, checks.rooms, strict=True):
        assert measures.name == room.name
        assert room.desired_area_m2 * (1 + measures.area_error) == pytest.approx(room.floor_area_m2, rel=1e-3)
        assert room.desired_aspect_ratio * (1 + measures.aspect_error) == pytest.approx(measures.aspect_ratio, rel=1e-3)
        assert measures.reachable_share == pytest.approx(
            checks.reachable_cells[room.name] / measures.fitting_cells, abs=1e-4
        )
    wishes = [*flat.floorplan.wishes, *flat.wishes]
    assert checks.wishes is not None
    assert checks.wishes.satisfied == sum(wish.outcome == "satisfied" for wish in wishes)
    assert sum(checks.wishes.model_dump().values()) == len(wishes)


def test_a_room_without_a_way_is_found(flat: World) -> None:
    checks = flat.checks
    assert checks is not None
    alone = checks.model_copy(update={"room_graph": [way for way in checks.room_graph if "Bath" not in way.rooms]})
    assert violations(alone) == ["no way between rooms leads to Bath"]


def test_a_door_that_swings_by_itself_is_found(flat: World) -> None:
    leaf = (
        '<body pos="0 0 1"><joint axis="1 0 0" damping="9"/>'
        '<geom size=".3 .02 .3" pos="0 0.3 0.3" type="box" mass="9"/></body>'
    )
    mjcf = world_mjcf(flat).replace("</worldbody>", f"{leaf}</worldbody>")
    checks = check_world(flat, site_of(flat, mjcf), settle_s=SETTLE_S)
    assert checks.max_drift_m is not None
    assert checks.max_drift_m > 0.1
    assert any("free bodies stay within" in problem for problem in violations(checks))


def test_nameless_parts_that_overlap_are_told_with_their_own_places(flat: World) -> None:
    """As in an imported world, of which only what can move counts."""
    world = with_piece(flat, "Carton", 0.0, 0.0, movable=True)
    nameless = '<geom type="box" size=".1 .1 .1" pos="{} 0 {}"/>'
    added = "".join(nameless.format(x, z) for x, z in ((2, 2), (0, 0.1), (2.05, 2)))
    leaf = '<body name="leaf" pos="0 0 0.1"><geom type="box" size=".1 .1 .1"/></body>'
    site = site_of(world, world_mjcf(world).replace("</worldbody>", f"{added}{leaf}</worldbody>"))
    checks = check_world(world, replace(site, is_planned=False), placed=True)
    told = [fault for fault in checks.faults or [] if fault.guarantee == "overlaps"]
    parts = [set(fault.said.partition(" overlap by")[0].split(" and ")) for fault in told]
    assert {"a part without a name", "Carton_99.carton"} in parts
    assert {"leaf", "Carton_99.carton"} in parts
    assert [fault.at for fault in told] == [pytest.approx((0.0, 0.0), abs=0.01)] * len(told)
    assert {part for pair in checks.penetrating or [] for part in pair} >= {"a part without a name", "leaf"}


def test_a_world_in_which_nothing_collides_is_measured(flat: World) -> None:
    model = mujoco.MjModel.from_xml_string(proof_mjcf(flat))
    model.geom_contype[:] = model.geom_conaffinity[:] = 0
    checks = check_world(flat, planned_site(flat, model), placed=True)
    assert checks.reachable_share == 0.0
    assert len(violations(checks)) >= len(flat.floorplan.rooms)


def test_proofs_are_told_line_by_line(flat: World) -> None:
    lines = {line.name: line for line in proof_lines(flat)}
    rooms = [room.name for room in flat.floorplan.rooms]
    assert {*rooms, "Rooms joined", "Reachable from the origin", "Penetrations at time 0", "Generator"} <= {*lines}
    assert lines["Rooms joined"].value == f"4 rooms, {len(flat.floorplan.passages)} ways"
    assert "area" in lines["Bath"].value
    assert "aspect ratio" in lines["Bath"].value
    assert lines["Seeds"] == ("Seeds", "floor plan 1, interior 2", "")
    assert {line.verdict for line in lines.values()} == {"holds", ""}


def test_broken_and_missing_proofs_are_told_as_such(flat: World) -> None:
    checks = flat.checks
    assert checks is not None
    worse = checks.model_copy(
        update={"max_penetration_m": 0.02, "penetrations": 3, "settled_share": None, "unreachable_goals": ["Bath"]}
    )
    lines = {line.name: line for line in proof_lines(flat.model_copy(update={"checks": worse}))}
    assert lines["Penetrations at time 0"] == (
        "Penetrations at time 0",
        "3 deeper than 5 mm, the deepest 20 mm",
        "broken",
    )
    assert lines["Free bodies that move less than 10 mm"].verdict == "not measured"
    assert lines["Bath"].verdict == "broken"
    assert [line.name for line in proof_lines(flat.model_copy(update={"checks": None}))] == ["Seeds", "Generator"]


def test_checks_of_older_worlds_are_still_read(flat: World) -> None:
    old = {
        "robot_radius_m": 0.2,
        "reachable_share": 1.0,
        "reachable_cells": {"Bath": 900},
        "origin_clear": True,
        "max_penetration_m": 0.0,
        "geoms": 200,
        "narrowest_passage_m": 0.9,
        "settled_share": 1.0,
    }
    checks = WorldChecks.model_validate(old)
    assert violations(checks) == []
    assert "900 cells reached" in {line.value for line in proof_lines(flat.model_copy(update={"checks": checks}))}
