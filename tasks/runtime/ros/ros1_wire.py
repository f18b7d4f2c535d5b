"""Connection from a simulation to ROS 1 nodes: frames on a socket, which a bridge node converts to topics.

Only `Ros1Wire.wait` waits for the bridge. A slow bridge loses messages, but does not slow down the simulation. A bridge
that exits is restarted by the run, greeted again, and given the latched messages again.
"""

import json
import logging
import select
import socket
import struct
import time
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from ....schemas.runs.plan import RunPlan
from ....schemas.wire.errors import LaunchError
from ..agents.agent_client import FrameBuffer, ProtocolError, json_message
from ..agents.agent_socket import ROS1_SOCKET, AgentSocket
from .ros1_bridge import COMMAND, HEADER, HELLO, MESSAGE, MOST_BYTES, PROTOCOL, STATE, TOPIC, VELOCITY, VERSION
from .wire import Command, Peers, Topic

_HEADER = "std_msgs/msg/Header"
_SEQUENCE = struct.Struct("<I")
_READS = 16
"""Maximum number of reads from the socket in one poll, so that a node that floods the bridge does not block the
simulation.
"""
_KEPT_COMMANDS = 1000
"""Maximum number of waiting commands; a robot gets about fifty a second."""
_MOST_NAMED = 32
_SHOWN = 200

_logger = logging.getLogger(__name__)


class Ros1Wire:
    """Connection from the simulation to ROS 1 nodes, through a bridge process: an implementation of `Wire`."""

    def __init__(self, plan: RunPlan) -> None:
        """Stores a run's settings for ROS 1; the socket for the bridge process is opened by `open`.

        Args:
            plan: Plan of the run, in whose folder the socket is.
        """
        self.name = "ROS 1, whose bridge has not connected yet"
        self.dropped: Counter[str] = Counter()
        """Number of messages dropped because the bridge was too slow, by topic."""
        self.connections = 0
        """Number of bridge processes that have connected."""
        self._plan = plan
        self._listener: AgentSocket | None = None
        self._link: _Link | None = None
        self._hello = b""
        self._numbers: dict[str, int] = {}
        self._topics: Sequence[Topic] = ()
        self._sent: Counter[str] = Counter()
        self._latched: dict[str, bytes] = {}
        self._commands: deque[Command] = deque(maxlen=_KEPT_COMMANDS)
        self._peers = Peers()

    def open(self, topics: Sequence[Topic], command_topic: str) -> None:
        """Opens the socket for the bridge to ROS 1 nodes, which announces topics and subscribes velocity commands.

        Raises:
            LaunchError: A topic's type is not in ROS 1, or the bridge cannot be listened for.
        """
        described = [
            {
                "name": topic.name,
                "type": topic.ros_type.replace("/msg/", "/"),
                "md5sum": ros1_definition(topic.ros_type)[1],
                "definition": ros1_definition(topic.ros_type)[0],
                "latched": topic.is_latched,
                "depth": topic.depth,
            }
            for topic in topics
        ]
        greeting = {"protocol": PROTOCOL, "version": VERSION, "command_topic": command_topic, "topics": described}
        self._hello = json_message(HELLO, greeting)
        self._topics = topics
        self._numbers = {topic.name: number for number, topic in enumerate(topics)}
        self._listener = AgentSocket(self._plan, ROS1_SOCKET)

    def send(self, topic: str, message: bytes) -> None:
        """Publishes a message to ROS 1 nodes; without a bridge process it is dropped, unless its topic is latched.

        Args:
            topic: Name of the topic.
            message: The message in CDR, little endian, with its encapsulation header of four bytes.
        """
        number = self._numbers[topic]
        about = self._topics[number]
        if self._link is None and not about.is_latched:
            self._look()
            if self._link is None:
                return
        frame = self._frame(number, about, message)
        if about.is_latched:
            self._latched[topic] = frame
        self._look()
        if self._link is not None:
            self._link.add(about, frame)
            self._flush()

    def take(self) -> list[Command]:
        """Returns the velocity commands received since the last call, oldest first."""
        self._look()
        taken = list(self._commands)
        self._commands.clear()
        return taken

    def wait(self, timeout_s: float) -> bool:
        """Waits until a velocity command arrives, at most for a time in seconds; returns whether one did."""
        deadline_s = time.monotonic() + timeout_s
        while True:
            self._look()
            left_s = deadline_s - time.monotonic()
            if self._commands or left_s <= 0:
                return bool(self._commands)
            if self._listener is None:
                time.sleep(left_s)
                continue
            link = self._link
            reads = [self._listener if link is None else link.connection]
            select.select(reads, [link.connection] if link is not None and link.is_behind else [], [], left_s)

    def peers(self) -> Peers:
        """Returns which ROS 1 nodes are connected, as the bridge process told last."""
        self._look()
        return self._peers

    def close(self) -> None:
        """Disconnects from the ROS 1 nodes; a second call does nothing."""
        # The socket's file first: a bridge looks whether it is there when its connection ends.
        if self._listener is not None:
            self._listener.close()
            self._listener = None
        if self._link is not None:
            self._link.connection.close()
            self._link = None
        self._peers = Peers()

    def _frame(self, number: int, topic: Topic, message: bytes) -> bytes:
        content = _ros2().cdr_to_ros1(message, topic.ros_type)
        if _has_header(topic.ros_type):  # ROS 1 numbers messages there, and some nodes look at that
            self._sent[topic.name] += 1
            content = b"".join((_SEQUENCE.pack(self._sent[topic.name] & 0xFFFFFFFF), content[_SEQUENCE.size :]))
        length = TOPIC.size + len(content)
        if length > MOST_BYTES[MESSAGE]:
            raise ValueError(f"a message of {topic.name} has {length} bytes; there may be {MOST_BYTES[MESSAGE]}")
        return b"".join((HEADER.pack(length, MESSAGE), TOPIC.pack(number), content))

    def _look(self) -> None:
        """Polls the bridge process: reads its messages, sends queued ones, and accepts a new connection."""
        if self._listener is None:
            return
        if self._link is not None:
            self._read(self._link)
            self._flush()
        while (connection := self._listener.accept_waiting()) is not None:
            if self._link is not None:
                connection.close()  # there is one already
                continue
            self._greet(connection)

    def _greet(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        self.connections += 1
        self._link = _Link(connection, self._hello, self.dropped)
        self.name = "ROS 1, whose bridge has just connected"
        for name, frame in self._latched.items():
            self._link.add(self._topics[self._numbers[name]], frame)
        self._flush()

    def _flush(self) -> None:
        if self._link is not None:
            try:
                self._link.flush()
            except OSError as error:
                self._lose(str(error))

    def _read(self, link: "_Link") -> None:
        try:
            for kind, content in link.frames():
                self._understand(kind, content)
        except EOFError:
            self._lose("it closed the connection")
        except (OSError, ValueError, ProtocolError) as error:
            self._lose(str(error))

    def _understand(self, kind: int, content: memoryview) -> None:
        """Applies a frame of the bridge process: a velocity command, or the state of the nodes.

        Raises:
            ValueError: The content is not a frame of the protocol.
        """
        if kind == COMMAND:
            if len(content) != VELOCITY.size:
                raise ValueError(f"a command has {len(content)} bytes, not {VELOCITY.size}")
            x, y, z, roll, pitch, yaw, stamp_s = VELOCITY.unpack(content)
            self._commands.append(Command((x, y, z), (roll, pitch, yaw), None if stamp_s != stamp_s else stamp_s))
            return
        try:
            state = json.loads(bytes(content))
        except (ValueError, RecursionError) as error:
            raise ValueError(f"its state is no JSON: {type(error).__name__}") from None
        if not isinstance(state, dict):
            raise ValueError("its state is no object of JSON")
        if (waits_for := state.get("waits_for")) is not None:
            self._peers = Peers()
            self.name = f"ROS 1, whose bridge waits for {str(waits_for)[:_SHOWN]}"
            return
        self._peers = _peers_in(state, self._numbers)
        self.name = "ROS 1"

    def _lose(self, why: str) -> None:
        if self._link is not None:
            self._link.connection.close()
        self._link, self._peers = None, Peers()
        self.name = "ROS 1, whose bridge ended and has not come back"
        _logger.warning("the bridge to ROS 1 is gone: %s", why[:_SHOWN])


class _Link:
    """Connection to a bridge process that never waits: messages are queued, and dropped if the process is too slow."""

    def __init__(self, connection: socket.socket, greeting: bytes, dropped: Counter[str]) -> None:
        """Prepares the connection to a bridge process; the greeting is the first that is sent on it."""
        self.connection = connection
        self._frames = FrameBuffer({kind: MOST_BYTES[kind] for kind in (COMMAND, STATE)})
        self._begun = memoryview(greeting)
        """Remaining bytes of the frame that is being sent."""
        self._waiting: deque[tuple[Topic, bytes]] = deque()
        self._counts: Counter[str] = Counter()
        self._dropped = dropped

    @property
    def is_behind(self) -> bool:
        """Whether messages wait to be sent to the bridge process."""
        return bool(self._begun or self._waiting)

    def add(self, topic: Topic, frame: bytes) -> None:
        """Queues a message; the oldest of its topic is dropped if the bridge process is too slow.

        Of a latched topic only the last message is kept, which nodes that connect later get.
        """
        if self._counts[topic.name] >= (1 if topic.is_latched else topic.depth):
            oldest = next(index for index, (other, _) in enumerate(self._waiting) if other.name == topic.name)
            del self._waiting[oldest]
            self._counts[topic.name] -= 1
            if not topic.is_latched:
                self._dropped[topic.name] += 1
        self._waiting.append((topic, frame))
        self._counts[topic.name] += 1

    def flush(self) -> None:
        """Sends as many queued messages as the bridge process can take now.

        Raises:
            OSError: The bridge process has gone.
        """
        with suppress(BlockingIOError):
            while True:
                while self._begun:
                    self._begun = self._begun[self.connection.send(self._begun) :]
                if not self._waiting:
                    return
                topic, frame = self._waiting.popleft()
                self._counts[topic.name] -= 1
                self._begun = memoryview(frame)

    def frames(self) -> list[tuple[int, memoryview]]:
        """Returns the messages that the bridge process has sent.

        Raises:
            EOFError: The bridge process has closed the connection.
            OSError: The bridge process has gone.
            ProtocolError: The bridge process sent a frame that is not of the protocol.
        """
        found = []
        for _ in range(_READS):
            try:
                count = self.connection.recv_into(self._frames.space())
            except BlockingIOError:
                break
            if count == 0:
                if found:
                    break  # the end is seen the next time
                raise EOFError
            self._frames.received(count)
            while (frame := self._frames.next()) is not None:
                found.append((frame[0], memoryview(bytes(frame[1]))))
        return found


def _peers_in(state: Mapping[str, Any], topics: Mapping[str, int]) -> Peers:
    """Returns the ROS nodes that a state message of the bridge reports.

    Raises:
        ValueError: The object is not a state message of the bridge process.
    """
    heard, commanders, mistyped = state.get("heard"), state.get("commanders"), state.get("mistyped")
    if not (isinstance(heard, list) and isinstance(commanders, int) and isinstance(mistyped, dict)):
        raise ValueError("its state has no heard, commanders and mistyped")
    wrong = {str(topic)[:_SHOWN]: str(kind)[:_SHOWN] for topic, kind in [*mistyped.items()][:_MOST_NAMED]}
    return Peers(frozenset(name for name in topics if name in heard), max(commanders, 0), wrong)


@cache
def _ros2() -> Typestore:
    """Returns the ROS 2 types for reading messages: their header has no sequence number, unlike in ROS 1."""
    return get_typestore(Stores.ROS2_HUMBLE)


@cache
def _ros1() -> Typestore:
    store = get_typestore(Stores.ROS1_NOETIC)
    # It is in a package of its own in ROS 1, which the store leaves out.
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms\n", "tf2_msgs/msg/TFMessage"))
    return store


@cache
def ros1_definition(ros_type: str) -> tuple[str, str]:
    """Returns the ROS 1 definition of a message type, and its MD5 sum.

    Args:
        ros_type: Message type in ROS 2's form.

    Raises:
        LaunchError: ROS 1 has no such type, or another of that name.
    """
    if ros_type not in _ros1().fielddefs:
        raise LaunchError(f"ROS 1 has no type {ros_type.replace('/msg/', '/')}, so that nodes cannot be sent it")
    if _layout(_ros1(), ros_type) != _layout(_ros2(), ros_type):
        raise LaunchError(f"{ros_type} has other fields in ROS 1 than in ROS 2, so that nodes cannot be sent it")
    return _ros1().generate_msgdef(ros_type)


@cache
def _has_header(ros_type: str) -> bool:
    fields = _ros2().fielddefs[ros_type][1]
    return bool(fields) and fields[0][1] == (Nodetype.NAME, _HEADER)


def _layout(store: Typestore, ros_type: str) -> tuple[Any, ...]:
    """Returns the types of a message's fields, nested ones included, without fields that only ROS 1 has."""
    fields = store.fielddefs[ros_type][1]
    return tuple(
        _part(store, part)
        for name, part in fields
        if (ros_type, name) != (_HEADER, "seq") and name != "structure_needs_at_least_one_member"
    )


def _part(store: Typestore, part: Any) -> Any:
    kind, about = part
    if kind == Nodetype.NAME:
        return _layout(store, about)
    if kind == Nodetype.BASE:
        return about[0]
    return int(kind), about[1], _part(store, about[0])
