"""Ways through doors as they stand at first, and the lines of the proof about them."""

from math import sin

import pytest
from helpers.small_flat import BODY

from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.schemas.worlds.world import Passage, World
from prefect_robomaker.tasks.worldforge.generator import generate_world
from prefect_robomaker.tasks.worldforge.proofs.guarantees import ProofLine, proof_lines, violations
from prefect_robomaker.tasks.worldforge.proofs.standing_doors import clear_as_it_stands_m, rooms_behind_doors


@pytest.fixture(scope="module")
def world() -> World:
    """A flat of two rooms with a door between them, which is fully open."""
    return generate_world(WorldTemplateBody.model_validate({**BODY, "Version": "2"}), 1, 2, settle=False)


def opened(passage: Passage, percent: float) -> Passage:
    door = passage.door and passage.door.model_copy(update={"open_percent": percent})
    return passage.model_copy(update={"door": door})


def with_doors(world: World, percent: float) -> World:
    """The world with all doors as far open, and the checks that it had."""
    passages = [opened(passage, percent) for passage in world.floorplan.passages]
    return world.model_copy(update={"floorplan": world.floorplan.model_copy(update={"passages": passages})})


def lines_of(world: World) -> dict[str, ProofLine]:
    return {line.name: line for line in proof_lines(world)}


def test_a_door_leaves_clear_what_is_between_it_and_the_jamb_opposite(world: World) -> None:
    passage = next(each for each in world.floorplan.passages if each.door)
    door = passage.door
    assert door is not None
    assert clear_as_it_stands_m(opened(passage, 100)) == pytest.approx(door.clear_width_m, abs=0.02)
    half_m = passage.width_m * sin(door.max_angle_rad / 2) - door.thickness_m
    assert clear_as_it_stands_m(opened(passage, 50)) == pytest.approx(half_m, abs=0.02)
    assert clear_as_it_stands_m(opened(passage, 0)) < 0.01


def test_proofs_tell_what_is_clear_when_doors_are_open_and_as_they_stand(world: World) -> None:
    passage = next(each for each in world.floorplan.passages if each.door)
    name = " - ".join(passage.rooms)
    assert lines_of(with_doors(world, 100))[name].value.endswith(" m clear")
    half = lines_of(with_doors(world, 50))[name]
    assert half.value.endswith(
        f" m clear when open; {clear_as_it_stands_m(opened(passage, 50)):.2f} m as it stands, 50 % open"
    )
    assert half.verdict == "holds"
    assert lines_of(with_doors(world, 0))[name].value.endswith(" m clear when open; it stands closed")


def test_rooms_whose_goal_is_out_of_reach_as_doors_stand_are_a_warning_and_break_no_guarantee(world: World) -> None:
    """Although the checks of the world name none: the robot reaches some cells behind the door."""
    ajar = with_doors(world, 10)
    assert ajar.checks is not None
    assert ajar.checks.closed_off_rooms == []
    assert violations(ajar.checks) == []
    behind = rooms_behind_doors(ajar)
    assert len(behind) == 1
    lines = lines_of(ajar)
    told = lines["Behind doors not open enough"]
    assert told.value == f"{', '.join(behind)}; a robot of 0.2 m radius has to push a door to get there"
    assert told.verdict == "warning"
    assert " cells reached when doors are open" in lines[behind[0]].value

    assert rooms_behind_doors(with_doors(world, 100)) == []
    assert "Behind doors not open enough" not in lines_of(with_doors(world, 100))
