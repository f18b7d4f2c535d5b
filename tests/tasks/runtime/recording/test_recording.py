import json
import os
import signal
import subprocess
import sys
import tracemalloc
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from ruamel.yaml import YAML

from prefect_robomaker.tasks.runtime.recording import messages as ros
from prefect_robomaker.tasks.runtime.recording.companions import layout
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder, Recorder, RecordingError


def header(time_s: float, frame: str = "odom") -> ros.Header:
    return ros.Header(ros.Time.from_seconds(time_s), frame)


def one_of_each(time_s: float) -> dict[str, ros.Message]:
    ranges = np.linspace(0.1, 9.0, 360, dtype=np.float32)
    pose = ros.Pose(ros.Vector3(time_s, 2.0), ros.Quaternion())
    return {
        "/clock": ros.Clock(ros.Time.from_seconds(time_s)),
        "/tf": ros.TFMessage([ros.TransformStamped(header(time_s), "base_link", ros.Transform(ros.Vector3(time_s)))]),
        "/odom": ros.Odometry(header(time_s), "base_link", pose, ros.Twist(ros.Vector3(0.2))),
        "/scan": ros.LaserScan(header(time_s, "laser"), -3.14, 3.14, 0.0175, 0.0, 0.1, 0.1, 10.0, ranges),
        "/joint_states": ros.JointState(header(time_s), ["left", "right"], [time_s, 2.0], np.array([3.0, 4.0]), ()),
        "/imu": ros.Imu(header(time_s), ros.Quaternion(), ros.Vector3(z=0.1), ros.Vector3(z=9.81)),
    }


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "recording.mcap"
    with McapRecorder(path) as recorder:
        for i in range(100):
            for topic, message in one_of_each(i * 0.02).items():
                recorder.write(topic, message, i * 0.02)
    return path


def test_rosbags_reads_everything(recording: Path) -> None:
    with AnyReader([recording]) as reader:
        assert {item.topic: item.msgtype for item in reader.connections} == {
            topic: type(message).ROS_TYPE for topic, message in one_of_each(0.0).items()
        }
        assert reader.message_count == 600
        [odometry] = [item for item in reader.connections if item.topic == "/odom"]
        stamps = []
        for connection, time_ns, raw in reader.messages([odometry]):
            message: Any = reader.deserialize(raw, connection.msgtype)
            assert message.pose.pose.position.x == pytest.approx(time_ns * 1e-9)
            stamps.append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
        assert stamps == [20_000_000 * i for i in range(100)]


def test_mcap_ros2_reads_everything(recording: Path) -> None:
    with recording.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        last = {item.channel.topic: item.decoded_message for item in reader.iter_decoded_messages()}
    assert last["/tf"].transforms[0].child_frame_id == "base_link"
    assert last["/joint_states"].name == ["left", "right"]
    assert list(last["/joint_states"].position) == pytest.approx([1.98, 2.0])
    assert len(last["/scan"].ranges) == 360
    assert last["/imu"].linear_acceleration.z == 9.81
    assert last["/clock"].clock.nanosec == 980_000_000


def test_the_folder_is_a_rosbag2(recording: Path) -> None:
    with AnyReader([recording.parent]) as reader:
        assert reader.message_count == 600
        assert (reader.start_time, reader.end_time - 1) == (0, 1_980_000_000)
        assert {item.topic: item.msgcount for item in reader.connections} == dict.fromkeys(one_of_each(0.0), 100)
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)


def test_the_metadata_is_that_of_rosbags_writer(recording: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    store = get_typestore(Stores.ROS2_JAZZY)
    with (
        AnyReader([recording]) as reader,
        Writer(copy, version=9, storage_plugin=StoragePlugin.MCAP) as writer,
    ):
        offered = {item.topic: qos_of(item) for item in reader.connections}
        connections = {
            item.topic: writer.add_connection(
                item.topic, item.msgtype, typestore=store, offered_qos_profiles=offered[item.topic]
            )
            for item in reader.connections
        }
        for connection, time_ns, raw in reader.messages():
            writer.write(connections[connection.topic], time_ns, raw)
    ours, theirs = (
        YAML(typ="safe").load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
        for folder in (recording.parent, copy)
    )
    assert ours.keys() == theirs.keys()
    assert ours.pop("relative_file_paths") == ["recording.mcap"]
    for information in (ours, theirs):
        information.pop("ros_distro")
        information.pop("relative_file_paths", None)
        information["files"][0].pop("path")
        information["topics_with_message_count"].sort(key=lambda item: item["topic_metadata"]["name"])
    assert ours == theirs


def test_names_of_topics_may_be_strange(tmp_path: Path) -> None:
    with McapRecorder(tmp_path / "it's: a #recording.mcap") as recorder:
        recorder.write("/it's: #1", ros.Clock(ros.Time(0, 0)), 0.0)
    information = YAML(typ="safe").load((tmp_path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert information["relative_file_paths"] == ["it's: a #recording.mcap"]
    assert information["topics_with_message_count"][0]["topic_metadata"]["name"] == "/it's: #1"


def test_a_recording_without_messages_has_metadata_all_the_same(tmp_path: Path) -> None:
    McapRecorder(tmp_path / "recording.mcap").close()
    information = YAML(typ="safe").load((tmp_path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (information["message_count"], information["topics_with_message_count"]) == (0, [])


def test_the_layout_for_foxglove_shows_what_is_there(recording: Path) -> None:
    shown = json.loads((recording.parent / "foxglove-layout.json").read_text())
    panels = shown["configById"]
    assert {name.split("!")[0] for name in panels} == {"3D", "Plot", "RawMessages"}
    assert set(panels["3D!scene"]["topics"]) == {"/odom", "/scan"}
    lines = {line["value"] for name, panel in panels.items() if name.startswith("Plot!") for line in panel["paths"]}
    assert {path.split(".")[0] for path in lines} == {"/odom", "/joint_states"}
    assert panels["RawMessages!messages"]["topicPath"] == "/odom"
    assert sorted(leaves(shown["layout"])) == sorted(panels)


def test_scans_have_the_colour_that_the_layout_asks_for(recording: Path) -> None:
    # Without a field Foxglove puts its own mode in place of the one asked for.
    shown = json.loads((recording.parent / "foxglove-layout.json").read_text())["configById"]["3D!scene"]
    assert shown["topics"]["/scan"].items() >= {"colorMode": "flat", "colorField": "range"}.items()


def test_the_scene_shows_cameras_and_a_grid_where_there_is_no_floor() -> None:
    topics = {
        "/tf": "tf2_msgs/msg/TFMessage",
        "/odom": "nav_msgs/msg/Odometry",
        "/camera/image_raw/compressed": "sensor_msgs/msg/CompressedImage",
        "/camera/camera_info": "sensor_msgs/msg/CameraInfo",
    }
    bare = layout(topics)["configById"]
    furnished = layout(topics | {"/world": "visualization_msgs/msg/MarkerArray"})["configById"]

    assert set(bare["3D!scene"]["topics"]) == {"/odom", "/camera/camera_info"}
    assert bare["Image!camera0"]["imageMode"] == {
        "imageTopic": "/camera/image_raw/compressed",
        "calibrationTopic": "/camera/camera_info",
    }
    assert [each["3D!scene"]["layers"]["grid"]["visible"] for each in (bare, furnished)] == [True, False]


def qos_of(connection: Connection) -> Any:
    assert isinstance(connection.ext, ConnectionExtRosbag2)
    return connection.ext.offered_qos_profiles


def leaves(node: Any) -> list[str]:
    return [node] if isinstance(node, str) else leaves(node["first"]) + leaves(node["second"])


def test_a_player_keeps_static_transforms_for_those_who_come_later(tmp_path: Path) -> None:
    path = tmp_path / "recording.mcap"
    with McapRecorder(path) as recorder:
        recorder.write("/tf_static", ros.TFMessage([]), 0.0)
        recorder.write("/clock", ros.Clock(ros.Time.from_seconds(0.0)), 0.0)

    with AnyReader([path]) as reader:
        offered = {connection.topic: qos_of(connection)[0] for connection in reader.connections}

    assert offered["/tf_static"].durability.name == "TRANSIENT_LOCAL"
    assert offered["/clock"].durability.name == "VOLATILE"


def test_the_last_static_transforms_are_all_of_them(tmp_path: Path) -> None:
    def at(time_s: float, child: str, x: float = 0.0) -> ros.TransformStamped:
        return ros.TransformStamped(header(time_s, "base_link"), child, ros.Transform(ros.Vector3(x)))

    with McapRecorder(tmp_path / "recording.mcap") as recorder:
        recorder.add_static_transforms([at(0.0, "scan"), at(0.0, "camera")], 0.0)
        recorder.add_static_transforms([at(1.0, "camera")], 1.0)  # nothing new
        recorder.add_static_transforms([at(2.0, "imu")], 2.0)
        recorder.add_static_transforms([at(3.0, "scan", 0.1)], 3.0)

    with (tmp_path / "recording.mcap").open("rb") as stream:
        found = [
            (item.message.log_time // 10**9, [(each.child_frame_id, each.header.stamp.sec) for each in transforms])
            for item in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
            if (transforms := item.decoded_message.transforms)
        ]
    first = [("scan", 0), ("camera", 0)]
    assert found == [(0, first), (2, [*first, ("imu", 2)]), (3, [("scan", 3), ("camera", 0), ("imu", 2)])]


def readable(path: Path) -> Iterator[Any]:
    """The messages of a file without an end, up to where it stops."""
    with path.open("rb") as stream, suppress(EndOfFile):
        reader = NonSeekingReader(stream, decoder_factories=[DecoderFactory()])
        yield from reader.iter_decoded_messages(log_time_order=False)


def test_a_killed_process_leaves_a_readable_file(tmp_path: Path) -> None:
    path = tmp_path / "recording.mcap"
    script = f"""
import itertools, sys
from pathlib import Path
from prefect_robomaker.tasks.runtime.recording import messages as ros
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder
recorder = McapRecorder(Path({str(path)!r}))
for i in itertools.count():
    header = ros.Header(ros.Time.from_seconds(i * 0.01), "odom")
    recorder.write("/odom", ros.Odometry(header, "base_link", ros.Pose(), ros.Twist()), i * 0.01)
    if i == 2500:
        print("written", flush=True)
"""
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "written\n"
        os.kill(process.pid, signal.SIGKILL)
    count = len(list(readable(path)))
    # Messages of 700 bytes: the chunk that was being filled holds fewer than 1200.
    assert count > 2500 - 1200


@pytest.mark.deep
def test_memory_stays_bounded(tmp_path: Path) -> None:
    with McapRecorder(tmp_path / "recording.mcap") as recorder:
        tracemalloc.start()
        try:
            for i in range(4000):
                for topic, message in one_of_each(i * 0.02).items():
                    recorder.write(topic, message, i * 0.02)
            _, peak = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
    assert peak < 8_000_000  # 14 MB were written


def test_what_comes_slowly_is_written_every_two_seconds_all_the_same(tmp_path: Path) -> None:
    path = tmp_path / "recording.mcap"
    script = f"""
import json, sys, time
from pathlib import Path
import mujoco
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder
from prefect_robomaker.tasks.runtime.recording.state_series import StateSeries
model = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><body><joint name='arm'/><geom size='1'/></body></worldbody></mujoco>")
data = mujoco.MjData(model)
recorder = McapRecorder(Path({str(path)!r}))
series = StateSeries(model, data, [0])
recorder.add_series(series)
times = []
for i in range(24):
    mujoco.mj_step(model, data, 10)
    times.append(time.monotonic())
    series.sample(recorder)
    time.sleep(0.1)
print(json.dumps(times), flush=True)
sys.stdin.read()
"""
    command = [sys.executable, "-c", script]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stdin=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        times = json.loads(process.stdout.readline())
        os.kill(process.pid, signal.SIGKILL)
    old = sum(time_s < times[-1] - 2.0 for time_s in times)
    assert 0 < 2 * old <= len(list(readable(path)))


def test_a_topic_carries_one_type(tmp_path: Path) -> None:
    with McapRecorder(tmp_path / "recording.mcap") as recorder:
        recorder.write("/x", ros.Clock(ros.Time(0, 0)), 0.0)
        with pytest.raises(TypeError, match="topic /x carries Clock, so TFMessage cannot"):
            recorder.write("/x", ros.TFMessage([]), 0.0)
        with pytest.raises(TypeError, match="Header is not a message that can be recorded on a topic \\(/y\\)"):
            recorder.write("/y", header(0.0), 0.0)  # pyright: ignore[reportArgumentType]


def test_a_full_disk_is_named() -> None:
    with pytest.raises(RecordingError, match="recording cannot be written: No space left on device: '/dev/full'"):
        McapRecorder(Path("/dev/full"))


def test_closing_twice_is_harmless(tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path / "recording.mcap")
    recorder.close()
    size = (tmp_path / "recording.mcap").stat().st_size
    recorder.close()
    assert (tmp_path / "recording.mcap").stat().st_size == size > 0


def test_recording_nothing() -> None:
    recorder = Recorder()
    recorder.write("/clock", ros.Clock(ros.Time(0, 0)), 0.0)
    recorder.close()
    assert not recorder.enabled
