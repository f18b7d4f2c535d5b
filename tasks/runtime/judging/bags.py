"""Reader of ROS recordings: MCAP files, ROS 2 bags (SQLite or MCAP), ROS 1 bags."""

import struct
from collections.abc import Collection, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from ....schemas.wire.errors import LaunchError
from ....schemas.wire.request_problems import nearest

SUFFIXES = (".mcap", ".db3", ".bag")
"""File name suffixes of recordings."""
METADATA = "metadata.yaml"
_MAX_SHOWN = 12
_IDL_SEPARATOR = "=" * 80 + "\n"

# Bags of before ROS 2 Iron have no definitions, and those of Gazebo's types come with no ROS.
_GAZEBO = {
    "ros_gz_interfaces/msg/Entity": "uint64 id\nstring name\nuint8 type\n",
    "ros_gz_interfaces/msg/JointWrench": "std_msgs/Header header\nstd_msgs/String body_1_name\n"
    "std_msgs/UInt32 body_1_id\nstd_msgs/String body_2_name\nstd_msgs/UInt32 body_2_id\n"
    "geometry_msgs/Wrench body_1_wrench\ngeometry_msgs/Wrench body_2_wrench\n",
    "ros_gz_interfaces/msg/Contact": "ros_gz_interfaces/Entity collision1\nros_gz_interfaces/Entity collision2\n"
    "geometry_msgs/Vector3[] positions\ngeometry_msgs/Vector3[] normals\nfloat64[] depths\n"
    "ros_gz_interfaces/JointWrench[] wrenches\n",
    "ros_gz_interfaces/msg/Contacts": "std_msgs/Header header\nros_gz_interfaces/Contact[] contacts\n",
    "gazebo_msgs/msg/ContactState": "string info\nstring collision1_name\nstring collision2_name\n"
    "geometry_msgs/Wrench[] wrenches\ngeometry_msgs/Wrench total_wrench\ngeometry_msgs/Vector3[] contact_positions\n"
    "geometry_msgs/Vector3[] contact_normals\nfloat64[] depths\n",
    "gazebo_msgs/msg/ModelStates": "string[] name\ngeometry_msgs/Pose[] pose\ngeometry_msgs/Twist[] twist\n",
    "gazebo_msgs/msg/ContactsState": "std_msgs/Header header\ngazebo_msgs/ContactState[] states\n",
}


class RecordingFault(LaunchError):
    """Raised for a ROS recording that cannot be judged; names the file, the fault, and the remedy."""


class Message(NamedTuple):
    """A message of a ROS recording, with its topic and time."""

    time_ns: int
    """Time in nanoseconds at which the message was received, from the recording."""

    topic: str
    type: str
    """ROS type in the form of ROS 2, `nav_msgs/msg/Odometry`, also for ROS 1 messages."""

    content: Any


def find_recording(place: Path) -> Path:
    """Finds the ROS recording (bag) at or below a path.

    Returns:
        A file, or the folder of a ROS 2 bag.

    Raises:
        RecordingFault: There is no recording, or there are several.
    """
    if place.is_file():
        if place.suffix in SUFFIXES:
            return place
        raise RecordingFault(f"{place} is no recording by its name; a .mcap, .db3 or .bag would be right")
    if not place.is_dir():
        raise RecordingFault(
            f"{place} does not exist; a .mcap, .db3 or .bag, or the folder of a ROS 2 bag would be right"
        )
    folders = [each.parent for each in sorted(place.rglob(METADATA))]
    found = folders or [each for each in sorted(place.rglob("*")) if each.suffix in SUFFIXES and each.is_file()]
    if len(found) == 1:
        return found[0]
    if not found:
        raise RecordingFault(
            f"{place} holds no recording; a .mcap, .db3 or .bag, or a {METADATA} beside one, would be right"
        )
    names = ", ".join(str(each.relative_to(place)) for each in found[:_MAX_SHOWN])
    raise RecordingFault(f"{place} holds {len(found)} recordings: {names}; name one of them, a run is one recording")


class Bag:
    """Reader of a ROS recording (ROS 1 or 2 bag, MCAP); errors in the recording are raised as `RecordingFault`."""

    def __init__(self, path: Path) -> None:
        """Opens a recording and reads which topics it has.

        Args:
            path: Path of the recording, from `find_recording`.

        Raises:
            RecordingFault: The recording cannot be read, is cut off, or is empty.
        """
        self.path = path
        self._is_ros1 = path.suffix == ".bag"
        self._reading: list[Any] = []
        """Message readers that have not been read to the end yet, to be closed."""
        self._reader = self._opened()
        try:
            self._look()
        except BaseException:
            self.close()
            raise

    def _opened(self) -> Any:
        """Returns a reader of the recording that begins at its start; raises `RecordingFault` if it cannot be read."""
        try:
            reader = Reader1(self.path) if self._is_ros1 else Reader2(self.path)
            reader.open()
        # Readers raise what their parts raise: of structures, checksums, SQLite, YAML, and assertions.
        except Exception as error:
            raise RecordingFault(f"{self.path} cannot be read: {_text_of(error)}{self._remedy(error)}") from error
        return reader

    def _look(self) -> None:
        self._connections: list[Connection] = list(self._reader.connections)
        self.counts: dict[str, int] = {}
        """Number of messages by topic; 0 for a topic that was recorded but had none."""
        self.types: dict[str, set[str]] = {}
        """ROS message types by topic."""
        for each in self._connections:
            self.counts[each.topic] = self.counts.get(each.topic, 0) + each.msgcount
            self.types.setdefault(each.topic, set()).add(each.msgtype)
        if not any(self.counts.values()):
            topics = f" on its topics {self.shown()}" if self.counts else ""
            raise RecordingFault(f"{self.path} is empty: there is no message in it{topics}; record a run")
        self.start_ns: int = self._reader.start_time
        """Receive time of the first message, in nanoseconds."""
        self.end_ns: int = self._reader.end_time - 1
        """Receive time of the last message, in nanoseconds."""
        self._store: Any = None

    def close(self) -> None:
        """Closes the files of a ROS recording."""
        for reader in (self._reader, *self._reading):
            _closed(reader)

    def topics_of(self, *types: str) -> list[str]:
        """Lists the topics whose messages have one of some types."""
        return [topic for topic, found in self.types.items() if found & set(types)]

    def type_of(self, topic: str) -> str:
        """Returns the message type of a topic.

        Raises:
            RecordingFault: The recording has no such topic, or it has two types.
        """
        found = self.types.get(topic)
        if found is None:
            raise RecordingFault(f"{self.path} has no topic {topic}{self.near(topic)}")
        if (why := self.mixed(topic)) is not None:
            raise RecordingFault(f"{self.path}: {why}")
        (only,) = found
        return only

    def has(self, topic: str, types: Collection[str]) -> bool:
        """Returns whether a topic exists, and all its messages have one of some types."""
        found = self.types.get(topic, set())
        return len(found) == 1 and found <= set(types)

    def mixed(self, topic: str) -> str | None:
        """Returns the error text about a topic whose messages have several types; `None` if it has at most one."""
        found = sorted(self.types.get(topic, ()))
        if len(found) < 2:
            return None
        return (
            f"{topic} has messages of {' and '.join(found)}, so it is not clear what they say; a topic of one type "
            "would do: name it in the sources, or record each type as a topic of its own"
        )

    def near(self, topic: str) -> str:
        """Returns the end of an error text: the existing topic with the most similar name, else the names of topics."""
        return nearest(topic, self.types) or f"; it has {self.shown()}"

    def shown(self) -> str:
        """Lists the names of the first topics, for an error message."""
        names = sorted(self.types)
        more = f" and {len(names) - _MAX_SHOWN} more" if len(names) > _MAX_SHOWN else ""
        return ", ".join(names[:_MAX_SHOWN]) + more

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Yields the messages of some topics in the order in which they were received.

        Raises:
            RecordingFault: The recording is damaged or shorter than it says, or a message is not of its type.
        """
        if not any(each.topic in topics and each.msgcount for each in self._connections):
            return
        reader = self._opened()
        self._reading.append(reader)  # one for each: in an MCAP without an index, two that read at once share one place
        try:
            yield from self._read(reader, topics)
        finally:
            self._reading.remove(reader)
            _closed(reader)

    def raw(self, topic: str) -> Iterator[tuple[int, bytes]]:
        """Yields the receive times (ns) and bytes of a topic's messages: decoding takes ten times as long.

        Raises:
            RecordingFault: The recording is damaged.
        """
        reader = self._opened()
        try:
            wanted = [each for each in reader.connections if each.topic == topic and each.msgcount]
            for _, time_ns, data in reader.messages(connections=wanted) if wanted else ():
                yield time_ns, data
        except Exception as error:  # see above
            raise RecordingFault(f"{self.path} is damaged: on {topic}: {_text_of(error)}") from error
        finally:
            _closed(reader)

    def _read(self, reader: Any, topics: Collection[str]) -> Iterator[Message]:
        wanted: list[Connection] = [each for each in reader.connections if each.topic in topics and each.msgcount]
        store, seen = self._types(wanted), 0
        read = store.deserialize_ros1 if self._is_ros1 else store.deserialize_cdr
        rows = iter(reader.messages(connections=wanted))
        while True:
            try:
                row = next(rows, None)
            except Exception as error:  # see above
                where = f"after {seen} messages on {', '.join(sorted(topics))}"
                raise RecordingFault(
                    f"{self.path} is damaged: {where}: {_text_of(error)}{self._remedy(error)}"
                ) from error
            if row is None:
                break
            connection, time_ns, raw = row
            seen += 1
            try:
                content = read(raw, connection.msgtype)
            except Exception as error:  # what is no such message fails in many ways
                raise RecordingFault(
                    f"{self.path}: message {seen} on {connection.topic} is no {connection.msgtype}: {_text_of(error)}; "
                    "record the topic anew, with the definitions that its publisher has"
                ) from error
            yield Message(time_ns, connection.topic, connection.msgtype, content)
        if seen < (expected := sum(each.msgcount for each in wanted)):
            raise RecordingFault(
                f"{self.path} is cut off: it says that {', '.join(sorted(topics))} have {expected} messages, and has "
                f"{seen}; {self._repair()}"
            )

    def _types(self, connections: Collection[Connection]) -> Any:
        """Returns the message definitions of some topics' types; other topics' definitions may be missing or wrong.

        Raises `RecordingFault` if a definition cannot be read, or a type has none.
        """
        types: dict[str, Any] = {}
        if any(each.msgdef.format == MessageDefinitionFormat.NONE for each in connections):
            types |= get_typestore(Stores.LATEST).fielddefs
            for name, text in _GAZEBO.items():
                types |= get_types_from_msg(text, name)
        for each in connections:
            try:
                types |= _definitions(each)
            except Exception as error:  # of the parsers of definitions
                raise RecordingFault(
                    f"{self.path}: the definition of {each.msgtype} on {each.topic} cannot be read: {_text_of(error)}"
                ) from error
        if unknown := [each for each in connections if each.msgtype not in types]:
            raise RecordingFault(
                f"{self.path} has no definition of {unknown[0].msgtype} ({unknown[0].topic}); record with ROS 2 Iron "
                "or later, or as MCAP, which keep definitions"
            )
        store = get_typestore(Stores.EMPTY)
        store.register(types)
        return store

    def _remedy(self, error: Exception) -> str:
        """Returns advice on usable formats, for a recording that cannot be read."""
        text = str(error)
        if "empty" in text:
            return "; record a run"
        if "Profile" in text:
            return "; an MCAP of ROS 2 would be right, as `ros2 bag record -s mcap` makes it"
        return f"; if it is cut off, {self._repair()}"

    def _repair(self) -> str:
        tools = {".bag": "`rosbag reindex`", ".db3": "`ros2 bag reindex`"}
        tool = tools.get(self.path.suffix, "`mcap recover`" if self.path.suffix == ".mcap" else "`ros2 bag reindex`")
        return f"{tool} saves what is there, up to where it ends"


def _closed(reader: Any) -> None:
    with suppress(Exception):  # nothing was written
        reader.close()


def _definitions(connection: Connection) -> dict[str, Any]:
    data, kind = connection.msgdef.data, connection.msgdef.format
    if kind == MessageDefinitionFormat.NONE:
        return {}
    if kind == MessageDefinitionFormat.MSG:
        return get_types_from_msg(data, connection.msgtype)
    if not data.startswith(f"{_IDL_SEPARATOR}IDL: "):
        return get_types_from_idl(data)
    parts = [part.partition("\n")[2] for part in data.split(_IDL_SEPARATOR)[1:]]
    return {name: each for part in parts for name, each in get_types_from_idl(part).items()}


def _text_of(error: Exception) -> str:
    """Returns the text of a reader's error; unhelpful texts become "it ends in the middle of a record"."""
    if isinstance(error, struct.error | AssertionError | IndexError | TypeError) or not str(error):
        return "it ends in the middle of a record"
    return str(error).rstrip(".")
