"""The way to nodes of ROS 1: bridges here are sockets of tests; real ones are in `test_ros1_bridge.py`."""

import json
import math
import socket
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import pytest
from helpers.processes import wait_for
from helpers.ros_samples import COMMANDS, TOPICS, clock, grid, scan

from prefect_robomaker.schemas.runs.plan import RunPlan
from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.runtime.agents.agent_socket import ROS1_SOCKET, agent_socket_path
from prefect_robomaker.tasks.runtime.ros import ros1_bridge as bridge
from prefect_robomaker.tasks.runtime.ros.ros1_wire import Ros1Wire, ros1_definition
from prefect_robomaker.tasks.runtime.ros.wire import Command, Peers, Topic

MakePlan = Callable[..., RunPlan]


@pytest.fixture
def connected(socket_path: str, wire: Ros1Wire) -> Iterator[socket.socket]:
    """A bridge's side, which the wire has greeted."""
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(socket_path)
        connection.settimeout(200)
        wire.take()
        yield connection


def frame(kind: int, content: bytes) -> bytes:
    return bridge.HEADER.pack(len(content), kind) + content


def state(**members: Any) -> bytes:
    about = {"heard": [], "commanders": 0, "mistyped": {}, **members}
    return frame(bridge.STATE, json.dumps(about).encode())


def command(*values: float) -> bytes:
    return frame(bridge.COMMAND, bridge.VELOCITY.pack(*values))


def received(connection: socket.socket, count: int) -> list[tuple[int, bytes]]:
    """The next frames that the wire has sent."""
    with connection.makefile("rb") as file:
        found = []
        for _ in range(count):
            length, kind = bridge.HEADER.unpack(file.read(bridge.HEADER.size))
            found.append((kind, file.read(length)))
        return found


@pytest.mark.parametrize(
    ("ros_type", "md5sum"),
    [
        ("geometry_msgs/msg/PoseStamped", "d3812c3cbc69362b77dc0b19b345f8f5"),
        ("geometry_msgs/msg/Twist", "9f195f881246fdfa2798d1d3eebca84a"),
        ("geometry_msgs/msg/TwistStamped", "98d34b0043a2093cf9d9345ab6eef12e"),
        ("nav_msgs/msg/OccupancyGrid", "3381f2d731d4076ec5c71b0759edbe4e"),
        ("nav_msgs/msg/Odometry", "cd5e73d190d741a2f92e81eda573aca7"),
        ("rosgraph_msgs/msg/Clock", "a9c97c1d230cfc112e270351a944ee47"),
        ("sensor_msgs/msg/CameraInfo", "c9a58c1b0b154e0e6da7578cb991d214"),
        ("sensor_msgs/msg/CompressedImage", "8f7a12909da2c9d3332d540a0977563f"),
        ("sensor_msgs/msg/Image", "060021388200f6f0f447d0fcd9c64743"),
        ("sensor_msgs/msg/Imu", "6a62c6daae103f4ff57a132d6f95cec2"),
        ("sensor_msgs/msg/JointState", "3066dcd76a6cfaef579bd0f34173e9fd"),
        ("sensor_msgs/msg/LaserScan", "90c7ef2dc6895d81024acba2ac42f369"),
        ("tf2_msgs/msg/TFMessage", "94810edda583a504dfda3829e70d7eec"),
    ],
)
def test_types_have_the_sums_by_which_nodes_of_ros_1_know_them(ros_type: str, md5sum: str) -> None:
    assert ros1_definition(ros_type)[1] == md5sum
    known = bridge.COMMAND_TYPES.get(ros_type.replace("/msg/", "/"), md5sum)
    assert known == md5sum


@pytest.mark.parametrize(
    ("ros_type", "message"),
    [
        ("visualization_msgs/msg/MarkerArray", "other fields in ROS 1"),
        ("rcl_interfaces/msg/Log", "ROS 1 has no type rcl_interfaces/Log"),
    ],
)
def test_what_ros_1_would_read_otherwise_is_refused(make_plan: MakePlan, ros_type: str, message: str) -> None:
    plan = make_plan()
    with pytest.raises(LaunchError, match=message):
        Ros1Wire(plan).open([Topic("/markers", ros_type)], COMMANDS)
    assert not agent_socket_path(plan, ROS1_SOCKET).exists()


def test_nothing_waits_for_a_bridge_that_is_not_there(wire: Ros1Wire) -> None:
    for number in range(1000):
        wire.send("/clock", clock(number))
    assert wire.take() == []
    assert wire.peers() == Peers()
    assert not wire.wait(0.0)
    assert "has not connected yet" in wire.name
    wire.close()
    wire.close()
    wire.send("/clock", clock(1.0))  # as a run does whose end comes between two topics
    assert not wire.wait(0.001)


def test_a_bridge_is_greeted_with_all_it_needs(wire: Ros1Wire, connected: socket.socket) -> None:
    ((kind, content),) = received(connected, 1)
    hello = json.loads(content)
    assert kind == bridge.HELLO
    assert hello["command_topic"] == COMMANDS
    assert [(topic["name"], topic["type"], topic["latched"], topic["depth"]) for topic in hello["topics"]] == [
        ("/clock", "rosgraph_msgs/Clock", False, 10), ("/tf", "tf2_msgs/TFMessage", False, 100),
        ("/odom", "nav_msgs/Odometry", False, 10), ("/scan", "sensor_msgs/LaserScan", False, 10),
        ("/map", "nav_msgs/OccupancyGrid", True, 1),
    ]  # fmt: skip
    connected.sendall(frame(bridge.STATE, b'{"waits_for":"the ROS master at http://x"}'))
    assert wire.peers() == Peers()
    assert wire.name == "ROS 1, whose bridge waits for the ROS master at http://x"
    connected.sendall(state(heard=["/scan", "/other"], commanders=1, mistyped={COMMANDS: "std_msgs/String"}))
    assert wire.peers() == Peers(frozenset({"/scan"}), 1, {COMMANDS: "std_msgs/String"})
    assert wire.name == "ROS 1"


def test_commands_come_in_their_order_and_with_their_stamps(wire: Ros1Wire, connected: socket.socket) -> None:
    assert not wire.wait(0.0)
    connected.sendall(command(1, 2, 3, 4, 5, 6, math.nan) + command(0.5, 0, 0, 0, 0, math.nan, 1.25))
    assert wire.wait(200.0)
    first, second = wire.take()
    assert first == Command((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
    assert math.isnan(second.angular_radps[2]), "the robot interface judges, not the wire"
    assert second.stamp_s == 1.25
    assert wire.take() == []


def test_a_flood_of_commands_holds_nothing_up_and_the_newest_stay(wire: Ros1Wire, connected: socket.socket) -> None:
    connected.setblocking(False)
    sent, taken, looks = 0, [], 0
    while sent < 20_000:
        with suppress(BlockingIOError):
            while sent < 20_000:
                connected.sendall(command(sent, 0, 0, 0, 0, 0, math.nan))
                sent += 1
        wire.peers()  # looks, and takes nothing
        looks += 1
        assert len(wire._commands) <= 1000
    while batch := wire.take():
        taken += batch
    assert taken[-1].linear_mps[0] == sent - 1
    numbers = [each.linear_mps[0] for each in taken]
    assert numbers == sorted(numbers)


def test_a_bridge_that_reads_nothing_loses_the_oldest_and_no_time(wire: Ros1Wire, connected: socket.socket) -> None:
    wire.send("/map", grid(1))
    for number in range(2000):  # 3 MB, many times what the socket holds
        wire.send("/scan", scan(number))
        wire.send("/clock", clock(number))
        wire.send("/map", grid(number % 100))
    lost = dict(wire.dropped)
    assert lost["/scan"] > 1000
    assert "/map" not in lost, "the last map is all that counts"

    connected.setblocking(False)
    arrived = b""
    while wire._link is not None:
        try:
            arrived += connected.recv(1 << 20)
        except BlockingIOError:
            if not wire._link.is_behind:
                break
            wire.take()  # sends what there is room for
    frames = list(_frames_in(arrived))
    scans = [_stamp_of(content) for kind, content in frames if kind == bridge.MESSAGE and _topic_of(content) == "/scan"]
    assert scans == sorted(scans)
    assert scans[-10:] == list(range(1990, 2000)), "the newest of each topic are there"
    assert len(scans) + lost["/scan"] == 2000


def _frames_in(data: bytes) -> Iterator[tuple[int, bytes]]:
    while data:
        length, kind = bridge.HEADER.unpack_from(data)
        yield kind, data[bridge.HEADER.size : bridge.HEADER.size + length]
        data = data[bridge.HEADER.size + length :]


def _topic_of(content: bytes) -> str:
    return TOPICS[bridge.TOPIC.unpack_from(content)[0]].name


def _stamp_of(content: bytes) -> int:
    return struct.unpack_from("<II", content, bridge.TOPIC.size)[1]


def test_a_bridge_that_comes_later_or_again_gets_what_is_latched(wire: Ros1Wire, socket_path: str) -> None:
    wire.send("/map", grid(1))
    wire.send("/scan", scan(1.0))
    wire.send("/map", grid(2))
    for _ in range(2):
        with socket.socket(socket.AF_UNIX) as connection:
            connection.connect(socket_path)
            connection.sendall(state(heard=["/map"], commanders=2))
            wait_for(lambda: wire.peers().commanders == 2, "the bridge")
            connection.settimeout(200)
            hello, (kind, content) = received(connection, 2)
            assert hello[0] == bridge.HELLO
            assert kind == bridge.MESSAGE
            assert _topic_of(content) == "/map"
            assert content[-1] == 2
            with socket.socket(socket.AF_UNIX) as second:
                second.connect(socket_path)
                second.settimeout(200)
                wire.take()
                assert second.recv(1) == b"", "one bridge is enough"
        assert wire.peers() == Peers(), "nodes are not known without it"
        assert "ended and has not come back" in wire.name
    assert wire.connections == 2


@pytest.mark.parametrize(
    "hostile",
    [
        b"GET / HTTP/1.1\r\n\r\n" * 10,
        frame(bridge.MESSAGE, b"x"),
        bridge.HEADER.pack(2**32 - 1, bridge.STATE),
        bridge.HEADER.pack(57, bridge.COMMAND),
        frame(bridge.COMMAND, b"short"),
        frame(bridge.STATE, b"\xff"),
        frame(bridge.STATE, b"[" * 60_000),
        frame(bridge.STATE, b"[]"),
        frame(bridge.STATE, b"{}"),
        state(heard="all"),
        state(heard=[{}]),
        state(mistyped=[1]),
        state(commanders="many"),
        bridge.HEADER.pack(1000, bridge.STATE) + b"cut off",
    ],
)
def test_hostile_frames_end_the_connection_and_not_the_run(
    wire: Ros1Wire, socket_path: str, connected: socket.socket, hostile: bytes
) -> None:
    connected.sendall(hostile)
    connected.shutdown(socket.SHUT_WR)
    wait_for(lambda: "ended" in (wire.peers(), wire.name)[1], "its end")
    assert wire.take() == []
    with socket.socket(socket.AF_UNIX) as another:
        another.connect(socket_path)
        another.sendall(state(commanders=1))
        wait_for(lambda: wire.peers().commanders == 1, "the next bridge")


def test_publishers_are_told_apart_and_one_that_has_said_nothing_is_none() -> None:
    connections = [
        SimpleNamespace(type=None, md5sum=None),
        SimpleNamespace(type="std_msgs/String", md5sum="992ce8a1687cec8c8bd883ec73ca41d1"),
        SimpleNamespace(type="geometry_msgs/Twist", md5sum="0"),
        *(SimpleNamespace(type=name, md5sum=md5sum) for name, md5sum in bridge.COMMAND_TYPES.items()),
    ]
    assert bridge.commanders_in(connections) == (
        2,
        ["geometry_msgs/Twist of another definition, whose MD5 sum is 0", "std_msgs/String"],
    )


@pytest.mark.parametrize("ros_type", list(bridge.COMMAND_TYPES))
@pytest.mark.parametrize("content", [b"", b"\0" * 47, b"\xff" * 200])
def test_commands_that_are_cut_off_are_no_numbers(ros_type: str, content: bytes) -> None:
    assert all(map(math.isnan, bridge.velocity_in(ros_type, content)))
