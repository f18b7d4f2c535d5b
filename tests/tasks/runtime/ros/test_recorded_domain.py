"""The recorder as a process in a domain of DDS with a simulation, and with nodes of another implementation's making."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from cyclonedds.core import Policy, Qos
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from helpers.processes import started, wait_for
from mcap.reader import make_reader

from prefect_robomaker.tasks.runtime.recording.cdr import encode
from prefect_robomaker.tasks.runtime.recording.messages import Clock, Header, Pose, PoseStamped, TFMessage, Time
from prefect_robomaker.tasks.runtime.ros.dds import Participant, Reach, Writer, named_type
from prefect_robomaker.tasks.runtime.ros.topic_report import (
    MODULE,
    RecorderReport,
    RecorderRequest,
    TopicReport,
    notes_of,
    part_path,
    report_path,
    unrecorded_commands,
)

DOMAIN = 1 + os.getpid() % 101
THING = b"\0\1\0\0\x2a\0\0\0"


@pytest.fixture
def recorder(tmp_path: Path) -> Iterator["subprocess.Popen[str]"]:
    request = RecorderRequest(output_dir=tmp_path, times="clock", max_bytes=10**6).model_dump_json()
    command = [sys.executable, "-P", "-m", MODULE, request]
    with started(command, {"ROS_DOMAIN_ID": str(DOMAIN)}, stderr=subprocess.PIPE) as process:
        yield process


def bare_writer(node: Participant, topic: str, ros_type: str) -> Writer:
    """A publisher that says no hash of its type, as those of Humble, of any type."""
    dds_topic = Topic(node.entity, f"rt{topic}", named_type(ros_type))
    return Writer(DataWriter(node.entity, dds_topic, qos=Qos(Policy.Reliability.Reliable(10**8))))


def test_nodes_are_recorded_in_simulated_time_and_the_simulation_is_not(
    recorder: "subprocess.Popen[str]", tmp_path: Path
) -> None:
    simulation = Participant(DOMAIN, Reach(), is_simulation=True)
    clock = simulation.writer("/clock", "rosgraph_msgs/msg/Clock", is_latched=False, depth=10)
    its_frames = simulation.writer("/tf", "tf2_msgs/msg/TFMessage", is_latched=False, depth=100)
    node = Participant(DOMAIN, Reach())
    latched = node.writer("/pose", "geometry_msgs/msg/PoseStamped", is_latched=True, depth=1)
    latched.write(encode(PoseStamped(Header(Time(0, 0), "map"), Pose())))
    frames = node.writer("/tf", "tf2_msgs/msg/TFMessage", is_latched=False, depth=100)
    thing = bare_writer(node, "/thing", "my_msgs/msg/Thing")
    wait_for(lambda: all(each.listeners for each in (clock, latched, frames, thing)), "the recorder to subscribe")
    assert not any(each.readers for each in (clock, latched, frames, thing)), "the recorder is no node"
    time.sleep(1.0)  # who has subscribed is there some time before what is sent reaches it
    for second in range(1, 11):
        clock.write(encode(Clock(Time(second, 0))))
        its_frames.write(encode(TFMessage(())))
        time.sleep(0.02)
        frames.write(encode(TFMessage(())))
        thing.write(THING)
        time.sleep(0.02)
    time.sleep(0.5)
    recorder.send_signal(signal.SIGTERM)
    _, errors = recorder.communicate(timeout=200)

    assert recorder.returncode == 0, errors
    times: dict[str, list[float]] = {}
    with part_path(tmp_path, 1).open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            times.setdefault(channel.topic, []).append(message.log_time / 1e9)
            if channel.topic == "/thing":
                assert schema is not None
                assert (schema.name, schema.encoding, message.data) == ("my_msgs/msg/Thing", "", THING)
    assert times == {"/pose": [0.0], "/tf": [*range(1, 11)], "/thing": [*range(1, 11)]}
    report = RecorderReport.model_validate_json(report_path(part_path(tmp_path, 1)).read_bytes())
    assert notes_of([report], starts=1) == [
        "ROS topics recorded without a definition of their type: /thing (my_msgs/msg/Thing)"
    ]


@pytest.mark.parametrize(("recorded", "lost", "missing"), [(300, 0, False), (217, 83, False), (217, 0, True)])
def test_commands_that_were_sent_before_the_recorder_was_there_are_told(
    recorded: int, lost: int, missing: bool
) -> None:
    topic = TopicReport(name="/cmd_vel", type="geometry_msgs/msg/Twist", messages=recorded, lost=lost)
    report = RecorderReport(domain=7, topics=[topic])

    told = unrecorded_commands([report], {"command_topic": "/cmd_vel", "commands": 300})

    assert told == [
        "ROS topics: 217 of 300 commands on /cmd_vel are recorded; those are missing that were sent before the "
        "recorder had found the node"
    ] * int(missing)
    assert unrecorded_commands([report], {}) == []
