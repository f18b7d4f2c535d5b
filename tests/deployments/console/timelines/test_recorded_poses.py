"""Poses from a recording, as a page gets them."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.deployments.console.timelines.recorded_poses import Pose, fits, read_poses, thinned
from prefect_robomaker.tasks.runtime.recording import messages as ros
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder


def odometry(time_s: float, x: float, y: float, yaw_rad: float, frame: str = "odom") -> ros.Odometry:
    turn = ros.Quaternion(0.0, 0.0, math.sin(yaw_rad / 2), math.cos(yaw_rad / 2))
    header = ros.Header(ros.Time.from_seconds(time_s), frame)
    return ros.Odometry(header, "base_link", ros.Pose(ros.Vector3(x, y, 0.1), turn), ros.Twist())


def test_poses_are_those_that_were_recorded(tmp_path: Path) -> None:
    path = tmp_path / "recording.mcap"
    with McapRecorder(path) as recorder:
        # Names of each length, since numbers behind them are aligned.
        for index in range(9):
            message = odometry(index / 50, index / 3, -index / 7, 0.3 * index - 1, "odom"[: index % 5])
            recorder.write("/odom", message, index / 50)
    found = read_poses(path)
    assert found.missing == ""
    for index, pose in enumerate(found.poses):
        expected = (index / 50, index / 3, -index / 7, 0.3 * index - 1)
        assert all(abs(a - b) < 1e-6 for a, b in zip(pose, expected, strict=True) if a is not None), index
    assert len(found.poses) == 9


def test_what_has_no_poses_says_why(tmp_path: Path) -> None:
    path = tmp_path / "recording.mcap"
    path.write_bytes(b"no recording")
    assert read_poses(path).missing == "The recording cannot be read."
    with McapRecorder(path) as recorder:
        recorder.write("/clock", ros.Clock(ros.Time(1, 0)), 1.0)
    assert read_poses(path).missing == "The recording has no poses on /odom."


STANDS = [(time_s, 1.0, 2.0) for time_s in (0.0, 5.0, 10.0)]
"""Path of a robot that never moves."""


@pytest.mark.parametrize(
    ("times_s", "drift_mps", "do_fit"),
    [
        ((0.0, 5.0, 10.0), 0.0, True),
        ((0.02, 4.0), 0.0, True),  # its odometry ends early, and it stands where it stood
        ((0.0, 10.1), 0.0, True),  # within a control step
        ((0.0, 10.0), 0.1, False),  # its wheels spin
        ((1.7e9, 1.7e9 + 10), 0.0, False),  # times of a wall clock
        ((0.0, 5.0, 1.7e9), 0.0, False),
        ((-7.0, 3.0), 0.0, False),
        ((), 0.0, False),
    ],
)
def test_poses_of_a_robot_that_stands_fit_by_their_places_and_times(
    times_s: tuple[float, ...], drift_mps: float, do_fit: bool
) -> None:
    poses = [Pose(time_s, 1.0 + drift_mps * time_s, 2.0, 0.0) for time_s in times_s]
    assert fits(poses, STANDS, end_s=10.0) == do_fit
    assert not fits(poses, [], end_s=10.0), "nothing says where it was"


@given(st.integers(1, 3000), st.lists(st.floats(0, 60), max_size=20), st.integers(2, 40))
def test_marked_moments_stay_however_few_poses_there_are(count: int, moments_s: list[float], most: int) -> None:
    poses = [Pose(index / 50, float(index), 0.0, 0.0) for index in range(count)]
    kept = thinned(poses, moments_s, most)
    assert len(kept) <= most + 1 + len(moments_s)
    assert kept == sorted(kept)
    assert (kept[0], kept[-1]) == (poses[0], poses[-1])
    for moment in moments_s:
        last = max((each for each in poses if each.time_s <= moment + 1e-6), default=poses[0])
        assert last in kept, moment
