import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import dm_env
import mujoco
import numpy as np
import pytest
from helpers.robot_stands import FLOOR, Stand
from helpers.small_flat import BODY

from prefect_robomaker.schemas.runs.plan import ApplicationPlan
from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.tasks.runtime.applications import walker
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.environment import make_environment
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.mission import TIPPED_OVER_RAD
from prefect_robomaker.tasks.runtime.robots.walker import LIMITS, WALKER
from prefect_robomaker.tasks.worldforge.bundle.bundle import read_world, write_bundle
from prefect_robomaker.tasks.worldforge.generator import generate_world, seeds_for

UPRIGHT_RAD = math.radians(10)
STEPS = """<geom type="box" pos="0.5 0 0" size="0.1 1 0.012"/><geom type="box" pos="1 0 0" size="0.02 1 0.020"/>"""


@pytest.mark.parametrize("speed", [0.1, 0.25, LIMITS.linear_mps, -0.2])
def test_walks_as_fast_and_as_straight_as_commanded(speed: float) -> None:
    stand = Stand(WALKER)
    assert stand.drive((speed, 0.0), 4.0) < UPRIGHT_RAD
    state = stand.base.read()
    ramp_m = speed * abs(speed) / LIMITS.linear_mps2 / 2
    assert state.x == pytest.approx(speed * 4.0 - ramp_m, rel=0.1)
    assert abs(state.y) < 0.05
    assert abs(state.yaw) < 0.05


@pytest.mark.parametrize("rate", [0.4, -LIMITS.angular_radps])
def test_turns_on_the_spot(rate: float) -> None:
    stand = Stand(WALKER)
    assert stand.drive((0.0, rate), 2.0) < UPRIGHT_RAD
    state = stand.base.read()
    turned = rate * 2.0 - rate * abs(rate) / LIMITS.angular_radps2 / 2
    assert math.remainder(state.yaw - turned, math.tau) == pytest.approx(0.0, abs=0.1 * abs(turned))
    assert math.hypot(state.x, state.y) < 0.03


def test_walks_in_a_circle() -> None:
    stand = Stand(WALKER)
    stand.drive((0.3, 0.75), math.tau / 0.75)  # once around a radius of 0.4 m
    state = stand.base.read()
    assert math.hypot(state.x, state.y) < 0.2
    assert math.remainder(state.yaw, math.tau) == pytest.approx(0.0, abs=0.35)


def test_stands_still_without_a_command_and_after_one() -> None:
    stand = Stand(WALKER)
    stand.drive((0.0, 0.0), 1.0)
    assert math.hypot(*stand.base.read()[:2]) < 0.005
    stand.drive((0.3, 0.4), 1.0)
    stand.drive((0.0, 0.0), 1.0)
    before = stand.base.read()
    stand.drive((0.0, 0.0), 1.0)
    after = stand.base.read()
    assert math.hypot(after.x - before.x, after.y - before.y) < 0.003


def test_walks_over_rugs_and_thresholds() -> None:
    stand = Stand(WALKER, FLOOR.replace("</worldbody>", f"{STEPS}</worldbody>"))
    assert stand.drive((0.25, 0.0), 6.0) < TIPPED_OVER_RAD
    assert stand.base.read().x > 1.25


def test_walks_up_a_slope() -> None:
    stand = Stand(WALKER, FLOOR.replace('type="plane"', 'type="plane" euler="0 -6 0"'))
    assert stand.drive((0.25, 0.0), 4.0) < TIPPED_OVER_RAD
    assert stand.base.read().x > 0.8


def test_keeps_its_feet_when_pushed() -> None:
    stand = Stand(WALKER)
    stand.drive((0.2, 0.0), 1.0)
    body = stand.model.body("walker/body").id
    stand.data.xfrc_applied[body, 1] = 15.0  # half its weight, from the side
    assert stand.drive((0.2, 0.0), 0.25) < TIPPED_OVER_RAD
    stand.data.xfrc_applied[body, 1] = 0.0
    assert stand.drive((0.2, 0.0), 2.0) < TIPPED_OVER_RAD
    assert stand.base.read().tilt < UPRIGHT_RAD


def reach_m(stand: Stand) -> float:
    """How far parts that collide are from the middle, seen from above."""
    model, data, state = stand.model, stand.data, stand.base.read()
    solid = np.flatnonzero((model.geom_bodyid != 0) & (model.geom_contype != 0))
    farthest = 0.0
    for geom in solid.tolist():
        is_limb = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE
        # A box's corners are taken from its bounding box, a limb's ends are balls.
        half = np.array((0.0, 0.0, model.geom_size[geom, 1])) if is_limb else model.geom_aabb[geom, 3:]
        corners = np.array(np.meshgrid((-1, 1), (-1, 1), (-1, 1))).reshape(3, -1).T * half
        points = data.geom_xpos[geom] + corners @ data.geom_xmat[geom].reshape(3, 3).T
        away = np.hypot(points[:, 0] - state.x, points[:, 1] - state.y).max()
        farthest = max(farthest, float(away) + (float(model.geom_size[geom, 0]) if is_limb else 0.0))
    return farthest


@pytest.mark.parametrize("action", [(LIMITS.linear_mps, 0.0), (0.0, LIMITS.angular_radps), (0.3, 1.0), (-0.2, 0.0)])
def test_all_of_it_is_within_its_radius_while_it_walks(action: tuple[float, float]) -> None:
    stand, farthest = Stand(WALKER), 0.0
    for _ in range(50):
        stand.drive(action, 0.05)
        farthest = max(farthest, reach_m(stand))
    assert farthest < LIMITS.radius_m


@pytest.mark.deep
def test_visits_every_room_of_a_generated_flat(tmp_path: Path, make_context: Any) -> None:
    folder = tmp_path / "flat"
    write_bundle(generate_world(WorldTemplateBody.model_validate(BODY), *seeds_for(2, 0, 0)), folder)
    context = make_context()
    # As a job of the built-in application comes: the attribute is that of its module.
    robot = ApplicationPlan(role="robot", name="walker", attribute=f"{walker.__name__}.make_agent")
    plan = context.plan.model_copy(update={"robot_application": robot, "world_dir": folder})
    context = replace(context, plan=plan, world=read_world(folder), world_dir=folder)
    environment = make_environment(context)
    agent = walker.make_agent(context, environment)
    timestep: dm_env.TimeStep = environment.reset()
    assert environment.action_spec().maximum.tolist() == [LIMITS.linear_mps, LIMITS.angular_radps]
    while not timestep.last():
        for name, spec in environment.observation_spec().items():
            spec.validate(timestep.observation[name])
        timestep = environment.step(agent(timestep))
    report = environment.run_result()
    assert report.verdict == "PASS", report.summary
    assert report.metrics["distance_m"] > 3
