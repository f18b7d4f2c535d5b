import math

import numpy as np
import pytest

from prefect_robomaker.tasks.runtime.applications.scout.following import PathFollower
from prefect_robomaker.tasks.runtime.applications.scout.planner import resample

STEP_S = 0.05


def follow(corners: list[tuple[float, float]], yaw: float) -> tuple[np.ndarray, np.ndarray]:
    """Drives an ideal robot; returns its poses and its commands."""
    path = resample(np.array(corners))
    follower = PathFollower(path)
    x, y = corners[0]
    speed, poses, commands = 0.0, [], []
    for _ in range(2000):
        if follower.arrived:
            return np.array(poses), np.array(commands)
        speed, turning = follower.command(x, y, yaw, speed, 1.0)
        yaw += turning * STEP_S
        x, y = x + speed * math.cos(yaw) * STEP_S, y + speed * math.sin(yaw) * STEP_S
        poses.append((x, y, yaw))
        commands.append((speed, turning))
    raise AssertionError("did not arrive")


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2, math.pi, -2.5])
def test_arrives_from_any_heading(yaw: float) -> None:
    poses, _ = follow([(0, 0), (2, 0), (2, 2)], yaw)
    assert math.hypot(poses[-1][0] - 2, poses[-1][1] - 2) < 0.12


def test_stays_near_the_path_and_does_not_sway() -> None:
    poses, commands = follow([(0, 0), (2, 0), (2, 2)], 0.0)
    to_first = np.abs(poses[:, 1]) + np.maximum(poses[:, 0] - 2, 0)
    to_second = np.abs(poses[:, 0] - 2) + np.maximum(-poses[:, 1], 0)
    assert np.minimum(to_first, to_second).max() < 0.16
    turning = commands[np.abs(commands[:, 1]) > 0.05][:, 1]
    assert np.count_nonzero(np.diff(np.sign(turning))) <= 3


def test_slows_down_before_the_end_and_keeps_to_the_limit() -> None:
    _, commands = follow([(0, 0), (3, 0)], 0.0)
    assert commands[:, 0].max() > 0.5
    assert commands[-1][0] < 0.4
    limited = PathFollower(resample(np.array([(0.0, 0.0), (3.0, 0.0)])))
    limited.command(0, 0, 0, 0.0, 0.1)
    assert limited.command(0, 0, 0, 0.0, 0.1)[0] == pytest.approx(0.1)
