"""The recorder of ROS topics with a domain that a test plays; real DDS is in `test_recorded_domain.py`."""

import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, cast

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from prefect_robomaker.tasks.runtime.recording.cdr import encode
from prefect_robomaker.tasks.runtime.recording.messages import Clock, Time
from prefect_robomaker.tasks.runtime.ros.dds import Received
from prefect_robomaker.tasks.runtime.ros.dds_listening import Announced
from prefect_robomaker.tasks.runtime.ros.topic_recorder import TopicRecorder
from prefect_robomaker.tasks.runtime.ros.topic_report import (
    LogTimes,
    RecorderReport,
    RecorderRequest,
    notes_of,
    part_path,
    report_path,
)

POINT = "geometry_msgs/msg/Point"
HELLO = b"\0\1\0\0" + struct.pack("<ddd", 1.0, 2.0, 3.0)


class Heard:
    """A domain of which a test says what is heard."""

    def __init__(self) -> None:
        self.simulations = {"simulation"}
        self.came: list[Announced] = []
        self.subscribed: dict[tuple[str, str, bool], list[Received]] = {}
        self.replies: list[bytes] = []
        self.asked: list[str] = []

    def changes(self) -> list[Announced]:
        came, self.came = self.came, []
        return came

    def subscribe(self, topic: str, type_name: str, depth: int, *, is_latched: bool) -> Any:
        del depth
        messages = self.subscribed.setdefault((topic, type_name, is_latched), [])

        def take() -> list[Received]:
            taken = messages[:]
            messages.clear()
            return taken

        return type("Subscription", (), {"take": staticmethod(take), "lost": 0})

    def call(self, service: str, ros_type: str, request: bytes) -> Any:
        del ros_type, request
        self.asked.append(service)
        return type("Call", (), {"replies": lambda _: self.replies})()

    def announce(self, ros_topic: str, ros_type: str = POINT, **members: Any) -> None:
        package, kind, name = ros_type.split("/")
        usual = Announced(1, "node", f"rt{ros_topic}", f"{package}::{kind}::dds_::{name}_", "", False, True, 10)
        self.came.append(usual._replace(**members))

    def send(self, topic: str, sent_s: float, data: bytes = HELLO, writer: int = 1, ros_type: str = POINT) -> None:
        messages = next(each for key, each in self.subscribed.items() if key[:2] == (f"rt{topic}", ros_type))
        messages.append(Received(round(sent_s * 1e9), writer, data))


class Message(NamedTuple):
    topic: str
    time_s: float
    schema: str
    data: bytes


Recording = Callable[..., TopicRecorder]


@pytest.fixture
def heard() -> Heard:
    return Heard()


@pytest.fixture
def now() -> list[float]:
    return [0.0]


@pytest.fixture
def recording(heard: Heard, now: list[float], tmp_path: Path) -> Recording:
    def record(times: LogTimes = "sent", max_bytes: int = 10**6) -> TopicRecorder:
        request = RecorderRequest(
            output_dir=tmp_path, times=times, max_bytes=max_bytes, packages=[tmp_path / "bundle", tmp_path / "none"]
        )
        return TopicRecorder(cast("Any", heard), request, 7, part_path(tmp_path, 1), clock=lambda: now[0])

    return record


def recorded(folder: Path) -> list[Message]:
    with part_path(folder, 1).open("rb") as file:
        return [
            Message(channel.topic, message.log_time / 1e9, schema.encoding if schema else "", message.data)
            for schema, channel, message in make_reader(file).iter_messages()
        ]


def notes(folder: Path) -> list[str]:
    report = RecorderReport.model_validate_json(report_path(part_path(folder, 1)).read_bytes())
    return notes_of([report], starts=1)


def test_log_times_are_the_simulated_time_at_which_messages_were_sent(
    heard: Heard, recording: Recording, tmp_path: Path
) -> None:
    recorder = recording("clock")
    heard.announce("/spot")
    recorder.look()
    heard.send("/spot", 99.0)
    recorder.look()  # nobody has said yet what time it is
    for sent_s, simulated_s in ((100.0, 5), (100.1, 6), (100.2, 7)):
        heard.send("/clock", sent_s, encode(Clock(Time(simulated_s, 0))), ros_type="rosgraph_msgs/msg/Clock", writer=9)
    heard.came.append(Announced(9, "simulation", "rt/clock", "rosgraph_msgs::msg::dds_::Clock_", "", False, True, 10))
    for sent_s in (100.25, 100.15, 100.1, 98.0):
        heard.send("/spot", sent_s)
    recorder.look()
    recorder.close()

    assert [message.time_s for message in recorded(tmp_path)] == [0, 5, 6, 6, 7]


def test_a_run_whose_simulation_has_no_clock_counts_from_the_recorders_start(
    heard: Heard, recording: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("time.time_ns", lambda: 100 * 10**9)
    recorder = recording("elapsed")
    heard.announce("/spot")
    recorder.look()
    heard.send("/spot", 102.5)
    heard.send("/spot", 60.0)  # it was latched before
    recorder.close()

    assert [message.time_s for message in recorded(tmp_path)] == [0.0, 2.5]


def test_what_the_simulation_publishes_is_left_out_on_topics_that_nodes_publish_too(
    heard: Heard, recording: Recording, tmp_path: Path
) -> None:
    recorder = recording()
    heard.announce("/tf", writer=1)
    heard.announce("/tf", writer=2, participant="simulation")
    heard.announce("/scan", writer=3, participant="simulation")
    recorder.look()
    heard.send("/tf", 1.0, writer=2)
    heard.send("/tf", 2.0, writer=1)
    recorder.close()

    assert [(message.topic, message.time_s) for message in recorded(tmp_path)] == [("/tf", 2.0)]
    assert [key[0] for key in heard.subscribed] == ["rt/tf"]
    assert notes(tmp_path) == []


def test_services_and_what_nodes_say_of_themselves_are_no_topics(
    heard: Heard, recording: Recording, tmp_path: Path
) -> None:
    recorder = recording()
    for topic in ("rr/robot/get_parametersReply", "rq/robot/get_parametersRequest", "ros_discovery_info"):
        heard.announce("", topic=topic)
    heard.announce("", topic="Square", type="ShapeType")
    heard.announce("/spot")
    recorder.look()
    heard.send("/spot", 1.0)
    recorder.close()

    assert {message.topic for message in recorded(tmp_path)} == {"/spot"}
    assert notes(tmp_path) == ["ROS topics not recorded: Square (no topic of ROS)"]


@pytest.mark.parametrize("answers", [True, False])
def test_a_node_is_asked_for_a_definition_that_is_not_known(
    answers: bool, heard: Heard, recording: Recording, now: list[float], tmp_path: Path
) -> None:
    recorder = recording()
    heard.announce("", topic="rr/ns/robot/get_type_descriptionReply", type="x::srv::dds_::y_", writer=5)
    heard.announce("/spot", type_hash="RIHS01_" + "0" * 64)
    recorder.look()
    heard.send("/spot", 1.0)
    recorder.look()
    if answers:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        store = get_typestore(Stores.LATEST)
        about = "type_description_interfaces/"
        text = f"bool a\nstring b\n{about}TypeDescription c\n{about}TypeSource[] d\n{about}KeyValue[] e"
        store.register(get_types_from_msg(text, "x/msg/Reply"))
        types: dict[str, Any] = dict(store.types)
        field_type = types[f"{about}msg/FieldType"]
        fields = [types[f"{about}msg/Field"](name, field_type(11, 0, 0, ""), "") for name in "xyz"]
        description = types[f"{about}msg/TypeDescription"](
            types[f"{about}msg/IndividualTypeDescription"](POINT, fields), []
        )
        reply = types["x/msg/Reply"](True, "", description, [], [])
        heard.replies.append(bytes(store.serialize_cdr(reply, "x/msg/Reply")))
    else:
        now[0] = 16.0
    recorder.look()
    heard.send("/spot", 2.0)
    recorder.close()

    assert heard.asked == ["ns/robot/get_type_description"]
    assert [message.data for message in recorded(tmp_path)] == [HELLO, HELLO]
    assert {message.schema for message in recorded(tmp_path)} == {"ros2msg" if answers else ""}
    lacks = f"ROS topics recorded without a definition of their type: /spot ({POINT})"
    assert notes(tmp_path) == ([] if answers else [lacks])


SET_BOOL = "bool data # e.g. for hardware enabling / disabling\n---\nbool success   # indicate\nstring message # info\n"
SET_BOOL_EVENT = "RIHS01_3c4c20015afb4303eafd347b1d6a786f171a89c814726961a9593ef10df878cf"
"""Hash of `std_srvs/srv/SetBool_Event`, as Jazzy's own package says it."""
FILES = {
    # As a merged install, an isolated one and a source tree have them.
    "install/share/my_msgs/msg/Spot.msg": "std_msgs/Header header\nSize size\nother_msgs/Kind[<=3] kinds\nchar mark 7",
    "install/other_msgs/share/other_msgs/msg/Kind.msg": "uint8 CAT=1\nuint8 kind",
    "src/my_msgs/msg/Size.msg": "float64 width_m\r\nfloat64 height_m\r\n",
    "install/share/std_srvs/srv/SetBool.srv": SET_BOOL,
}


def bundle(folder: Path) -> None:
    for name, text in FILES.items():
        path = folder / "bundle" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, newline="")


@pytest.mark.parametrize("announces", ["", "RIHS01_" + "0" * 64])
def test_a_bundles_files_define_its_types_unless_the_node_has_another_definition(
    announces: str, heard: Heard, recording: Recording, now: list[float], tmp_path: Path
) -> None:
    bundle(tmp_path)
    recorder = recording()
    heard.announce("/spot", "my_msgs/msg/Spot", type_hash=announces)
    recorder.look()
    header, size, kinds = struct.pack("<iII4s", 5, 6, 4, b"map"), struct.pack("<dd", 1.5, 2.5), struct.pack("<IB", 1, 2)
    heard.send("/spot", 1.0, b"\0\1\0\0" + header + size + kinds + b"A", ros_type="my_msgs/msg/Spot")
    now[0] = 16.0
    recorder.look()
    recorder.close()

    lacks = ["ROS topics recorded without a definition of their type: /spot (my_msgs/msg/Spot)"]
    assert notes(tmp_path) == (lacks if announces else [])
    if announces:
        return
    with part_path(tmp_path, 1).open("rb") as file:
        ((_, _, _, decoded),) = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
    assert (decoded.header.stamp.sec, decoded.size.height_m, decoded.mark) == (5, 2.5, 65)
    assert [kind.kind for kind in decoded.kinds] == [2]


def test_a_services_events_are_defined_by_its_file_where_their_hash_is_that_of_ros(
    heard: Heard, recording: Recording, tmp_path: Path
) -> None:
    bundle(tmp_path)
    recorder = recording()
    for number, announced in enumerate((SET_BOOL_EVENT, SET_BOOL_EVENT[:-1] + "0")):
        heard.announce(f"/set{number}/_service_event", "std_srvs/srv/SetBool_Event", type_hash=announced, writer=number)
    recorder.look()
    for number in range(2):
        heard.send(f"/set{number}/_service_event", 1.0, ros_type="std_srvs/srv/SetBool_Event", writer=number)
    recorder.close()

    assert notes(tmp_path) == [
        "ROS topics recorded without a definition of their type: /set1/_service_event (std_srvs/srv/SetBool_Event)"
    ]


def test_files_that_are_no_definitions_leave_topics_without(heard: Heard, recording: Recording, tmp_path: Path) -> None:
    folder = tmp_path / "bundle" / "my_msgs" / "msg"
    folder.mkdir(parents=True)
    os.mkfifo(folder / "Pipe.msg")
    (folder / "Loop.msg").symlink_to("Loop.msg")
    (folder / "Huge.msg").write_bytes(b"float64 x\n" * 10**5)
    (folder / "Words.msg").write_text("this is no definition at all: {")
    (folder / "Lacks.msg").write_text("unknown_msgs/Thing thing\n")
    (folder / "Round.msg").write_text("Round round\n")
    recorder = recording()
    names = ("Pipe", "Loop", "Huge", "Words", "Lacks")
    for number, name in enumerate(names):
        heard.announce(f"/{name}", f"my_msgs/msg/{name}", writer=number)
    recorder.look()
    for number, name in enumerate(names):
        heard.send(f"/{name}", 1.0, ros_type=f"my_msgs/msg/{name}", writer=number)
    recorder.close()

    assert {message.topic for message in recorded(tmp_path)} == {f"/{name}" for name in names}
    assert {message.schema for message in recorded(tmp_path)} == {""}


def test_a_flood_of_one_topic_leaves_room_for_others_and_is_named(
    heard: Heard, recording: Recording, tmp_path: Path
) -> None:
    recorder = recording(max_bytes=1000)
    heard.announce("/camera", writer=1)
    heard.announce("/spot", writer=2)
    recorder.look()
    for number in range(100):
        heard.send("/camera", number, b"\0\1\0\0" + bytes(96))
    heard.send("/spot", 200.0, writer=2)
    recorder.close()

    counts = [message.topic for message in recorded(tmp_path)]
    assert (counts.count("/camera"), counts.count("/spot")) == (5, 1)
    assert notes(tmp_path) == ["ROS topics left out from the recording's limit on: /camera (95 messages)"]


def test_a_topic_of_latched_and_other_publishers_has_the_messages_of_both_once(
    heard: Heard, recording: Recording, tmp_path: Path
) -> None:
    recorder = recording()
    heard.announce("/spot", writer=1)
    heard.announce("/spot", writer=2, is_latched=True)
    recorder.look()
    for sent_s, writer, is_latched in ((1, 1, False), (2, 2, False), (2, 2, True), (0.5, 2, True)):
        heard.subscribed["rt/spot", POINT, is_latched].append(Received(int(sent_s * 1e9), writer, HELLO))
    recorder.close()

    assert [message.time_s for message in recorded(tmp_path)] == [0.5, 1, 2]


def test_topics_on_which_nothing_came_and_a_silent_domain_are_noted(
    heard: Heard, recording: Recording, tmp_path: Path
) -> None:
    recorder = recording()
    recorder.close()
    assert notes(tmp_path) == ["ROS topics: no node was heard in domain 7, so none is recorded"]

    part_path(tmp_path, 1).unlink()
    recorder = recording()
    heard.announce("/rosout")
    heard.announce("/spot")
    recorder.look()
    recorder.close()
    assert notes(tmp_path) == ["ROS topics announced, and no message came: /spot"]
