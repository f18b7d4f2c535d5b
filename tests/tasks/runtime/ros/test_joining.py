"""Recordings that are joined into one, as other people's readers see it."""

import json
import os
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Chunk
from rosbags.highlevel import AnyReader
from ruamel.yaml import YAML

from prefect_robomaker.schemas.runs.plan import RunPlan, RunResult
from prefect_robomaker.schemas.runs.programs import ProgramPlan
from prefect_robomaker.tasks.runtime.recording.cdr import definition, encode, type_hash
from prefect_robomaker.tasks.runtime.recording.companions import Offer, channel_metadata
from prefect_robomaker.tasks.runtime.recording.mcap_file import McapFile, Unbuffered
from prefect_robomaker.tasks.runtime.recording.messages import Clock, Header, Pose, PoseStamped, Time
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder
from prefect_robomaker.tasks.runtime.ros.joining import join
from prefect_robomaker.tasks.runtime.ros.topic_report import RecorderReport, TopicReport, part_path, report_path
from prefect_robomaker.tasks.runtime.supervision.ros_topics import join_ros_topics

POSE = "geometry_msgs/msg/PoseStamped"


def own(folder: Path, times_s: Sequence[float]) -> None:
    """The recording of a run."""
    with McapRecorder(folder / "recording.mcap") as recorder:
        for time_s in times_s:
            recorder.write("/clock", Clock(Time.from_seconds(time_s)), time_s)


def part(folder: Path, number: int, times_s: Sequence[float], *, is_whole: bool = True, unknown: bool = False) -> Path:
    """A file of the recorder of ROS topics, a chunk for each message."""
    path = part_path(folder, number)
    stream = Unbuffered(path)
    file = McapFile(stream, "ros2", "test", chunk_bytes=1)
    offer = Offer(is_latched=True, is_reliable=True, depth=3)
    poses = file.add_channel("/pose", POSE, definition(POSE), channel_metadata("/pose", type_hash(POSE), offer))
    things = file.add_channel("/thing", "my/msg/Thing", "", channel_metadata("/thing", "")) if unknown else None
    for time_s in times_s:
        time_ns = round(time_s * 1e9)
        file.add_message(poses, time_ns, encode(PoseStamped(Header(Time.from_seconds(time_s), "map"), Pose())))
        if things is not None:
            file.add_message(things, time_ns, b"\0\1\0\0\7\0\0\0")
    if is_whole:
        file.finish()
    stream.close()
    return path


def read(folder: Path) -> list[tuple[str, float]]:
    """Topics and times of a recording, in the order in which they are in the file."""
    with (folder / "recording.mcap").open("rb") as file:
        messages = make_reader(file).iter_messages(log_time_order=False)
        return [(channel.topic, message.log_time / 1e9) for _, channel, message in messages]


def test_messages_of_all_files_are_in_the_order_of_their_times(tmp_path: Path) -> None:
    own(tmp_path, [0, 1, 2, 3])
    first, second = part(tmp_path, 1, [0.5, 1]), part(tmp_path, 2, [2.5, 9], unknown=True)

    said = join(tmp_path, [first.name, second.name])

    assert said == {"messages": 6, "cut": []}
    assert read(tmp_path) == [
        ("/clock", 0), ("/pose", 0.5), ("/clock", 1), ("/pose", 1), ("/clock", 2),
        ("/pose", 2.5), ("/thing", 2.5), ("/clock", 3), ("/pose", 9), ("/thing", 9),
    ]  # fmt: skip
    assert {path.name for path in tmp_path.iterdir()} == {"recording.mcap", "metadata.yaml", "foxglove-layout.json"}
    with AnyReader([tmp_path]) as reader:
        kinds = {connection.topic: connection for connection in reader.connections}
        poses: list[Any] = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages([kinds["/pose"]])]
        assert [message.header.stamp.sec for message in poses] == [0, 1, 2, 9]
        assert kinds["/thing"].msgtype == "my/msg/Thing"
    information: Any = YAML(typ="safe").load((tmp_path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    topics = {each["topic_metadata"]["name"]: each for each in information["topics_with_message_count"]}
    assert {name: each["message_count"] for name, each in topics.items()} == {"/clock": 4, "/pose": 4, "/thing": 2}
    offered = topics["/pose"]["topic_metadata"]["offered_qos_profiles"][0]
    assert (offered["depth"], offered["durability"]) == (3, "transient_local")


def test_files_of_killed_programs_count_up_to_their_last_chunk(tmp_path: Path) -> None:
    own(tmp_path, [0, 5])
    cut = part(tmp_path, 1, [1, 2, 3], is_whole=False)
    with cut.open("r+b") as file:
        file.truncate(cut.stat().st_size - 40)

    said = join(tmp_path, [cut.name])

    assert said == {"messages": 2, "cut": [cut.name]}
    assert read(tmp_path) == [("/clock", 0), ("/pose", 1), ("/pose", 2), ("/clock", 5)]


def test_a_run_without_a_recording_of_its_own_gets_one(tmp_path: Path) -> None:
    part(tmp_path, 1, [1])
    join(tmp_path, ["ros-topics.1.mcap"])
    assert read(tmp_path) == [("/pose", 1)]


def test_a_recording_is_left_as_it_is_where_nodes_said_nothing(tmp_path: Path) -> None:
    own(tmp_path, [0, 1])
    before = (tmp_path / "recording.mcap").read_bytes()
    part(tmp_path, 1, [])
    assert join(tmp_path, ["ros-topics.1.mcap"])["messages"] == 0
    assert (tmp_path / "recording.mcap").read_bytes() == before
    assert not part_path(tmp_path, 1).exists()


def bomb(path: Path) -> None:
    """A chunk that says it is small and becomes large."""
    raw = bytes(32 * 1024 * 1024)
    builder = RecordBuilder()
    Chunk("zstd", zstandard.ZstdCompressor(1).compress(raw), 1, 0, zlib.crc32(raw), 1000).write(builder)
    path.write_bytes(b"\x89MCAP0\r\n" + builder.end())


def huge(path: Path) -> None:
    path.write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, 2**62))


def link(path: Path) -> None:
    target = path.with_name("elsewhere.txt")
    target.write_text("somebody's")
    path.unlink()
    path.symlink_to(target)


def fifo(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


@pytest.fixture
def plan(tmp_path: Path) -> RunPlan:
    recorder = ProgramPlan(name="robot.ros-topics", role="robot", kind="tool", argv=["x"], folder=tmp_path)
    output = tmp_path / "output"
    (output / "logs").mkdir(parents=True)
    result = RunResult(
        verdict="PASS", sim_time_s=0, wall_time_s=0, real_time_factor=0, ended_by="environment", seed=1
    )  # fmt: skip
    (output / "result.json").write_text(result.model_dump_json())
    return RunPlan(
        job_id="sim-1", job_arn="arn:x", run_id="run-1", seed=1, max_duration_s=1, work_dir=tmp_path,
        output_dir=output, programs=[recorder],
    )  # fmt: skip


Notes = Callable[[], list[str]]


@pytest.fixture
def noted(plan: RunPlan) -> Notes:
    def after_joining() -> list[str]:
        join_ros_topics(plan, is_canceled=False, stop=lambda: None, environment=os.environ)
        return json.loads((plan.output_dir / "result.json").read_text())["notes"]

    return after_joining


def reported(path: Path, *topics: TopicReport) -> None:
    report_path(path).write_text(RecorderReport(domain=7, topics=list(topics)).model_dump_json())


@pytest.mark.parametrize("harm", [bomb, huge, link, fifo])
def test_what_programs_left_in_the_place_of_a_recording_harms_nothing_and_is_noted(
    harm: Callable[[Path], None], plan: RunPlan, noted: Notes
) -> None:
    own(plan.output_dir, [0, 1])
    before = (plan.output_dir / "recording.mcap").read_bytes()
    harm(part(plan.output_dir, 1, [0.5]))

    assert "ROS topics are in ros-topics.1.mcap, and not in recording.mcap: " in noted()[0]
    assert (plan.output_dir / "recording.mcap").read_bytes() == before
    assert not list(plan.output_dir.glob(".*"))


def test_links_in_the_place_of_what_lies_beside_are_replaced_and_not_followed(plan: RunPlan, noted: Notes) -> None:
    precious = plan.work_dir / "precious"
    precious.write_text("mine")
    for name in ("recording.mcap", "metadata.yaml", "foxglove-layout.json"):
        unfinished = plan.output_dir / f".{name}.unfinished"
        unfinished.symlink_to(precious)
    (plan.output_dir / "metadata.yaml").symlink_to(precious)
    reported(part(plan.output_dir, 1, [1]), TopicReport(name="/pose", type=POSE, messages=1))

    assert noted() == []
    assert precious.read_text() == "mine"
    assert read(plan.output_dir) == [("/pose", 1)]
    assert not (plan.output_dir / "metadata.yaml").is_symlink()


def test_what_is_missing_is_noted_in_the_result(plan: RunPlan, noted: Notes) -> None:
    reported(part(plan.output_dir, 1, [1], is_whole=False), TopicReport(name="/pose", type=POSE, messages=1))
    reported(
        part(plan.output_dir, 2, [2], is_whole=False),
        TopicReport(name="/pose", type=POSE, messages=1),
        TopicReport(name="/image", type="sensor_msgs/msg/Image", messages=9, lost=3),
        TopicReport(name="/cloud", type="sensor_msgs/msg/PointCloud2", messages=5, left_out=70),
        TopicReport(name="/thing", type="my/msg/Thing", messages=5, is_defined=False),
        TopicReport(name="/silent", type=POSE),
        TopicReport(name="/far", type=POSE, problem="it cannot be subscribed: no room"),
    )

    assert noted() == [
        "ROS topics: their recorder was started 2 times; what came in between is not recorded",
        "ROS topics not recorded: /far (it cannot be subscribed: no room)",
        "ROS topics left out from the recording's limit on: /cloud (70 messages)",
        "ROS topics lost before they were recorded: /image (3)",
        "ROS topics recorded without a definition of their type: /thing (my/msg/Thing)",
        "ROS topics announced, and no message came: /silent",
        "ROS topics: their recorder was killed before it had written its last messages",
    ]
    assert read(plan.output_dir) == [("/pose", 1), ("/pose", 2)]
    assert not list(plan.output_dir.glob("ros-topics*"))


def losses(plan: RunPlan) -> dict[str, str]:
    return join_ros_topics(plan, is_canceled=False, stop=lambda: None, environment=os.environ)


def test_topics_that_are_not_in_the_recording_as_a_whole_are_told_to_who_judges(plan: RunPlan) -> None:
    """Requirements that silence meets would pass by what is missing."""
    log = "rcl_interfaces/msg/Log"
    reported(
        part(plan.output_dir, 1, [1]),
        TopicReport(name="/pose", type=POSE, messages=1),
        TopicReport(name="/image", type="sensor_msgs/msg/Image", messages=9, lost=3),
        TopicReport(name="/cloud", type="sensor_msgs/msg/PointCloud2", messages=5, left_out=70),
        TopicReport(name="/rosout", type=log, messages=9, lost=2),
    )
    assert losses(plan) == {
        "/cloud": "70 messages were left out from the recording's limit on",
        "/rosout": "2 messages were lost before they were recorded",
    }
    reported(part(plan.output_dir, 1, [1], is_whole=False), TopicReport(name="/pose", type=POSE, messages=1))
    assert losses(plan) == {"/pose": "their recorder was killed before it had written its last messages"}
    for number in (1, 2):
        reported(part(plan.output_dir, number, [1]), TopicReport(name="/pose", type=POSE, messages=1))
    restarts = "its recorder was started 2 times, and what came in between is not recorded"
    assert losses(plan) == {"/pose": restarts}
    bad = part(plan.output_dir, 1, [1])
    reported(bad, TopicReport(name="/pose", type=POSE, messages=1))
    bomb(bad)
    assert losses(plan)["/pose"].startswith("its messages are in ros-topics.1.mcap, and not in recording.mcap: ")


def test_the_recorder_of_ros_1_is_not_said_to_have_recorded_nothing(plan: RunPlan, noted: Notes) -> None:
    (plan.output_dir / "ros-topics.bag").write_bytes(b"#ROSBAG V2.0")
    assert noted() == []


def test_what_a_killed_recorder_and_a_killed_joining_were_writing_is_removed(plan: RunPlan, noted: Notes) -> None:
    reported(part(plan.output_dir, 1, [1]), TopicReport(name="/pose", type=POSE, messages=1))
    for name in ("ros-topics.1.json", "ros-topics.2.json", "recording.mcap"):
        (plan.output_dir / f".{name}.unfinished").write_text("{")
    (plan.output_dir / ".mine.unfinished").write_text("of the job")

    assert noted() == []
    assert [path.name for path in plan.output_dir.glob(".*")] == [".mine.unfinished"]


def test_a_recorder_that_never_began_is_noted_with_the_end_of_its_log(plan: RunPlan, noted: Notes) -> None:
    (plan.output_dir / "logs" / "robot.ros-topics.stderr.log").write_text("Traceback\nLaunchError: no domain\n")
    assert noted() == ["ROS topics: their recorder recorded nothing: LaunchError: no domain"]


def test_a_job_that_is_cancelled_while_files_are_joined_keeps_them_apart(plan: RunPlan) -> None:
    part(plan.output_dir, 1, [1])
    join_ros_topics(plan, is_canceled=False, stop=lambda: "Canceled", environment={**os.environ})
    notes = json.loads((plan.output_dir / "result.json").read_text())["notes"]
    # It may have been quicker than the first question.
    assert notes in (
        [],
        ["ROS topics are in ros-topics.1.mcap, and not in recording.mcap: the job was stopped (Canceled)"],
    )
    assert part_path(plan.output_dir, 1).exists() == bool(notes)


def test_the_joining_program_says_what_is_wrong_in_one_line(tmp_path: Path) -> None:
    part_path(tmp_path, 1).write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, 2**62))
    (tmp_path / "recording.mcap").mkdir()
    command = [sys.executable, "-P", "-m", "prefect_robomaker.tasks.runtime.ros.joining", str(tmp_path), "x"]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert len(ended.stderr.splitlines()) == 1
