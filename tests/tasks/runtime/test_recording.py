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

from prefect_robomaker.tasks.runtime import messages as ros
from prefect_robomaker.tasks.runtime.recording import McapRecorder, NullRecorder, RecordingError


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
            message = reader.deserialize(raw, connection.msgtype)
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


def test_a_player_keeps_static_transforms_for_those_who_come_later(tmp_path: Path) -> None:
    path = tmp_path / "recording.mcap"
    with McapRecorder(path) as recorder:
        recorder.write("/tf_static", ros.TFMessage([]), 0.0)
        recorder.write("/clock", ros.Clock(ros.Time.from_seconds(0.0)), 0.0)

    with AnyReader([path]) as reader:
        offered = {connection.topic: connection.ext.offered_qos_profiles[0] for connection in reader.connections}

    assert offered["/tf_static"].durability.name == "TRANSIENT_LOCAL"
    assert offered["/clock"].durability.name == "VOLATILE"


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
from prefect_robomaker.tasks.runtime import messages as ros
from prefect_robomaker.tasks.runtime.recording import McapRecorder
recorder = McapRecorder(Path({str(path)!r}))
for i in itertools.count():
    header = ros.Header(ros.Time.from_seconds(i * 0.01), "odom")
    recorder.write("/odom", ros.Odometry(header, "base_link", ros.Pose(), ros.Twist()), i * 0.01)
    if i == 5000:
        print("written", flush=True)
"""
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "written\n"
        os.kill(process.pid, signal.SIGKILL)
    count = len(list(readable(path)))
    # Messages of 700 bytes: the chunk that was being filled holds fewer than 1200.
    assert count > 5000 - 1200


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
import sys, time
from pathlib import Path
import mujoco
from prefect_robomaker.tasks.runtime.recording import McapRecorder
from prefect_robomaker.tasks.runtime.state_series import StateSeries
model = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><body><joint name='arm'/><geom size='1'/></body></worldbody></mujoco>")
data = mujoco.MjData(model)
recorder = McapRecorder(Path({str(path)!r}))
series = StateSeries(model, data, [0])
recorder.add_series(series)
for i in range(24):
    mujoco.mj_step(model, data, 10)
    series.sample(recorder)
    time.sleep(0.1)
print("sampled", flush=True)
sys.stdin.read()
"""
    command = [sys.executable, "-c", script]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stdin=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "sampled\n"
        os.kill(process.pid, signal.SIGKILL)
    assert 2 * 19 <= len(list(readable(path))) < 2 * 24


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
    recorder = NullRecorder()
    recorder.write("/clock", ros.Clock(ros.Time(0, 0)), 0.0)
    recorder.close()
    assert not recorder.enabled
