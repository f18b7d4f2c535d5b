"""The bridge node between a simulation and ROS 1, with a real master and real nodes of rospy."""

import math
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from helpers.processes import wait_for
from helpers.ros1_nodes import NEEDS_ROS_1, PYTHON, Ros1
from helpers.ros_samples import COMMANDS, clock, grid, odometry, scan, transforms

from prefect_robomaker.tasks.runtime.ros import ros1_bridge as bridge
from prefect_robomaker.tasks.runtime.ros.ros1_wire import Ros1Wire
from prefect_robomaker.tasks.runtime.ros.wire import Command, Peers

pytestmark = [pytest.mark.deep, *NEEDS_ROS_1]


@pytest.fixture
def bridged(ros1: Ros1, socket_path: str, wire: Ros1Wire) -> Iterator["subprocess.Popen[str]"]:
    """A master and the real bridge, in the environment that they have beside a launch."""
    with ros1.master(), running_bridge(ros1, socket_path) as process:
        yield process


@contextmanager
def running_bridge(ros1: Ros1, socket_path: str, name: str = "bridge.log") -> Iterator["subprocess.Popen[str]"]:
    environ = {bridge.SOCKET_VARIABLE: socket_path}
    with ros1.running(name, [PYTHON, bridge.__file__], environ) as process:
        yield process


LISTENER = """
import threading
from geometry_msgs.msg import Twist
from nav_msgs.msg import OccupancyGrid, Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage

def said(message, name):
    if name == "scan":
        print(name, message.header.seq > 0, message.header.stamp.to_sec(), message.header.frame_id, len(message.ranges),
              message.ranges[8], message.range_max)
    elif name == "odom":
        print(name, message.child_frame_id, message.pose.pose.position.y, message.pose.pose.orientation.w,
              message.pose.covariance[35], message.twist.twist.angular.z)
    elif name == "tf":
        print(name, [(each.header.frame_id, each.child_frame_id, each.transform.translation.z)
                     for each in message.transforms])
    elif name == "map":
        print(name, message.info.width, round(message.info.resolution, 3), list(message.data))

for name, kind in dict(tf=TFMessage, odom=Odometry, scan=LaserScan, map=OccupancyGrid).items():
    rospy.Subscriber("/" + name, kind, said, name)
commands = rospy.Publisher("/cmd_vel", Twist, queue_size=10)
rate = rospy.Rate(10)  # of ROS time
while not rospy.is_shutdown():
    rate.sleep()
    print("now", rospy.get_time(), flush=True)
    twist = Twist()
    twist.angular.z = rospy.get_time()
    commands.publish(twist)
"""


def driven(wire: Ros1Wire, done: Callable[[list[Command]], object], from_s: float = 10.0) -> list[Command]:
    """Simulated time at twenty times its speed with all topics, until it is done; returns the commands."""
    commands: list[Command] = []
    now_s = from_s

    def step() -> object:
        nonlocal now_s
        for _ in range(20):
            now_s = round(now_s + 0.05, 3)
            wire.send("/clock", clock(now_s))
            for topic, message in (("/tf", transforms), ("/odom", odometry), ("/scan", scan)):
                wire.send(topic, message(now_s))
            wire.wait(0.0025)
            commands.extend(wire.take())
        return done(commands)

    wait_for(step, "the nodes")
    return commands


def test_a_node_of_rospy_hears_all_topics_in_simulated_time_and_its_commands_come(
    wire: Ros1Wire, ros1: Ros1, bridged: "subprocess.Popen[str]"
) -> None:
    wire.send("/map", grid())  # before there is anybody
    wait_for(lambda: (wire.take(), wire.name)[1] == "ROS 1", "the bridge")
    assert wire.peers() == Peers()

    with ros1.node("robot", LISTENER):
        wait_for(lambda: wire.peers().commanders, "the node")
        commands = driven(wire, lambda commands: len(commands) >= 20 and "map" in ros1.said("robot.log"))

        assert wire.peers() == Peers(frozenset({"/clock", "/tf", "/odom", "/scan", "/map"}), 1)
        said = {line.partition(" ")[0]: line.partition(" ")[2] for line in ros1.said("robot.log").splitlines()}
        assert said["map"] == "3 0.05 [0, 100, -1, 0, 0, 100]"
        assert said["odom"] == "base_link 2.0 0.8 35.0 0.25"
        assert said["tf"] == "[('odom', 'base_link', 3.0), ('base_link', 'base_scan', 3.0)]"
        is_numbered, time_s, *others = said["scan"].split()
        assert is_numbered == "True"
        assert float(time_s) > 10.0
        assert others == ["base_scan", "360", "1.0", "12.0"]
        times_s = [command.angular_radps[2] for command in commands]
        assert times_s == sorted(times_s)
        assert 10.0 <= times_s[0] < 1e6, "a node that took the machine's time would say 2 billion"
    wait_for(lambda: wire.peers() == Peers(), "its end to be seen")
    wire.close()
    wait_for(lambda: "leaves the nodes" in ros1.said("bridge.log"), "the bridge's end")
    wait_for(lambda: "/robomaker_bridge" not in str(ros1.ask("m.getSystemState()")), "its topics to be gone")
    with pytest.raises(subprocess.TimeoutExpired):  # a tool that ends is started again, and counted
        bridged.wait(3.0)


def publisher(ros_type: str, topic: str = "/cmd_vel", rate_hz: float = 20.0, fill: str = "pass") -> str:
    """Code of a node that publishes messages of a type, by the machine's time."""
    package, kind = ros_type.split("/")
    return f"""
import time
from {package}.msg import {kind}
sender = rospy.Publisher({topic!r}, {kind}, queue_size=10)
while not rospy.is_shutdown():
    m = {kind}()
    {fill}
    sender.publish(m)
    time.sleep({1 / rate_hz if rate_hz else 0})
"""


@pytest.mark.usefixtures("bridged")
def test_what_nodes_send_as_commands_is_told_apart_by_its_type(wire: Ros1Wire, ros1: Ros1) -> None:
    stamped = publisher(
        "geometry_msgs/TwistStamped",
        fill="m.header.frame_id = 'base_link'; m.header.stamp = rospy.Time(3, 500000000); m.twist.linear.x = 0.25",
    )
    with (
        ros1.node("stamped", stamped),
        ros1.node("plain", publisher("geometry_msgs/Twist", fill="m.linear.x = float('nan')")),
        ros1.node("wrong", publisher("std_msgs/String", fill="m.data = 'forward' * 20")),
    ):
        wait_for(lambda: (peers := wire.peers()).commanders == 2 and peers.mistyped, "three nodes")
        assert wire.peers().mistyped == {COMMANDS: "std_msgs/String"}
        wire.take()
        found: list[Command] = []
        wait_for(lambda: found.extend(wire.take()) or {each.stamp_s for each in found} == {3.5, None}, "both nodes")
    assert {command.linear_mps[0] for command in found if command.stamp_s == 3.5} == {0.25}
    assert all(math.isnan(command.linear_mps[0]) for command in found if command.stamp_s is None)
    wait_for(lambda: wire.peers() == Peers(), "their end")


def test_what_is_missing_is_named_until_it_is_there(ros1: Ros1, wire: Ros1Wire, socket_path: str) -> None:
    with running_bridge(ros1, socket_path):
        wait_for(lambda: (wire.take(), "waits for the ROS master at http" in wire.name)[1], "what it waits for")
        assert wire.peers() == Peers()
        wire.send("/map", grid())
        with ros1.master(), ros1.node("robot", LISTENER):
            wait_for(lambda: wire.peers().commanders and "map 3" in ros1.said("robot.log"), "the node")
        said = [line for line in ros1.said("bridge.log").splitlines() if "waits for" in line]
    assert [line.split("waits for ")[1].split(" at ")[0] for line in said][-1:] == ["the ROS master"]


def test_a_bridge_that_is_killed_comes_back_with_all_nodes(ros1: Ros1, wire: Ros1Wire, socket_path: str) -> None:
    with ros1.master(use_sim_time=True), ros1.node("robot", LISTENER):
        with running_bridge(ros1, socket_path) as first:
            wire.send("/map", grid(1))
            wait_for(lambda: wire.peers().commanders, "the node")
            driven(wire, lambda commands: len(commands) > 3)
            first.kill()
            wait_for(lambda: wire.peers() == Peers() and "has not come back" in wire.name, "its end to be seen")
            for number in range(100):
                wire.send("/scan", scan(number))  # to nobody
        wire.send("/map", grid(2))
        with running_bridge(ros1, socket_path, "second.log"):
            wait_for(lambda: wire.peers().commanders, "the node again")
            driven(wire, lambda commands: len(commands) > 3 and "[0, 2, -1" in ros1.said("robot.log"), from_s=100.0)
    assert wire.connections == 2


@pytest.mark.usefixtures("bridged")
def test_nodes_that_flood_or_hang_hold_neither_bridge_nor_simulation_up(wire: Ros1Wire, ros1: Ros1) -> None:
    with (
        ros1.node("flood", publisher("geometry_msgs/Twist", rate_hz=0, fill="m.linear.x = time.monotonic()")),
        ros1.node("robot", LISTENER) as robot,
    ):
        wait_for(lambda: wire.peers().commanders == 2 and "/scan" in wire.peers().heard, "both nodes")
        robot.send_signal(signal.SIGSTOP)
        longest_s, seen = 0.0, 0
        for number in range(3000):  # 4.5 MB for a node that reads nothing
            began_s = time.monotonic()
            wire.send("/scan", scan(number))
            longest_s = max(longest_s, time.monotonic() - began_s)
            seen += len(wire.take())
            wire.wait(0.001)
        robot.send_signal(signal.SIGCONT)
        assert seen > 100
        assert longest_s < 30.0, "one that waits for the node waits for ever"
        latest = wait_for(wire.take, "commands")[-1]
        assert time.monotonic() - latest.linear_mps[0] < 60.0
        wait_for(lambda: wire.send("/scan", scan(5000.0)) or "5000.0 base_scan" in ros1.said("robot.log"), "the node")


def test_what_is_there_without_a_robot_is_no_node_of_one(ros1: Ros1, wire: Ros1Wire, socket_path: str) -> None:
    listener = 'rospy.Subscriber("/scan", rospy.AnyMsg, print)\nrospy.spin()\n'
    with (
        ros1.master(use_sim_time=False),
        running_bridge(ros1, socket_path),
        ros1.node("record_1764396000000000000", listener),
        ros1.node("robomaker_job_services", listener),
    ):
        wait_for(lambda: (wire.take(), wire.name)[1] == "ROS 1", "the bridge")
        with ros1.node("robot", LISTENER.replace("rate.sleep()", "rospy.sleep(0.05)")):
            wait_for(lambda: wire.peers().commanders, "the robot")
            wait_for(lambda: "/use_sim_time to false" in ros1.said("bridge.log"), "what the bridge says of it")
            assert "/clock" not in wire.peers().heard
        wait_for(lambda: wire.peers().commanders == 0, "its end")
        master = "len([n for t, ns in m.getSystemState()[1] if t == '/scan' for n in ns])"
        assert int(str(ros1.ask(master))) >= 2, "they subscribe"
        # rospy notices that a subscriber has left when it sends to it.
        wait_for(lambda: wire.send("/scan", scan(1.0)) or "/scan" not in wire.peers().heard, "its end on this topic")
