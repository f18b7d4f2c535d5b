import os
import time
from collections.abc import Iterator
from importlib import metadata
from typing import Any

import numpy as np
import pytest
from helpers.processes import wait_for

from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.runtime.recording import messages as ros
from prefect_robomaker.tasks.runtime.recording.cdr import decode, encode, fields_of
from prefect_robomaker.tasks.runtime.ros import dds
from prefect_robomaker.tasks.runtime.ros.bridge_recorder import TOPICS
from prefect_robomaker.tasks.runtime.ros.dds import Participant, Reach, configuration, dds_type_name, ros_type_name
from prefect_robomaker.tasks.runtime.ros.dds_wire import TWIST, TWIST_STAMPED, DdsWire
from prefect_robomaker.tasks.runtime.ros.wire import Command, Topic
from prefect_robomaker.tasks.simulations.ros.ros_domains import own_domain

SCAN = ros.LaserScan(
    ros.Header(ros.Time(1, 2), "base_scan"), -3.0, 3.0, 0.1, 0.0, 0.2, 0.06, 3.5, np.arange(7, dtype=np.float32)
)


@pytest.fixture
def domain() -> Iterator[int]:
    with own_domain(f"test-{os.getpid()}") as number:
        yield number


def test_messages_go_out_and_commands_come_in(domain: int) -> None:
    wire, node = DdsWire(domain, Reach()), Participant(domain, Reach())
    late = None
    try:
        wire.open([Topic("/scan", "sensor_msgs/msg/LaserScan"), TOPICS["/map"]], "/cmd_vel")
        scans = node.reader("/scan", "sensor_msgs/msg/LaserScan", is_reliable=True)
        twists = node.writer("/cmd_vel", TWIST, is_latched=False, depth=10)
        stamped = node.writer("/cmd_vel", TWIST_STAMPED, is_latched=False, depth=10)
        wire.send(
            "/map", encode(ros.OccupancyGrid(ros.Header(ros.Time(0, 0), "map"), 0.05, 3, 2, ros.Pose(), bytes(6)))
        )
        wait_for(lambda: wire.peers().commanders == 2 and "/scan" in wire.peers().heard and twists.readers, "peers")
        wire.send("/scan", encode(SCAN))  # 4 bytes more than a multiple of 8, 2 more than one of 4
        waiter = node.waiter([scans])
        wait_for(lambda: waiter.wait(1.0), "the scan")
        [(data, _)] = list(scans.take())
        assert decode(data, "sensor_msgs/msg/LaserScan").ranges.tolist() == SCAN.ranges.tolist()
        twists.write(encode_twist(0.3, 0.5))
        wait_for(lambda: wire.wait(1.0), "the command")
        assert wire.take() == [Command((0.3, 0.0, 0.0), (0.0, 0.0, 0.5))]
        assert wire.take() == []
        stamped.write(encode_stamped(0.1, 2.5))
        wait_for(lambda: wire.wait(1.0), "the command")
        assert wire.take() == [Command((0.1, 0.0, 0.0), (0.0, 0.0, 0.0), 2.5)]
        late = node.reader("/map", "nav_msgs/msg/OccupancyGrid", is_reliable=True, is_latched=True, depth=1)
        found: list[bytes] = []
        wait_for(lambda: found.extend(data for data, _ in late.take()) or found, "the map")
        assert decode(found[0], "nav_msgs/msg/OccupancyGrid").info.width == 3
    finally:
        node.close()
        wire.close()
        wire.close()  # harmless


def test_publishers_of_other_types_are_told(domain: int) -> None:
    wire, node = DdsWire(domain, Reach()), Participant(domain, Reach())
    try:
        wire.open([], "/cmd_vel")
        writer = node.writer("/cmd_vel", "std_msgs/msg/String", is_latched=False, depth=1)
        wait_for(lambda: wire.peers().mistyped, "the publisher")
        assert wire.peers().mistyped == {"/cmd_vel": "std_msgs/msg/String"}
        assert wire.peers().commanders == 0
        told = [each for each in node.publications() if each.participant == node.prefix]
        assert [(each.topic, each.is_reliable, each.is_latched) for each in told] == [("/cmd_vel", True, False)]
        assert told[0].type_hash.startswith("RIHS01_")
        del writer
    finally:
        node.close()
        wire.close()


def test_velocity_commands_on_another_topic_are_told(domain: int) -> None:
    wire, node = DdsWire(domain, Reach()), Participant(domain, Reach())
    try:
        wire.open([], "/cmd_vel")
        writer = node.writer("/robot/cmd_vel", "geometry_msgs/msg/Twist", is_latched=False, depth=1)
        wait_for(lambda: wire.peers().elsewhere, "the publisher")
        assert wire.peers().elsewhere == {"/robot/cmd_vel": "geometry_msgs/msg/Twist"}
        assert wire.peers().mistyped == {}
        del writer
    finally:
        node.close()
        wire.close()


def test_a_program_that_speaks_dds_without_ros_is_no_node_of_ros(domain: int) -> None:
    wire, node = DdsWire(domain, Reach()), Participant(domain, Reach())
    try:
        wire.open([], "/cmd_vel")
        commands = node.writer("/cmd_vel", "geometry_msgs/msg/Twist", is_latched=False, depth=1)
        wait_for(lambda: wire.peers().commanders, "the publisher")
        assert not wire.peers().has_ros_nodes
        log = node.writer("/rosout", "rcl_interfaces/msg/Log", is_latched=True, depth=1)
        wait_for(lambda: wire.peers().has_ros_nodes, "the node's log")
        del commands, log
    finally:
        node.close()
        wire.close()


def test_lockstep_says_that_it_cannot_hear_best_effort(domain: int) -> None:
    wire, node = DdsWire(domain, Reach(), is_reliable=True), Participant(domain, Reach())
    try:
        wire.open([], "/cmd_vel")
        writer = best_effort_writer(node)
        wait_for(lambda: wire.peers().mistyped, "the publisher")
        assert wire.peers().mistyped == {"/cmd_vel": "best effort geometry_msgs/msg/Twist"}
        del writer
    finally:
        node.close()
        wire.close()


def best_effort_writer(node: Participant) -> Any:
    from cyclonedds.pub import DataWriter
    from cyclonedds.qos import Policy, Qos
    from cyclonedds.topic import Topic as DdsTopic

    kind = dds.idl_type(TWIST, {})
    return DataWriter(node.entity, DdsTopic(node.entity, "rt/cmd_vel", kind), qos=Qos(Policy.Reliability.BestEffort))


def test_users_configuration_is_kept_and_ours_added(domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    theirs = '<CycloneDDS><Domain Id="any"><Tracing><Verbosity>none</Verbosity></Tracing></Domain></CycloneDDS>'
    monkeypatch.setenv("CYCLONEDDS_URI", theirs)
    Participant(domain, Reach()).close()
    assert os.environ["CYCLONEDDS_URI"] == theirs
    assert 'name="lo"' in configuration(Reach())
    assert 'Address="10.0.0.7"' in configuration(Reach(("10.0.0.7",), "eth0"))
    assert 'name="eth0"' in configuration(Reach((), "eth0"))


def test_an_interface_that_is_not_there_is_named(domain: int) -> None:
    with pytest.raises(LaunchError, match=rf"ROS domain {domain} cannot be joined.*interface nothing7 has to be up"):
        Participant(domain, Reach((), "nothing7"))


def test_another_release_and_none_are_refused_with_what_to_type(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dds.metadata, "version", lambda _: "0.10.5")
    with pytest.raises(LaunchError, match=r"cyclonedds 11\.0\.1, and 0\.10\.5 is installed: .*ros"):
        Participant(1, Reach())

    def absent(_: str) -> str:
        raise metadata.PackageNotFoundError

    monkeypatch.setattr(dds.metadata, "version", absent)
    with pytest.raises(LaunchError, match=r"not installed here .*x86-64.*ros"):
        Participant(1, Reach())


def test_the_release_whose_private_functions_are_used_is_the_one_that_is_locked() -> None:
    assert metadata.version("cyclonedds") == dds.CYCLONEDDS


@pytest.mark.parametrize("ros_type", sorted({topic.ros_type for topic in TOPICS.values()} | {TWIST, TWIST_STAMPED}))
def test_types_have_the_members_of_ros(ros_type: str) -> None:
    made = dds.idl_type(ros_type, {})
    assert list(made.__annotations__) == [name for name, _ in fields_of(ros_type)]
    assert made.__idl__.idl_transformed_typename.replace(".", "::") == dds_type_name(ros_type)
    assert ros_type_name(dds_type_name(ros_type)) == ros_type


def encode_twist(speed: float, turn: float) -> bytes:
    return b"\0\1\0\0" + np.array((speed, 0, 0, 0, 0, turn)).tobytes()


def encode_stamped(speed: float, stamp_s: float) -> bytes:
    second, rest = divmod(stamp_s, 1.0)
    head = np.array((int(second), round(rest * 1e9)), "<u4").tobytes() + np.uint32(1).tobytes() + b"\0" * 4
    return b"\0\1\0\0" + head + np.array((speed, 0, 0, 0, 0, 0.0)).tobytes()


def test_waiting_ends_in_time(domain: int) -> None:
    wire = DdsWire(domain, Reach())
    wire.open([], "/cmd_vel")
    began_s = time.monotonic()
    assert not wire.wait(0.05)
    assert time.monotonic() - began_s >= 0.04
    wire.close()
