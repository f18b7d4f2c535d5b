"""What `docs/recordings.md` says, done."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.paths import REPOSITORY
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan
from prefect_robomaker.schemas.runs.programs import ApplicationRole
from prefect_robomaker.tasks.runtime.recording import messages as ros
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher

PAGE_FOLDER = REPOSITORY / "docs"
PAGE = (PAGE_FOLDER / "recordings.md").read_text()
READING, WRITING = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


def test_the_reading_example(tmp_path: Path) -> None:
    with McapRecorder(tmp_path / "recording.mcap") as recorder:
        for step in range(3):
            pose = ros.Pose(ros.Vector3(step * 2.0))
            header = ros.Header(ros.Time.from_seconds(step * 0.5), "odom")
            recorder.write("/odom", ros.Odometry(header, "base_link", pose, ros.Twist()), step * 0.5)
            recorder.write("/clock", ros.Clock(header.stamp), step * 0.5)
    names: dict[str, Any] = {}
    exec(compile(READING, "recordings.md", "exec"), names)
    assert list(names["positions"](tmp_path)) == [(0.0, 0.0), (0.5, 2.0), (1.0, 4.0)]


def test_the_writing_example(tmp_path: Path) -> None:
    names: dict[str, Any] = {}
    exec(compile(WRITING, "recordings.md", "exec"), names)
    with McapRecorder(tmp_path / "recording.mcap") as recorder:
        names["publish_wheel_torque"](recorder, 0.5, np.float64(0.25))
    with (tmp_path / "recording.mcap").open("rb") as stream:
        [(schema, channel, message)] = make_reader(stream).iter_messages()
    assert schema is not None
    assert (schema.name, channel.topic, message.log_time) == (
        "sensor_msgs/msg/JointState",
        "/wheel_torque",
        500_000_000,
    )


@pytest.mark.parametrize("record", [True, False])
def test_a_job_records_everything_or_nothing(
    launcher: Launcher, make_plan: Callable[..., RunPlan], record: bool
) -> None:
    bundle = PAGE_FOLDER.parent / "deployments" / "specs" / "examples" / "cartpole_bundle"
    roles: tuple[ApplicationRole, ...] = ("simulation", "robot")
    arena, agent = (
        ApplicationPlan(role=role, name=role, attribute=f"my_cartpole.{name}", path=bundle)
        for role, name in zip(roles, ("arena.make_environment", "agent.make_agent"), strict=True)
    )
    plan = make_plan(simulation_application=arena, robot_application=agent, record=record)
    assert launcher.run(plan, lambda: None).status == "Completed"
    files = {"recording.mcap", "metadata.yaml", "foxglove-layout.json"}
    assert files & {path.name for path in plan.output_dir.iterdir()} == (files if record else set())
    if record:
        with AnyReader([plan.output_dir]) as reader:
            assert {topic: info.msgcount for topic, info in reader.topics.items()} == {
                "/clock": 501,
                "/joint_states": 501,
            }
