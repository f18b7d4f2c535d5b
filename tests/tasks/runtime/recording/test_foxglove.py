"""Recordings, read with the libraries that Foxglove reads them with."""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.client_environments import node_modules, run_client
from rosbags.highlevel import AnyReader

from prefect_robomaker.schemas.runs.plan import ApplicationPlan
from prefect_robomaker.tasks.runtime.process.child import BUILT_IN_ENVIRONMENT
from prefect_robomaker.tasks.runtime.recording import messages as display
from prefect_robomaker.tasks.runtime.recording import messages as ros
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher

_PROJECT = Path(__file__).parent / "foxglove"
_ROBOT = "prefect_robomaker.tasks.runtime.applications.scout.make_agent"

Read = tuple[str, int, Any]


@pytest.fixture(scope="module")
def modules(pytestconfig: pytest.Config) -> Path:
    """Foxglove's libraries."""
    return node_modules(pytestconfig, _PROJECT)


def read_by_foxglove(path: Path, modules: Path) -> Iterator[Read]:
    """Topic, log time and content of each message."""
    printed = run_client(["node", str(_PROJECT / "read.cjs"), str(path)], {"NODE_PATH": str(modules)})
    for line in printed.splitlines():
        topic, time_ns, message = json.loads(line)
        yield topic, int(time_ns), message


def read_by_rosbags(path: Path) -> Iterator[Read]:
    """The same, as another reader has it."""
    with AnyReader([path]) as reader:
        for connection, time_ns, raw in reader.messages():
            yield connection.topic, time_ns, plain(reader.deserialize(raw, connection.msgtype))


def plain(value: Any) -> Any:
    """A message as `read.cjs` prints it."""
    if isinstance(value, np.ndarray):
        return value.tobytes().hex() if value.dtype == np.uint8 else [plain(each) for each in value.tolist()]
    if isinstance(value, list):
        return [plain(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value).replace("inf", "Infinity").replace("nan", "NaN")
    if hasattr(value, "__msgtype__"):
        # Names of constants are in capitals.
        return {name: plain(each) for name, each in vars(value).items() if name[0].islower()}
    return value


def check_same(path: Path, modules: Path) -> set[str]:
    """Compares what both read, message by message; returns the topics."""
    ours, theirs = list(read_by_rosbags(path)), list(read_by_foxglove(path, modules))
    assert [time_ns for _, time_ns, _ in theirs] == sorted(time_ns for _, time_ns, _ in ours)
    topics = {topic for topic, _, _ in ours}
    for topic in topics:
        assert [each for each in theirs if each[0] == topic] == [each for each in ours if each[0] == topic]
    return topics


@pytest.mark.deep
def test_foxglove_reads_what_a_job_records(launcher: Launcher, make_context, modules: Path, tmp_path: Path) -> None:
    environment = BUILT_IN_ENVIRONMENT.model_copy(update={"environment_variables": {"ROBOMAKER_RECORD_CAMERA_HZ": "1"}})
    robot = ApplicationPlan(role="robot", name="scout", attribute=_ROBOT)
    plan = make_context(loose=[("Toy_1", 0.45, 1.3, 0.05)]).plan.model_copy(
        update={
            "simulation_application": environment,
            "robot_application": robot,
            "work_dir": tmp_path / "work",
            "output_dir": tmp_path / "out",
        }
    )
    assert launcher.run(plan, lambda: None).status == "Completed"

    topics = check_same(plan.output_dir / "recording.mcap", modules)
    assert topics >= {"/clock", "/tf", "/odom", "/joint_states", "/scan", "/tf_static", "/goals", "/goal_pose", "/plan"}
    assert topics >= {"/map", "/world", "/robot"}
    assert topics >= {"/camera/image_raw/compressed", "/camera/camera_info"}


@pytest.mark.deep
def test_foxglove_reads_every_kind_of_message(modules: Path, tmp_path: Path) -> None:
    header = ros.Header(ros.Time(1, 999_999_999), "küche")
    pose = ros.Pose(ros.Vector3(math.inf, -1e300, 5e-324), ros.Quaternion())
    stamped = display.PoseStamped(header, pose)
    label = display.Marker(
        header,
        "wall",
        -1,
        display.MarkerType.TEXT_VIEW_FACING,
        points=[ros.Vector3(1.0), ros.Vector3(2.0)],
        text="2 N",
        frame_locked=True,
    )
    scan = np.array([0.1, math.inf, math.nan], np.float32)
    messages = [
        ros.Clock(ros.Time(2**31 - 1, 0)),
        ros.TFMessage([ros.TransformStamped(header, "a", ros.Transform())] * 2),
        ros.Odometry(header, "base", pose, ros.Twist(), range(36), range(36)),
        ros.LaserScan(header, -1.0, 1.0, 1.0, 0.0, 0.1, 0.1, 3.5, scan, scan),
        ros.JointState(header, ["é", ""], (0.5, -0.0), (), (math.nan,)),
        ros.Imu(header, ros.Quaternion(), ros.Vector3(), ros.Vector3(z=9.81)),
        stamped,
        display.Path(header, [stamped, stamped]),
        display.CompressedImage(header, "jpeg", bytes(range(256))),
        display.CameraInfo(header, 240, 320, 200.5, 200.25, 159.5, 119.5),
        display.OccupancyGrid(header, 0.05, 2, 1, pose, b"\xff\x64"),
        display.MarkerArray([label, label._replace(text="", points=())]),
    ]
    with McapRecorder(tmp_path / "recording.mcap") as recorder:
        for message in messages:
            recorder.write(f"/{type(message).__name__}", message, 0.5)

    assert len(check_same(tmp_path / "recording.mcap", modules)) == len(messages)
