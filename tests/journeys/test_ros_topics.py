"""Jobs whose programs are nodes of a real ROS 2, and all of whose topics are recorded."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.rclpy_nodes import rclpy as rclpy  # a fixture
from helpers.small_flat import ROLE
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import pack_tar_gz

pytestmark = pytest.mark.deep

TALKER = """
import os, rclpy, signal, threading, time
from pathlib import Path
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image, LaserScan
from std_msgs.msg import Char, String

rclpy.init()
node = rclpy.create_node("talker")
threading.Thread(target=rclpy.spin, args=[node], daemon=True).start()  # answers what the type of letters is
latched = node.create_publisher(String, "/plan", QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
latched.publish(String(data="before anybody was there"))
topics = {
    kind: node.create_publisher(kind, name, 10)
    for kind, name in ((String, "/chatter"), (Char, "/letters"), (LaserScan, "/scan"), (Image, "/camera/image_raw"))
}
deadline = time.monotonic() + float(os.environ["WAIT_S"])
while any(not each.get_subscription_count() for each in [latched, *topics.values()]) and time.monotonic() < deadline:
    time.sleep(0.05)
time.sleep(1.0)  # who has subscribed is there some time before what is sent reaches it
if "KILLS" in os.environ:
    time.sleep(2.5)  # its report is there by then
    for each in Path("/proc").glob("[0-9]*"):
        if b"topic_recorder" in (each / "cmdline").read_bytes():
            os.kill(int(each.name), signal.SIGKILL)
    deadline, has_left = time.monotonic() + 150, False
    while time.monotonic() < deadline:  # the dead one seems to be there for ten seconds more
        there = topics[Image].get_subscription_count()
        if there > 1 or (has_left and there):
            break
        has_left = has_left or not there
        time.sleep(0.05)
    time.sleep(1.0)
for number in range(20):
    topics[String].publish(String(data=f"hello {number}"))
    topics[Char].publish(Char(data=65 + number))
    topics[LaserScan].publish(LaserScan(ranges=[float(number)] * 360))
    topics[Image].publish(Image(height=24, width=32, encoding="rgb8", step=96, data=bytes(24 * 96)))
    time.sleep(0.05)
time.sleep(1.0)
os._exit(0)
"""

DRIVER = """
import os, rclpy, time
from geometry_msgs.msg import Twist
from sensor_msgs.msg import LaserScan
from std_msgs.msg import String

rclpy.init()
node = rclpy.create_node("driver")
commands, words = node.create_publisher(Twist, "/cmd_vel", 10), node.create_publisher(String, "/words", 100)
# Only what is said after bridge and recorder listen is recorded.
deadline = time.monotonic() + 150
while (words.get_subscription_count() < 1 or commands.get_subscription_count() < 2) and time.monotonic() < deadline:
    time.sleep(0.05)
time.sleep(1.0)
seen = []
def on_scan(scan):
    seen.append(scan)
    words.publish(String(data=f"{scan.header.stamp.sec + scan.header.stamp.nanosec * 1e-9:.3f}"))
    command = Twist()
    command.angular.z = 0.3
    commands.publish(command)
node.create_subscription(LaserScan, "/scan", on_scan, 10)
node.create_timer(0.2, lambda: commands.publish(Twist()) if not seen else None)
while len(seen) < 40:
    rclpy.spin_once(node)
os._exit(0)
"""


@pytest.fixture
def performed(service: Service, tmp_path: Path, rclpy: Path) -> Callable[..., Path]:
    """Performs a job whose robot is the node, and fetches its outputs."""
    (tmp_path / "bundle").mkdir()
    for name, text in (("talker", TALKER), ("driver", DRIVER)):
        (tmp_path / "bundle" / f"{name}.py").write_text(text)
    pack_tar_gz(tmp_path / "bundle", tmp_path / "bundle.tar.gz")
    for bucket in ("applications", "results"):
        service.store.ensure_bucket(bucket)
    service.store.put_file("applications", "talker.tar.gz", tmp_path / "bundle.tar.gz")
    source = {"sources": [{"s3Bucket": "applications", "s3Key": "talker.tar.gz"}]}
    call("CreateRobotApplication", {"name": "talker", "robotSoftwareSuite": {"name": "General"}, **source}, service)

    def perform(script: str, variables: dict[str, str], *, is_recorded: bool, **members: Any) -> Path:
        launch = {"command": [str(rclpy), script], "environmentVariables": variables}
        request: dict[str, Any] = {
            "maxJobDurationInSeconds": 300, "iamRole": ROLE, "outputLocation": {"s3Bucket": "results"},
            "robotApplications": [{"application": "talker", "launchConfig": launch}],
            "loggingConfig": {"recordAllRosTopics": is_recorded}, **members,
        }  # fmt: skip
        arn = call("CreateSimulationJob", request, service)["arn"]
        perform_job(arn, service)
        job = call("DescribeSimulationJob", {"job": arn}, service)
        assert job["status"] == "Completed", job
        place = service.catalog.get(arn).document["outputs"]
        folder = tmp_path / "outputs"
        for each in service.store.list(place["bucket"], f"{place['prefix']}/"):
            path = folder / each.key.removeprefix(f"{place['prefix']}/")
            path.parent.mkdir(parents=True, exist_ok=True)
            service.store.get_file(place["bucket"], each.key, path)
        return folder

    return perform


def test_all_topics_of_nodes_are_in_the_recording_and_nothing_is_left_beside_it(
    performed: Callable[..., Path],
) -> None:
    folder = performed("talker.py", {"WAIT_S": "150"}, is_recorded=True)

    said: dict[str, list[Any]] = {}
    with AnyReader([folder]) as reader:
        for connection, _, raw in reader.messages():
            said.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
    assert [message.data for message in said["/plan"]] == ["before anybody was there"]
    assert [message.data for message in said["/chatter"]] == [f"hello {number}" for number in range(20)]
    assert [message.data for message in said["/letters"]] == [65 + number for number in range(20)]
    assert [message.ranges[7] for message in said["/scan"]] == list(range(20))
    assert [message.data.size for message in said["/camera/image_raw"]] == [24 * 96] * 20

    counts: dict[str, int] = {}
    times: list[int] = []
    with (folder / "recording.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, _ in reader.iter_decoded_messages(log_time_order=False):
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            times.append(message.log_time)
    assert counts == {topic: len(messages) for topic, messages in said.items()}
    assert times == sorted(times)
    assert json.loads((folder / "foxglove-layout.json").read_text())["configById"]
    assert not list(folder.glob("**/ros-topics*.mcap"))
    assert json.loads((folder / "result.json").read_text())["notes"] == []


def test_nothing_is_recorded_that_was_not_asked_for(performed: Callable[..., Path]) -> None:
    folder = performed("talker.py", {"WAIT_S": "1"}, is_recorded=False)

    assert not list(folder.glob("**/*.mcap"))
    assert not list(folder.glob("**/*ros-topics*"))


@pytest.mark.usefixtures("known_worlds")
def test_what_a_driver_says_is_recorded_at_the_simulated_time_at_which_it_says_it(
    performed: Callable[..., Path], generate: Callable[..., dict[str, Any]]
) -> None:
    world = generate()["finishedWorldsSummary"]["succeededWorlds"][0]
    simulation = {"application": "indoor-navigation", "launchConfig": {}, "worldConfigs": [{"world": world}]}
    options = {"ROBOMAKER_ROS": json.dumps({"suite": 2, "time": "lockstep", "answer_timeout_s": 200})}

    folder = performed("driver.py", options, is_recorded=True, simulationApplications=[simulation])

    times: dict[str, list[float]] = {}
    late_s: list[float] = []
    with (folder / "recording.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            times.setdefault(channel.topic, []).append(message.log_time)
            if channel.topic == "/words":
                late_s.append(message.log_time / 1e9 - float(decoded.data))
    every = [(time, topic) for topic, each in times.items() for time in each]
    assert len(late_s) >= 39  # the last may have been on its way when the node ended
    assert len(times["/cmd_vel"]) >= 39
    # Its scan came 0.2 s of simulated time ago at most: time does not pass while a command is waited for.
    assert all(-0.001 <= each <= 0.201 for each in late_s), late_s
    assert len(times["/clock"]) == len(set(times["/clock"])), "the simulation's own topics are there once"
    assert len(times["/scan"]) == len(set(times["/scan"]))
    assert max(every)[0] < 60e9


def test_a_recorder_that_is_killed_is_started_again_and_its_run_goes_on(performed: Callable[..., Path]) -> None:
    folder = performed("talker.py", {"WAIT_S": "150", "KILLS": "1"}, is_recorded=True)

    with AnyReader([folder]) as reader:
        words = [connection for connection in reader.connections if connection.topic == "/chatter"]
        said = [
            reader.deserialize(raw, c.msgtype).data  # pyright: ignore[reportAttributeAccessIssue]
            for c, _, raw in reader.messages(words)
        ]
    assert said == [f"hello {number}" for number in range(20)]
    assert not list(folder.glob("**/ros-topics*.mcap"))
    result = json.loads((folder / "result.json").read_text())
    again = "ROS topics: their recorder was started 2 times; what came in between is not recorded"
    assert again in result["notes"], result["notes"]
    assert [(tool["name"], tool["last_end"]) for tool in result["tools"]] == [
        ("robot.ros-topics", "was killed by SIGKILL")
    ]
