"""Checks find what is wrong with a world, and nothing in a good one."""

import pytest

from prefect_robomaker.schemas.world import Furniture, Room, World, WorldChecks
from prefect_robomaker.tasks.worldforge.checks import check_world
from prefect_robomaker.tasks.worldforge.furniture import styles_of
from prefect_robomaker.tasks.worldforge.guarantees import SETTLE_S, violations
from prefect_robomaker.tasks.worldforge.mjcf import world_mjcf
from prefect_robomaker.tasks.worldforge.occupancy import occupancy_grid


def checked(world: World, settle_s: float | None = SETTLE_S) -> WorldChecks:
    grid = occupancy_grid(world.floorplan, world.furniture)
    return check_world(world, world_mjcf(world), grid, settle_s=settle_s)


def with_piece(world: World, kind: str, x: float, y: float, **more: float | bool) -> World:
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
    world = with_piece(flat, "Carton", 0.9, 0.9, base_m=1.0, movable=True)
    checks = checked(world)
    assert checks.settled_share is not None
    assert checks.settled_share < 1
    assert any("free bodies stay within 0.01 m" in problem for problem in violations(checks))
    assert checked(world, settle_s=None).settled_share is None


def test_bodies_that_overlap_are_found(flat: World) -> None:
    world = with_piece(flat, "Carton", 0.9, 0.9, base_m=-0.02, movable=True)
    assert checked(world).max_penetration_m == pytest.approx(0.02, abs=0.002)
    assert any("overlap by 0.02" in problem for problem in violations(checked(world)))


def test_a_passage_narrower_than_the_robot_is_found(flat: World) -> None:
    checks = flat.checks
    assert checks is not None
    assert checks.narrowest_passage_m == min(passage.width_m for passage in flat.floorplan.passages)
    narrow = checks.model_copy(update={"narrowest_passage_m": 0.35})
    assert violations(narrow) == ["a passage is 0.35 m wide, not 0.8 m"]
