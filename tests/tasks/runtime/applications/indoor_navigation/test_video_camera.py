"""The view that a video has without being asked for one, of each built-in robot."""

import math
from typing import Any

import mujoco
import pytest

from prefect_robomaker.tasks.runtime.applications.indoor_navigation import make_environment
from prefect_robomaker.tasks.runtime.episode.physics import robot_body
from prefect_robomaker.tasks.runtime.rendering.views import choose_view


@pytest.mark.parametrize("robot", ["scout", "walker"])
def test_it_keeps_the_horizon_when_the_robot_tips_over(robot: str, make_context: Any) -> None:
    environment = make_environment(make_context(environment={"ROBOMAKER_ROBOT": robot}))
    environment.reset()
    model, data = environment.physics.model.ptr, environment.physics.data.ptr
    body = robot_body(model)
    assert body is not None
    start = model.jnt_qposadr[model.body_jntadr[body]]
    view = choose_view(model, getattr(environment, "video_camera", None))
    stands = view(data)
    side, slope = stands.azimuth, stands.elevation

    data.qpos[start + 3 : start + 7] = [math.cos(math.pi / 4), math.sin(math.pi / 4), 0, 0]  # on its side
    mujoco.mj_forward(model, data)
    lies = view(data)

    assert lies.type == mujoco.mjtCamera.mjCAMERA_FREE
    assert (lies.azimuth, lies.elevation) == pytest.approx((side, slope), abs=1)
