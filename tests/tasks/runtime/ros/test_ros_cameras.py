"""Pictures, depths and points of a camera, as nodes of a real ROS 2 and of a script get them."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import math
import os
import subprocess
from collections.abc import Callable
from copy import copy
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from helpers.processes import wait_for
from helpers.rclpy_nodes import rclpy as rclpy  # a fixture
from helpers.scripted_wire import ScriptedWire

from prefect_robomaker.schemas.runs.ros_options import RosOptions, RosPlan
from prefect_robomaker.tasks.runtime.applications.indoor_navigation import make_environment
from prefect_robomaker.tasks.runtime.recording.cdr import decode
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder, Recorder
from prefect_robomaker.tasks.runtime.ros import ros_robot
from prefect_robomaker.tasks.runtime.ros.bridge_recorder import TOPICS
from prefect_robomaker.tasks.runtime.ros.ros_robot import RosBridge
from prefect_robomaker.tasks.runtime.ros.wire import Command, Peers
from prefect_robomaker.tasks.runtime.video.camera_recorder import CameraRecorder
from prefect_robomaker.tasks.runtime.video.video_settings import CameraRecording
from prefect_robomaker.tasks.simulations.ros.ros_domains import own_domain

RAW, DEPTH, POINTS = "/camera/image_raw", "/camera/depth/image_raw", "/camera/depth/points"
INFO, DEPTH_INFO, JPEG = "/camera/camera_info", "/camera/depth/camera_info", "/camera/image_raw/compressed"
FOR_NODES = CameraRecording(None, is_recorded=False)

NODE = """
import sys, numpy, rclpy
from pathlib import Path
from geometry_msgs.msg import Twist
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
folder = Path(sys.argv[1])
rclpy.init()
node = rclpy.create_node("looker")
commands = node.create_publisher(Twist, "/cmd_vel", 10)
def turn():
    command = Twist()
    command.angular.z = 0.3
    commands.publish(command)
def keep(name, message, **arrays):
    stamp = message.header.stamp
    place = folder / f"{name}-{stamp.sec * 10**9 + stamp.nanosec}.npz"
    numpy.savez(folder / "half.npz", frame=message.header.frame_id, **arrays)
    (folder / "half.npz").rename(place)
def pixels(message):
    kind = {"rgb8": "u1", "32FC1": "<f4", "16UC1": "<u2"}[message.encoding]
    found = numpy.frombuffer(bytes(message.data), kind)
    assert message.step == found.nbytes // message.height
    return found.reshape(message.height, message.width, -1)
def cloud(message):
    fields = [(each.name, each.offset, each.datatype) for each in message.fields]
    assert fields == [("x", 0, 7), ("y", 4, 7), ("z", 8, 7)]
    return numpy.frombuffer(bytes(message.data), "<f4").reshape(message.height, message.width, 3)
node.create_timer(0.1, turn)
kept = [
    node.create_subscription(Image, "/camera/image_raw", lambda m: keep("raw", m, data=pixels(m)), 10),
    node.create_subscription(Image, "/camera/depth/image_raw", lambda m: keep("depth", m, data=pixels(m)), 10),
    node.create_subscription(PointCloud2, "/camera/depth/points", lambda m: keep("points", m, data=cloud(m)), 10),
    node.create_subscription(CameraInfo, "/camera/depth/camera_info", lambda m: keep("info", m, k=m.k), 10),
]
rclpy.spin(node)
"""


class Seen:
    """A run in the hand-written flat with a camera for nodes."""

    def __init__(self, make_context: Any, recorder: Recorder, camera: CameraRecording, domain: int, **options: Any):
        plan = SimpleNamespace(ros=RosPlan(suite=2, domain=domain, options=RosOptions.model_validate(options)))
        self.bridge = RosBridge(plan, "looker", recorder)  # pyright: ignore[reportArgumentType]
        self.environment = make_environment(make_context(recorder=self.bridge.recorder))
        self.camera = CameraRecorder(self.bridge.recorder, camera, None, lambda: self.bridge.options)
        self.bridge.look_in(self.environment)
        self.states: dict[int, mujoco.MjData] = {}
        """States by the stamps of pictures, nanoseconds."""
        self.pictures: dict[int, Any] = {}

    def begin(self) -> None:
        stop = SimpleNamespace(reason="")
        self.agent = self.bridge.make_agent(self.environment, stop, lambda _: None)
        self.timestep = self.environment.reset()
        self.look()

    def go(self) -> None:
        self.timestep = self.environment.step(self.agent(self.timestep))
        self.look()

    def look(self) -> None:
        data = self.environment.physics.data
        if data.time >= self.camera.next_time_s - 5e-7:
            self.states[round(data.time * 1e9)] = copy(data.ptr)
            self.camera.watch(self.environment, data.time)
            if self.camera._renderer is not None:
                self.pictures[round(data.time * 1e9)] = self.camera._renderer.picture(data.ptr)


def rays_m(model: mujoco.MjModel, data: mujoco.MjData, k: Any, pixels: Any) -> list[float]:
    """Depths of some pixels, row and column, by MuJoCo's own rays, one at a time, from the robot's front camera."""
    camera = next(n for n in range(model.ncam) if model.camera(n).name.endswith("front"))
    axes, eye = data.cam_xmat[camera].reshape(3, 3), data.cam_xpos[camera]
    housing = int(model.cam_bodyid[camera])  # which the camera looks out of
    shown = np.array([1, 1, 1, 0, 0, 0], np.uint8)
    found = []
    for row, column in pixels:
        way = axes @ np.array([(column - k[2]) / k[0], -(row - k[5]) / k[4], -1.0])
        length = float(np.linalg.norm(way))
        away = mujoco.mj_ray(model, data, eye, way / length, shown, True, housing, np.zeros(1, np.int32), None)
        found.append(away / length if away >= 0 else math.inf)
    return found


@pytest.mark.deep
@pytest.mark.timeout(900)
def test_a_node_of_ros_reads_the_pixels_depths_and_points_that_the_simulation_has(
    make_context: Callable[..., Any], tmp_path: Path, rclpy: Path
) -> None:
    with own_domain(f"test-{os.getpid()}") as domain:
        environ = {**os.environ, "ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        node = subprocess.Popen([rclpy, "-c", NODE, str(tmp_path)], env=environ)
        seen = Seen(make_context, Recorder(), FOR_NODES, domain)
        try:
            wait_for(seen.bridge.came, "the node")
            seen.begin()

            def is_there() -> bool:
                assert node.poll() is None, "the node ended"
                seen.go()
                return len(whole(tmp_path)) >= 3

            wait_for(is_there, "three pictures with depths, points and camera_info")
        finally:
            node.kill()
            node.wait()
            found = seen.bridge.close("canceled").extra["ros"]
    assert set(found["heard"]) == {RAW, DEPTH, POINTS, DEPTH_INFO}
    assert JPEG not in found["sent"], "nobody asked for it"
    model = seen.environment.physics.model.ptr
    generator = np.random.default_rng(1)
    for stamp in whole(tmp_path)[:3]:
        raw, depth, points, info = (
            np.load(tmp_path / f"{name}-{stamp}.npz") for name in ("raw", "depth", "points", "info")
        )
        assert {str(each["frame"]) for each in (raw, depth, points, info)} == {"camera_optical_frame"}
        assert np.array_equal(raw["data"], seen.pictures[stamp])
        depths_m = depth["data"][..., 0]
        pixels = generator.integers(0, (240, 320), (300, 2))
        expected = np.array(rays_m(model, seen.states[stamp], info["k"], pixels))
        measured = depths_m[pixels[:, 0], pixels[:, 1]]
        assert np.isfinite(measured).sum() > 100
        # The node's camera_info has rays meet what the simulation saw there, but at edges, within a float's rounding.
        assert (np.isclose(measured, expected, rtol=1e-3)).mean() > 0.97
        rows, columns = np.mgrid[:240, :320]
        is_seen = np.isfinite(depths_m)
        assert np.array_equal(np.isfinite(points["data"][..., 2]), is_seen)
        x, y, z = points["data"][is_seen].T
        assert np.array_equal(z, depths_m[is_seen])
        assert np.allclose(info["k"][0] * x / z + info["k"][2], columns[is_seen], atol=1e-3)
        assert np.allclose(info["k"][4] * y / z + info["k"][5], rows[is_seen], atol=1e-3)


def whole(folder: Path) -> list[int]:
    """Stamps of which all four messages are there."""
    names = {path.stem for path in folder.glob("*.npz")}
    stamps = sorted(int(name.partition("-")[2]) for name in names if name.startswith("raw-"))
    return [stamp for stamp in stamps if {f"{name}-{stamp}" for name in ("depth", "points", "info")} <= names]


@pytest.fixture
def scripted(make_context: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[Seen, Any]]:
    """A run whose nodes are a script that listens to some topics."""

    def make(heard: Callable[[float], set[str]], recorder: Recorder | None = None, **options: Any) -> tuple[Seen, Any]:
        commands = [(0.05 * number, Command((0.1, 0.0, 0.0), (0.0, 0.0, 0.2))) for number in range(400)]
        wire = ScriptedWire(commands, peers=lambda now_s: Peers(frozenset(heard(now_s)), commanders=1))
        monkeypatch.setattr(ros_robot, "make_wire", lambda *_: wire)
        camera = CameraRecording(5.0) if recorder is not None else FOR_NODES
        seen = Seen(make_context, recorder or Recorder(), camera, 7, time="free", **options)
        seen.bridge._clock = wire.clock
        while not seen.bridge.came():
            wire.now_s += 0.1
        seen.begin()
        return seen, wire

    return make


def stamps_s(wire: ScriptedWire, topic: str) -> list[float]:
    stamps = [decode(data, TOPICS[topic].ros_type).header.stamp for _, name, data in wire.sent if name == topic]
    return [stamp.sec + stamp.nanosec * 1e-9 for stamp in stamps]


def test_pictures_are_made_where_a_node_listens_and_after_the_transforms_of_their_stamp(scripted) -> None:
    seen, wire = scripted(lambda now_s: {"/tf", RAW, DEPTH_INFO} if 2.0 <= now_s < 4.0 else {"/tf"})
    for _ in range(100):
        seen.go()
    assert {topic for _, topic, _ in wire.sent if topic.startswith("/camera")} == {RAW, DEPTH_INFO}
    times = [at_s for at_s, topic, _ in wire.sent if topic == RAW]
    assert 2.0 <= min(times) < 2.8
    assert 3.5 < max(times) <= 4.6
    stamps = stamps_s(wire, RAW)
    assert np.diff(stamps) == pytest.approx(0.2), "five a second of simulated time"
    order = [topic for _, topic, _ in wire.sent]
    for number in [index for index, topic in enumerate(order) if topic == RAW]:
        assert "/tf" in order[number - 3 : number]
    frames = [each.child_frame_id for each in decode(last(wire, "/tf_static"), "tf2_msgs/msg/TFMessage").transforms]
    assert {"camera_link", "camera_optical_frame"} <= set(frames)


def last(wire: ScriptedWire, topic: str) -> bytes:
    return [data for _, name, data in wire.sent if name == topic][-1]


def test_nothing_is_drawn_for_nobody(scripted) -> None:
    seen, wire = scripted(lambda _: {"/scan", "/clock"})
    for _ in range(20):
        seen.go()
    assert seen.camera._renderer is None
    assert not [topic for _, topic, _ in wire.sent if topic.startswith("/camera")]


def test_a_recording_has_the_same_bytes_whether_nodes_look_or_not(scripted, tmp_path: Path) -> None:
    recordings = []
    for name, heard in (("looked", {JPEG, INFO, RAW, DEPTH}), ("alone", set[str]())):
        (tmp_path / name).mkdir()
        recorder = McapRecorder(tmp_path / name / "recording.mcap")
        seen, wire = scripted(lambda _, heard=heard: heard, recorder)
        for _ in range(10):
            seen.go()
        recorder.close()
        assert {topic for _, topic, _ in wire.sent if topic.startswith("/camera")} == heard
        recordings.append(recorder.topics)
        assert {JPEG, INFO} <= recorder.topics
    assert recordings[0] == recordings[1], "raw pictures and depths would be most of a recording"


def test_depths_in_millimetres_are_those_in_metres(scripted) -> None:
    found = {}
    for encoding in ("32FC1", "16UC1"):
        seen, wire = scripted(lambda _: {DEPTH}, depth_encoding=encoding)
        seen.go()
        message = decode(last(wire, DEPTH), "sensor_msgs/msg/Image")
        kind = {"32FC1": "<f4", "16UC1": "<u2"}[encoding]
        assert (message.encoding, message.step) == (encoding, 320 * np.dtype(kind).itemsize)
        found[encoding] = np.frombuffer(message.data.tobytes(), kind)
    metres = found["32FC1"]
    is_seen = np.isfinite(metres)
    assert np.abs(found["16UC1"][is_seen] / 1000 - metres[is_seen]).max() <= 0.00051
    assert not found["16UC1"][~is_seen].any()
