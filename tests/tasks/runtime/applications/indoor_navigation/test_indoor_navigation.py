from pathlib import Path
from typing import Any

import dm_env
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.environment import make_environment
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder
from prefect_robomaker.tasks.runtime.robots.sensors.kind import OBSERVED, PUBLISHED


def test_observations_and_actions_are_as_specified(make_context) -> None:
    environment = make_environment(make_context())
    specs = environment.observation_spec()
    timestep = environment.reset()
    assert timestep.first()
    for _ in range(6):
        assert set(timestep.observation) == set(specs)
        for name, spec in specs.items():
            spec.validate(timestep.observation[name])
        timestep = environment.step(environment.action_spec().maximum)
    assert environment.control_timestep() == pytest.approx(0.05)
    assert float(timestep.observation["time"]) == pytest.approx(0.3)


def test_scans_come_five_times_a_second(make_context) -> None:
    environment = make_environment(make_context())
    times = {float(environment.reset().observation["scan_time"])}
    times |= {float(environment.step((0.1, 0.0)).observation["scan_time"]) for _ in range(20)}
    assert sorted(times) == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8, 1.0])


def test_starts_at_the_origin_with_a_heading_of_the_runs_seed(make_context) -> None:
    headings = set()
    for seed in (1, 1, 2):
        x, y, yaw = make_environment(make_context(seed=seed)).reset().observation["pose"]
        assert (x, y) == pytest.approx((0.0, 0.0), abs=1e-6)
        headings.add(float(yaw))
    assert len(headings) == 2


def test_standing_still_after_driving_ends_the_run(make_context) -> None:
    environment = make_environment(make_context())
    environment.reset()
    environment.step((0.1, 0.0))
    steps = 1
    timestep = environment.step((0.0, 0.0))
    while not timestep.last():
        steps += 1
        timestep = environment.step((0.0, 0.0))
    assert steps * 0.05 == pytest.approx(10.0, abs=0.1)
    assert timestep.discount == 0.0


def test_the_time_limit_comes_from_the_environment_variables(make_context) -> None:
    environment = make_environment(make_context(environment={"ROBOMAKER_SIM_TIME_LIMIT_S": "1.5"}))
    timestep: dm_env.TimeStep = environment.reset()
    while not timestep.last():
        timestep = environment.step((0.0, 1.0))
    report = environment.run_result()
    assert report.metrics["sim_time_s"] == pytest.approx(1.5)
    assert report.verdict == "FAIL"
    [missed] = [item for item in report.requirements if not item.satisfied]
    assert missed.name == "rooms_visited"
    assert missed.detail.endswith("the time limit of 1.5 s was reached")


@pytest.mark.parametrize("text", ["soon", "-3", "0", "nan", "inf"])
def test_a_wrong_time_limit_is_named(make_context, text: str) -> None:
    with pytest.raises(LaunchError, match=f"ROBOMAKER_SIM_TIME_LIMIT_S: '{text}' is not a limit"):
        make_environment(make_context(environment={"ROBOMAKER_SIM_TIME_LIMIT_S": text}))


def test_without_a_world_it_says_where_to_name_one(make_context) -> None:
    with pytest.raises(LaunchError, match="worldConfigs") as error:
        make_environment(make_context(with_world=False))
    assert error.value.failure_code == "InvalidInput"


def test_a_world_that_is_no_mjcf_is_refused(make_context) -> None:
    context = make_context()
    (context.world_dir / "world.xml").write_text("<mujoco><worldbody><geom/></worldbody></mujoco>")
    with pytest.raises(LaunchError, match=r"world\.xml: not a world that Scout can be put into"):
        make_environment(context)


@pytest.mark.parametrize("action", [(1.0,), (np.nan, 0.0), "ab", None])
def test_a_wrong_action_is_refused(make_context, action) -> None:
    environment = make_environment(make_context())
    environment.reset()
    with pytest.raises(ValueError, match="action"):
        environment.step(action)


def test_there_is_no_report_before_a_run(make_context) -> None:
    with pytest.raises(RuntimeError, match="call reset first"):
        make_environment(make_context()).run_result()


def read(path: Path) -> dict[str, list[Any]]:
    messages: dict[str, list[Any]] = {}
    with path.open("rb") as stream:
        for item in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            messages.setdefault(item.channel.topic, []).append(item.decoded_message)
    return messages


def test_records_what_a_robot_publishes(make_context, tmp_path: Path) -> None:
    with McapRecorder(tmp_path / "r.mcap") as recorder:
        environment = make_environment(make_context(recorder=recorder))
        assert environment.records_itself
        timestep = environment.reset()
        for _ in range(40):
            timestep = environment.step((0.3, 0.5))
    found = read(tmp_path / "r.mcap")
    states = dict.fromkeys(("/clock", "/tf", "/odom", "/joint_states"), 101)
    assert {topic: len(messages) for topic, messages in found.items()} == {
        "/tf_static": 1, "/scan": 11, "/imu": 41, "/goals": 2, "/map": 1, "/world": 1, "/robot": 1,
        "/robot_description": 1, **states
    }  # fmt: skip
    assert found.keys() - PUBLISHED == {"/imu"}, "topics that kinds of sensors may not take"
    assert timestep.observation.keys() - OBSERVED == {"imu"}
    last = {topic: messages[-1] for topic, messages in found.items()}
    x, y, yaw = timestep.observation["pose"]
    position = last["/odom"].pose.pose.position
    assert (position.x, position.y) == (x, y)
    orientation = last["/odom"].pose.pose.orientation
    assert 2 * np.arctan2(orientation.z, orientation.w) == pytest.approx(yaw, abs=1e-5)
    assert last["/odom"].twist.twist.linear.x == pytest.approx(0.3, abs=0.03)
    assert list(last["/scan"].ranges) == timestep.observation["scan"].tolist()
    assert last["/tf"].transforms[0].child_frame_id == "base_link"
    assert last["/joint_states"].name == ["wheel_left_joint", "wheel_right_joint"]
    mounts = {each.child_frame_id: each for each in found["/tf_static"][0].transforms}
    assert {child: each.header.frame_id for child, each in mounts.items()} == {
        "odom": "map", "base_footprint": "base_link", "base_scan": "base_link", "imu_link": "base_link"
    }  # fmt: skip
    assert mounts["base_footprint"].transform.translation.z == pytest.approx(0.0, abs=1e-3)
    attitude, rates, acceleration = (
        getattr(last["/imu"], name) for name in ("orientation", "angular_velocity", "linear_acceleration")
    )
    assert 2 * np.arctan2(attitude.z, attitude.w) == pytest.approx(yaw, abs=1e-3)
    assert rates.z == pytest.approx(timestep.observation["imu"][2])
    assert acceleration.z == pytest.approx(9.81, abs=0.5)
    mount = mounts["base_scan"]
    assert mount.transform.translation.z == pytest.approx(0.13)
    stamps = [message.header.stamp.sec * 10**9 + message.header.stamp.nanosec for message in found["/odom"]]
    assert stamps == [20_000_000 * sample for sample in range(101)]


def test_recording_changes_nothing(make_context, tmp_path: Path) -> None:
    ends = []
    for recorder in (None, McapRecorder(tmp_path / "r.mcap")):
        environment = make_environment(make_context(recorder=recorder, loose=[("Toy_1", 0.4, 0.0, 0.06)]))
        environment.reset()
        scans = [environment.step((0.5, 0.2)).observation["scan"].tobytes() for _ in range(60)]
        ends.append((environment.physics.data.ptr.qpos.tobytes(), environment.run_result(), scans))
    assert ends[0] == ends[1]


def test_every_run_of_an_environment_is_recorded(make_context, tmp_path: Path) -> None:
    with McapRecorder(tmp_path / "r.mcap") as recorder:
        environment = make_environment(make_context(recorder=recorder))
        for _ in range(2):
            environment.reset()
            environment.step((0.1, 0.0))
    assert len(read(tmp_path / "r.mcap")["/odom"]) == 2 * 3


def test_a_second_run_starts_afresh(make_context) -> None:
    environment = make_environment(make_context())
    environment.reset()
    for _ in range(60):
        environment.step((0.5, 0.3))
    first = environment.run_result()
    environment.reset()
    environment.step((0.1, 0.0))
    second = environment.run_result()
    assert first.metrics["distance_m"] > 0.5
    assert second.metrics["distance_m"] < 0.1
    assert second.metrics["sim_time_s"] == pytest.approx(0.05)
