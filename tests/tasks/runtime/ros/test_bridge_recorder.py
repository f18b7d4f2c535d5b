import io
from pathlib import Path

import mujoco
import numpy as np
import pytest
from helpers.scripted_wire import ScriptedWire
from mcap.reader import make_reader

from prefect_robomaker.tasks.runtime.recording import messages as ros
from prefect_robomaker.tasks.runtime.recording.cdr import decode, imu
from prefect_robomaker.tasks.runtime.recording.recording import DEFAULT_FRAMES, McapRecorder, Recorder
from prefect_robomaker.tasks.runtime.recording.state_series import RowSeries, StateSeries
from prefect_robomaker.tasks.runtime.ros.bridge_recorder import TOPICS, BridgeRecorder

MODEL = """<mujoco><worldbody><body name="cart"><joint name="rail" type="slide" axis="1 0 0"/>
<geom size=".1" mass="1"/></body></worldbody></mujoco>"""
NAMES = {topic: topic for topic in TOPICS}


def attached(inner: Recorder) -> tuple[BridgeRecorder, ScriptedWire]:
    recorder, wire = BridgeRecorder(inner), ScriptedWire()
    recorder.attach(wire, NAMES, DEFAULT_FRAMES, {"odom"})
    return recorder, wire


def recorded(path: Path) -> dict[str, list[bytes]]:
    found: dict[str, list[bytes]] = {}
    for _, channel, message in make_reader(io.BytesIO(path.read_bytes())).iter_messages():
        found.setdefault(channel.topic, []).append(message.data)
    return found


def published(wire: ScriptedWire, topic: str) -> list[bytes]:
    return [data for _, name, data in wire.sent if name == topic]


def drive(recorder: Recorder, *, publish: bool) -> None:
    """Ten states 20 ms apart and a measurement with every fourth; nodes are served 50 ms apart."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    data.qvel[0] = 1.0
    states, measured = StateSeries(model, data, [0]), RowSeries("/imu", imu("imu_link"))
    recorder.add_series(measured)  # first, so that states have to overtake it
    recorder.add_series(states)
    for step in range(100):
        data.time, data.qpos[0] = step * 0.002, step * 0.002
        if step % 10 == 0:
            states.sample(recorder)
        if step % 40 == 0:
            measured.add(recorder, data.time, np.arange(10.0) + step)
            recorder.flush_when_due(full=True)  # the recording may write at any time
        if publish and step % 25 == 0 and isinstance(recorder, BridgeRecorder):
            recorder.publish()
    recorder.write("/goal_pose", ros.PoseStamped(ros.Header(ros.Time(1, 0), "map"), ros.Pose()), 0.2)
    recorder.close()


def test_a_run_records_the_same_bytes_with_nodes_and_without(tmp_path: Path) -> None:
    for name in ("alone", "bridged"):
        (tmp_path / name).mkdir()
    drive(McapRecorder(tmp_path / "alone" / "r.mcap"), publish=False)
    bridge, wire = attached(McapRecorder(tmp_path / "bridged" / "r.mcap"))
    drive(bridge, publish=True)
    alone, bridged = recorded(tmp_path / "alone" / "r.mcap"), recorded(tmp_path / "bridged" / "r.mcap")
    assert alone == bridged
    assert bridge.topics == {"/clock", "/joint_states", "/imu", "/goal_pose"}
    # None is lost to what the recording took; the third came after the last step.
    assert published(wire, "/imu") == alone["/imu"][:2]
    assert published(wire, "/goal_pose") == alone["/goal_pose"]


def test_nodes_get_the_state_of_the_very_time(tmp_path: Path) -> None:
    bridge, wire = attached(McapRecorder(tmp_path / "r.mcap"))
    drive(bridge, publish=True)
    stamps = [decode(data, "rosgraph_msgs/msg/Clock").clock for data in published(wire, "/clock")]
    assert [stamp.nanosec for stamp in stamps] == [0, 50_000_000, 100_000_000, 150_000_000]
    joints = [decode(data, "sensor_msgs/msg/JointState").position[0] for data in published(wire, "/joint_states")]
    assert joints == pytest.approx([0.0, 0.05, 0.1, 0.15])
    topics = [topic for _, topic, _ in wire.sent]
    assert topics[:3] == ["/clock", "/joint_states", "/imu"]


def test_nothing_is_kept_for_nodes_that_do_not_drive_and_recordings_that_are_not_made() -> None:
    bridge = BridgeRecorder(Recorder())
    model = mujoco.MjModel.from_xml_string(MODEL)
    series = StateSeries(model, mujoco.MjData(model), [0])
    bridge.add_series(series)
    for _ in range(5000):
        series.sample(bridge)
    assert len(series.take()[0]) < 1024
    assert bridge.publish() == set()


def test_frames_that_nodes_find_out_themselves_are_kept_from_them(tmp_path: Path) -> None:
    bridge, wire = attached(McapRecorder(tmp_path / "r.mcap"))
    header = ros.Header(ros.Time(0, 0), "map")
    bridge.add_static_transforms(
        [ros.TransformStamped(header, child, ros.Transform()) for child in ("odom", "camera")], 0.0
    )
    bridge.add_static_transforms([ros.TransformStamped(header, "camera", ros.Transform())], 1.0)  # nothing new
    bridge.close()

    def children(data: bytes) -> list[str]:
        return [each.child_frame_id for each in decode(data, "tf2_msgs/msg/TFMessage").transforms]

    assert [children(data) for data in published(wire, "/tf_static")] == [["camera"]]
    assert [children(data) for data in recorded(tmp_path / "r.mcap")["/tf_static"]] == [["odom", "camera"]]
