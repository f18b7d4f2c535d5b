import math
from typing import Any

import mujoco
import pytest

from prefect_robomaker.tasks.runtime.robots import scout as robot_scout

ROOM = """<mujoco><option timestep="0.002" integrator="implicitfast" cone="elliptic" impratio="10"/>
<worldbody><geom name="ground" type="plane" size="0 0 1"/>
<geom name="wall" type="box" pos="2 0 0.5" size="0.05 2 0.5"/></worldbody></mujoco>"""


@pytest.fixture
def robot() -> tuple[Any, Any]:
    room = mujoco.MjSpec.from_string(ROOM)
    room.worldbody.add_frame().attach_body(robot_scout.build_scout().body("base"), robot_scout.PREFIX, "")
    model = room.compile()
    return model, mujoco.MjData(model)


def drive(robot: tuple[Any, Any], linear: float, angular: float, duration_s: float) -> float:
    """Returns the largest tilt on the way, radians."""
    model, data = robot
    turn = angular * robot_scout.TRACK_WIDTH_M / 2
    data.ctrl[:] = ((linear - turn) / robot_scout.WHEEL_RADIUS_M, (linear + turn) / robot_scout.WHEEL_RADIUS_M)
    tilt = 0.0
    for _ in range(round(duration_s / model.opt.timestep / 5)):
        mujoco.mj_step(model, data, 5)
        tilt = max(tilt, math.acos(min(1.0, data.body("scout/base").xmat[8])))
    return tilt


def test_drives_as_fast_and_as_straight_as_commanded(robot: tuple[Any, Any]) -> None:
    tilt = drive(robot, 0.5, 0.0, 3.0)
    _, data = robot
    x, y, _ = data.body("scout/base").xpos
    assert 1.3 < x < 1.5
    assert abs(y) < 1e-3
    assert tilt < math.radians(3)


def test_turns_on_the_spot(robot: tuple[Any, Any]) -> None:
    drive(robot, 0.0, 1.0, 3.0)
    _, data = robot
    assert math.hypot(*data.body("scout/base").xpos[:2]) < 0.01
    assert data.qvel[5] == pytest.approx(1.0, rel=0.05)


def test_stays_upright_when_it_hits_a_wall_at_full_speed(robot: tuple[Any, Any]) -> None:
    assert drive(robot, robot_scout.MAX_LINEAR_MPS, 0.0, 8.0) < math.radians(5)
    _, data = robot
    assert data.body("scout/base").xpos[0] == pytest.approx(1.95 - robot_scout.RADIUS_M, abs=0.02)


def test_stands_still_without_a_command(robot: tuple[Any, Any]) -> None:
    drive(robot, 0.0, 0.0, 2.0)
    _, data = robot
    assert math.hypot(*data.body("scout/base").xpos[:2]) < 1e-3


def test_everything_fits_into_the_stated_radius(robot: tuple[Any, Any]) -> None:
    model, data = robot
    mujoco.mj_forward(model, data)
    for geom in range(model.ngeom):
        if model.geom(geom).name.startswith("scout/") and model.geom_contype[geom]:
            x, y, _ = data.geom_xpos[geom]
            reach = model.geom_rbound[geom] if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_SPHERE else 0.0
            reach = reach or model.geom_size[geom][0]
            assert math.hypot(x, y) + reach <= robot_scout.RADIUS_M + 1e-9


def test_has_the_parts_that_programs_and_videos_look_for(robot: tuple[Any, Any]) -> None:
    model, _ = robot
    assert {model.camera(i).name for i in range(model.ncam)} == {"scout/front", "scout/follow"}
    assert {model.sensor(i).name for i in range(model.nsensor)} == {"scout/gyro", "scout/accelerometer"}
    assert model.nmesh == 0
