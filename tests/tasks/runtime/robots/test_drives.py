import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.robot_stands import CART, CART_MAPPING, Stand, write_robot
from hypothesis import given
from hypothesis import strategies as st
from ruamel.yaml import YAML

from prefect_robomaker.schemas.runs.plan import ApplicationPlan
from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.environment import make_environment
from prefect_robomaker.tasks.runtime.applications.scout import agent as scout
from prefect_robomaker.tasks.runtime.applications.scout.planner import GridPlanner
from prefect_robomaker.tasks.runtime.episode.context import ActionError
from prefect_robomaker.tasks.runtime.episode.occupancy_map import OccupancyMap
from prefect_robomaker.tasks.runtime.robots.drives import VelocityController
from prefect_robomaker.tasks.runtime.robots.robot import CONTROL_TIMESTEP_S, Limits, Robot

NUMBERS = st.floats(-10, 10)


@given(
    actions=st.lists(st.tuples(NUMBERS, NUMBERS), min_size=1, max_size=30),
    limits=st.builds(Limits, st.just(0.2), st.floats(0.1, 2), st.floats(0.1, 5), st.floats(0.1, 5), st.floats(0.1, 20)),
)
def test_commands_keep_to_limits_and_ramps_whatever_is_asked(
    actions: list[tuple[float, float]], limits: Limits
) -> None:
    moves: list[tuple[float, float]] = [(0.0, 0.0)]
    controller = VelocityController(limits, lambda linear, angular: moves.append((linear, angular)))
    for action in actions:
        assert controller.command(action) == (action == (0.0, 0.0))
    for (linear, angular), (next_linear, next_angular) in pairwise(moves):
        assert abs(next_linear) <= limits.linear_mps + 1e-12
        assert abs(next_angular) <= limits.angular_radps + 1e-12
        assert abs(next_linear - linear) <= limits.linear_mps2 * CONTROL_TIMESTEP_S + 1e-12
        assert abs(next_angular - angular) <= limits.angular_radps2 * CONTROL_TIMESTEP_S + 1e-12


def test_a_command_that_is_kept_up_is_reached_and_a_reset_forgets_it() -> None:
    moves: list[tuple[float, float]] = []
    controller = VelocityController(Limits(0.2, 0.5, 2.0), lambda *move: moves.append(move))
    for _ in range(20):
        controller.command((0.4, -1.0))
    assert moves[-1] == pytest.approx((0.4, -1.0))
    controller.reset()
    controller.command((0.0, 0.0))
    assert moves[-1] == (0.0, 0.0)


@pytest.mark.parametrize("action", [(1.0,), (math.nan, 0.0), (0.0, math.inf), "ab", None, np.zeros((2, 2))])
def test_what_is_no_command_is_refused(action: Any) -> None:
    with pytest.raises(ActionError, match="action: "):
        VelocityController(Limits(0.2, 0.5, 2.0), lambda *_: None).command(action)


PUSHED = """<mujoco><worldbody><body name="chassis" pos="0 0 0.06"><freejoint/>
<geom type="cylinder" size="0.15 0.05" mass="5" friction="0.01" priority="1"/><site name="middle"/></body></worldbody>
<actuator>
<velocity name="ahead" site="middle" gear="1 0 0 0 0 0" kv="60"/>
<velocity name="across" site="middle" gear="0 1 0 0 0 0" kv="60"/>
<velocity name="round" site="middle" gear="0 0 0 0 0 1" kv="4"/></actuator></mujoco>"""


def test_actuators_that_push_along_the_robots_own_axes_drive_it(make_cart: Callable[..., Robot]) -> None:
    drive = {
        "kind": "velocity", "frame": "base", "x": "ahead", "y": "across", "yaw": "round", "max_linear_mps": 0.5,
        "max_angular_radps": 1.5,
    }  # fmt: skip
    robot = make_cart({"cart_xml": PUSHED}, drive=drive, spawn={"height_m": 0.05}, sensors={})
    stand = Stand(robot)
    stand.drive((0.0, math.pi / 4), 2.0)
    stand.drive((0.4, 0.0), 2.0)
    state = stand.base.read()
    assert state.yaw == pytest.approx(math.pi / 2, abs=0.25)
    assert state.linear == pytest.approx(0.4, rel=0.1)
    assert state.y > 0.5


@pytest.mark.parametrize("radius_m", [0.17, 0.35, 0.6])
def test_ways_are_planned_for_robots_of_any_size(radius_m: float) -> None:
    free = np.zeros((80, 80), np.bool_)
    free[2:-2, 2:-2] = True
    way = GridPlanner(OccupancyMap(free, 0.05, (-2.0, -2.0)), radius_m).plan((-1.0, -1.0), (1.0, 1.0))
    assert way is not None
    assert way.kind == "free"
    assert np.abs(way.path).max() <= 1.9 - radius_m


def test_scouts_program_drives_a_robot_of_menagerie(tmp_path: Path, make_context: Any) -> None:
    folder = tmp_path / "menagerie" / "acme_cart"
    folder.mkdir(parents=True)
    (folder / "cart.xml").write_text(CART)
    with (folder / "robot.yaml").open("w") as stream:
        YAML(typ="safe", pure=True).dump(CART_MAPPING, stream)
    variables = {"MENAGERIE_ROOT": str(tmp_path / "menagerie"), "ROBOMAKER_ROBOT": "menagerie:acme_cart"}
    context = make_context(environment=variables)
    environment = make_environment(context)
    agent = scout.make_agent(context, environment)
    timestep = environment.reset()
    names = environment.observation_spec()
    assert names["joint_position"].shape == (3,)
    assert "wheel_velocity" not in names
    while not timestep.last():
        for name, spec in names.items():
            spec.validate(timestep.observation[name])
        timestep = environment.step(agent(timestep))
    assert environment.run_result().verdict == "PASS", environment.run_result().summary
    assert environment.video_camera == "follow"


def test_scouts_program_refuses_a_robot_without_range_sensors(tmp_path: Path, make_context: Any) -> None:
    context = make_context()
    application: ApplicationPlan = write_robot(tmp_path / "bundle", CART_MAPPING | {"sensors": {}})
    context = replace(context, plan=context.plan.model_copy(update={"robot_application": application}))
    environment = make_environment(context)
    assert "scan" not in environment.observation_spec()
    environment.reset()
    assert set(environment.step((0.1, 0.0)).observation) == set(environment.observation_spec())
    with pytest.raises(LaunchError, match="proximity, scan, scan_time"):
        scout.make_agent(context, environment)
