from collections.abc import Callable, Iterator
from itertools import cycle, repeat
from pathlib import Path
from typing import Any

import pytest
from helpers.robot_stands import CART, CART_MAPPING, PLANAR, PLANAR_MAPPING, write_robot

from prefect_robomaker.tasks.runtime.applications.indoor_navigation.environment import IndoorNavigation
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.navigation_task import NavigationTask
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.world_with_robot import assemble
from prefect_robomaker.tasks.runtime.robots.robot_lookup import find_robot

Command = tuple[float, ...]
Drive = Callable[..., list[str]]
WEAK = CART.replace('kv="1"', 'kv="1" forcerange="-2e-5 2e-5"')
WEAK_LEFT = CART.replace('kv="1"', 'kv="1" forcerange="-2e-5 2e-5"', 1)
WEAK_SLIDES = PLANAR.replace('kv="200"', 'kv="200" forcerange="-0.0001 0.0001"')


@pytest.fixture
def drive(make_context: Any, tmp_path: Path) -> Drive:
    """Drives the cart through commands, one each control step, and returns the notes of the run."""

    def run(commands: Iterator[Command], duration_s: float = 3.0, model: str = CART, **members: Any) -> list[str]:
        mapping = (PLANAR_MAPPING if "slide" in model else CART_MAPPING) | members
        robot = find_robot(write_robot(tmp_path / "robot", mapping, cart_xml=model), {}).robot
        context = make_context()
        physics = assemble(context.world_dir / "world.xml", robot)
        task = NavigationTask(context.world, robot, context.rng, context.recorder, 60.0)
        environment = IndoorNavigation(physics, task, robot)
        environment.reset()
        for _ in range(round(duration_s / 0.05)):
            environment.step(next(commands))
        return environment.run_result().notes

    return run


def test_a_robot_that_is_too_weak_to_drive_is_told_with_what_holds_it(drive: Drive) -> None:
    weak = "; left, right are at their force limit of 2e-05 Nm"
    assert drive(repeat((0.35, 0.0)), model=WEAK) == [
        f"the robot was told to drive at up to 0.35 m/s and moved 0.00 m{weak}"
    ]
    assert drive(repeat((0.0, -9.0)), model=WEAK) == [
        f"the robot was told to turn at up to 2.00 rad/s and turned 0.00 rad{weak}"
    ]


def test_forces_along_slides_are_in_newtons(drive: Drive) -> None:
    (note,) = drive(repeat((0.35, 0.0)), model=WEAK_SLIDES)
    assert note.startswith("the robot was told to drive at up to 0.35 m/s and moved 0.00 m; x")
    assert note.endswith("force limit of 0.0001 N")


@pytest.mark.parametrize(
    "commands",
    [
        pytest.param(repeat((0.6, 0.0)), id="drives, and stands before a wall"),
        pytest.param(repeat((0.0, 0.5)), id="turns"),
        pytest.param(cycle([(0.0, 0.0)] * 60 + [(0.3, 0.0)] * 20), id="waits first"),
        pytest.param(cycle([(0.3, 0.0)] * 5 + [(-0.3, 0.0)] * 5), id="swings"),
    ],
)
def test_a_robot_that_moves_at_some_time_has_no_note(drive: Drive, commands: Iterator[Command]) -> None:
    assert drive(commands, 5.0) == []


def test_one_wheel_that_turns_is_motion(drive: Drive) -> None:
    assert drive(repeat((0.3, 0.0)), model=WEAK_LEFT) == []


def test_a_robot_that_stands_all_the_time_has_a_note(drive: Drive) -> None:
    assert drive(repeat((0.0, 0.0))) == ["the robot never moved: it was only told to stand still"]
    assert drive(repeat((0.001, 0.0))) == ["the robot never moved"]


def test_a_short_run_tells_nothing(drive: Drive) -> None:
    assert drive(repeat((0.0, 0.0)), 2.0) == []
    assert drive(repeat((0.3, 0.0)), 2.0, model=WEAK) == []


def test_a_robot_whose_actions_are_no_velocities_has_no_note(drive: Drive) -> None:
    raw = {"kind": "actuators", "max_linear_mps": 0.5, "max_angular_radps": 1.0}
    assert drive(repeat((0.0, 0.0, 0.0)), drive=raw) == []


def test_measures_of_robot_yaml_that_the_model_contradicts_are_notes(drive: Drive) -> None:
    wrong = CART_MAPPING["drive"] | {"wheel_radius_m": 0.1}
    assert drive(repeat((0.3, 0.0)), drive=wrong) == [
        "robot.yaml: drive.wheel_radius_m is 0.1 m; in the model the wheels' axes are 0.050 m above the floor"
    ]
