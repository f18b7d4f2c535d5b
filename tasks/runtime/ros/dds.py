"""DDS for ROS 2 with Eclipse Cyclone DDS: participants, publishers and subscribers of messages as bytes.

Writing and reading bytes needs two private functions of `cyclonedds`, which only this module uses, so that exactly one
release is supported. Names and QoS are those of ROS 2's middleware interface (`rmw`); comments explain the pitfalls.
"""

# cyclonedds' decorators hide the types of what they make.
# pyright: reportMissingTypeStubs=false, reportAttributeAccessIssue=false, reportUnknownMemberType=false
# pyright: reportPrivateImportUsage=false

import os
import types
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import metadata
from typing import Any, NamedTuple
from xml.sax.saxutils import quoteattr

from rosbags.interfaces import Nodetype

from ....schemas.extras import how_to_install
from ....schemas.wire.errors import LaunchError
from ..recording.cdr import fields_of, is_known, type_hash

CYCLONEDDS = "11.0.1"
"""Required release of `cyclonedds`: its private functions are known, and it is the first with `IgnoreTypeInformation`.
"""

RECORDER_MARK = b"robomaker=recorder;"
"""DDS user data of the subscribers that record topics."""
SIMULATION_MARK = b"robomaker=simulation;"
"""DDS user data of a simulation's participant: its topics are already in its own recording."""
_ENCLAVE = b"enclave=/;"
"""DDS user data that every ROS 2 participant has."""
_WRITE_BLOCKED_MS = 100
"""Milliseconds for which a reliable subscriber with full buffers blocks a publisher, as in ROS 2."""
_MAX_TAKEN = 64
"""Maximum number of messages taken at once."""
_ANY_STATE = 0x7F
"""Mask of all sample, view and instance states."""

_PRIMITIVES = {
    **{name: name for name in ("int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64")},
    "float32": "float32",
    "float64": "float64",
    "byte": "uint8",
    "octet": "uint8",
    "char": "uint8",
}


class Publication(NamedTuple):
    """A publisher of a ROS topic that was discovered over DDS, with its type and quality of service."""

    topic: str
    """Name of the topic in ROS, such as `/scan`; DDS topics that are not of ROS are left out."""

    ros_type: str
    """Message type in ROS 2's form, such as `sensor_msgs/msg/LaserScan`."""

    type_hash: str
    """Type hash `RIHS01_…` (REP 2011); empty if the node announces none."""

    is_reliable: bool
    is_latched: bool
    participant: bytes
    """Prefix of the publisher's GUID, the same for all publishers and subscribers of one participant."""


def dds_type_name(ros_type: str) -> str:
    """Converts a ROS type, `sensor_msgs/msg/LaserScan`, to its DDS name, `sensor_msgs::msg::dds_::LaserScan_`."""
    package, kind, name = ros_type.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def ros_type_name(dds_type: str) -> str | None:
    """Converts a DDS type name to the ROS message type; `None` if it is not a ROS type."""
    parts = dds_type.split("::")
    if len(parts) != 4 or parts[2] != "dds_" or not parts[3].endswith("_"):
        return None
    return f"{parts[0]}/{parts[1]}/{parts[3][:-1]}"


@dataclass(frozen=True)
class Reach:
    """Machines and network interfaces on which ROS 2 nodes (DDS participants) are discovered."""

    peers: tuple[str, ...] = ()
    """Addresses of other machines to discover nodes on."""

    interface: str | None = None
    """Name of the network interface; none: loopback only."""


def configuration(reach: Reach) -> str:
    """Returns the XML configuration of Cyclone DDS: loopback only, unless other machines are to be discovered.

    Args:
        reach: Machines and network interface with which nodes are to be connected.
    """
    interfaces = '<NetworkInterface name="lo" multicast="false"/>'
    multicast = "false"
    if reach.interface is not None:
        interfaces, multicast = f"<NetworkInterface name={quoteattr(reach.interface)}/>", "spdp"
    peers = "".join(f"<Peer Address={quoteattr(each)}/>" for each in dict.fromkeys(("127.0.0.1", *reach.peers)))
    return (
        '<CycloneDDS><Domain Id="any">'
        f"<General><Interfaces>{interfaces}</Interfaces><AllowMulticast>{multicast}</AllowMulticast></General>"
        # Each participant of a domain on this host takes an index; the default admits ten.
        "<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>60</MaxAutoParticipantIndex>"
        # Nodes whose own search does not reach loopback are found by ours; the default is 8 s.
        "<SPDPInterval>1s</SPDPInterval>"
        f"<Peers>{peers}</Peers></Discovery>"
        # Fast DDS answers type information with its own, and Cyclone then waits for ever or refuses: Jazzy got
        # nothing at all, Kilted only types without strings and sequences. 1.15 is eProsima's number as a vendor, 1.1
        # RTI's. 1.16 is Cyclone's own: the recorder reads what the simulation and others of Cyclone write by name only.
        "<Compatibility><IgnoreTypeInformation>1.15,1.1,1.16</IgnoreTypeInformation></Compatibility>"
        "</Domain></CycloneDDS>"
    )


def _checked_release() -> None:
    try:
        found = metadata.version("cyclonedds")
    except metadata.PackageNotFoundError:
        raise LaunchError(
            "ROS 2 nodes are reached by cyclonedds, which is not installed here (PyPI has wheels for x86-64 with "
            f"Python 3.11 and 3.12): {how_to_install('ros')}"
        ) from None
    if found != CYCLONEDDS:
        raise LaunchError(
            f"ROS 2 nodes are reached by cyclonedds {CYCLONEDDS}, and {found} is installed: {how_to_install('ros')}"
        )


class Participant:
    """Participant in a ROS 2 domain (DDS), which publishes and subscribes topics."""

    def __init__(self, domain: int, reach: Reach, *, is_simulation: bool = False) -> None:
        """Joins a ROS 2 domain as a participant of Cyclone DDS.

        The environment variable `CYCLONEDDS_URI` is changed during the call; the user's own settings come first.

        Args:
            domain: Domain id, 0 to 232.
            reach: Machines and interfaces on which others are discovered.
            is_simulation: Whether this is a simulation's participant, whose topics are in its own recording.

        Raises:
            LaunchError: Cyclonedds is missing or another release, or the domain cannot be joined; says why.
        """
        _checked_release()
        from cyclonedds import core
        from cyclonedds import domain as domains
        from cyclonedds.qos import Policy, Qos

        qos = Qos(Policy.Userdata(_ENCLAVE + SIMULATION_MARK)) if is_simulation else None
        before = os.environ.get("CYCLONEDDS_URI")
        own = configuration(reach)
        # Read when a process first joins a domain: what users have set comes first, ours is added.
        os.environ["CYCLONEDDS_URI"] = f"{before},{own}" if before else own
        try:
            self._entity: Any = domains.DomainParticipant(domain, qos)
        except core.DDSException as error:
            raise LaunchError(
                f"ROS domain {domain} cannot be joined: {error.msg or error}; at most 60 participants of a domain fit "
                f"on one machine, and interface {reach.interface or 'lo'} has to be up"
            ) from error
        finally:
            if before is None:
                del os.environ["CYCLONEDDS_URI"]
            else:
                os.environ["CYCLONEDDS_URI"] = before
        self._publications: Any = None
        self._found: dict[bytes, Publication] = {}
        self._types: dict[str, Any] = {}

    def writer(self, topic: str, ros_type: str, *, is_latched: bool, depth: int) -> "Writer":
        """Creates a reliable publisher of a ROS topic in this participant's domain.

        Args:
            topic: Name of the topic, such as `/scan`.
            ros_type: ROS type of its messages.
            is_latched: Whether subscribers that come later get the last messages.
            depth: Number of messages that are kept for subscribers.
        """
        from cyclonedds import pub
        from cyclonedds.topic import Topic

        kind = self._type(ros_type)
        qos = _qos(is_reliable=True, is_latched=is_latched, depth=depth, ros_type=ros_type)
        return Writer(pub.DataWriter(self._entity, Topic(self._entity, f"rt{topic}", kind), qos=qos))

    def reader(
        self, topic: str, ros_type: str, *, is_reliable: bool = False, is_latched: bool = False, depth: int = 10
    ) -> "Reader":
        """Creates a subscriber of a ROS topic in this participant's domain.

        Args:
            topic: Name of the topic, such as `/cmd_vel`.
            ros_type: ROS type of its messages.
            is_reliable: Whether only reliable publishers are heard, whose lost messages are sent again.
            is_latched: Whether the last messages from before the subscription are wanted.
            depth: Number of messages that are kept until they are taken.
        """
        from cyclonedds import sub
        from cyclonedds.topic import Topic

        qos = _qos(is_reliable=is_reliable, is_latched=is_latched, depth=depth, ros_type=None)
        kind = self._type(ros_type)
        return Reader(sub.DataReader(self._entity, Topic(self._entity, f"rt{topic}", kind), qos=qos))

    def _type(self, ros_type: str) -> Any:
        if ros_type not in self._types:
            self._types[ros_type] = idl_type(ros_type, self._types) if is_known(ros_type) else named_type(ros_type)
        return self._types[ros_type]

    def publications(self) -> list[Publication]:
        """Lists the publishers of ROS topics that are in the domain now, including this participant's own."""
        from cyclonedds import builtin

        if self._publications is None:
            self._publications = builtin.BuiltinDataReader(self._entity, builtin.BuiltinTopicDcpsPublication)
        for sample in self._publications.take(N=_MAX_TAKEN):
            if (found := _publication(sample)) is not None:
                self._found[sample.key.bytes] = found
            elif not sample.sample_info.valid_data or _has_left(sample):
                self._found.pop(sample.key.bytes, None)
        return list(self._found.values())

    @property
    def entity(self) -> Any:
        """The DDS participant as an object of `cyclonedds`."""
        return self._entity

    @property
    def prefix(self) -> bytes:
        """Prefix of the participant's DDS id (GUID), by which its own publishers are recognised."""
        return self._entity.get_guid().bytes[:12]

    def waiter(self, readers: "Sequence[Reader]") -> "Waiter":
        """Returns an object that waits for messages of some subscribers of this participant."""
        return Waiter(self._entity, readers)

    def close(self) -> None:
        """Leaves the domain, with all publishers and subscribers."""
        entity, self._entity = self._entity, None
        if entity is not None:
            self._publications = None
            entity._delete(entity._ref)  # at once: the collector would only do so when the last writer is gone


class Waiter:
    """Waits for messages of some DDS subscribers."""

    def __init__(self, entity: Any, readers: "Sequence[Reader]") -> None:
        from cyclonedds.core import ReadCondition, WaitSet
        from cyclonedds.util import duration

        self._duration, self._waiting = duration, WaitSet(entity)
        self._conditions = [ReadCondition(reader.entity, _ANY_STATE) for reader in readers]
        for condition in self._conditions:
            self._waiting.attach(condition)

    def wait(self, timeout_s: float) -> bool:
        """Waits until a subscriber has a message, at most for a time in seconds; returns whether one has."""
        return self._waiting.wait(self._duration(seconds=timeout_s)) > 0


class Writer:
    """Publisher of a ROS topic over DDS, with messages as bytes."""

    def __init__(self, entity: Any) -> None:
        from cyclonedds._clayer import ddspy_write

        self._entity, self._write = entity, ddspy_write
        self._recorders: dict[int, bool] = {}
        """Whether each matched subscriber is a topic recorder, by its handle."""

    def write(self, message: bytes) -> None:
        """Publishes a message (CDR with encapsulation header).

        Padding is added to a message that is no whole number of words.
        """
        if padding := -len(message) % 4:
            # Cyclone wants whole words; the header's last two bits say how many bytes are none of the message.
            message = message[:3] + bytes((padding,)) + message[4:] + b"\0" * padding
        self._write(self._entity._ref, message)

    @property
    def readers(self) -> int:
        """Number of matched subscribers, not counting the topic recorder."""
        return sum(not self._is_recorder(handle) for handle in self._entity.get_matched_subscriptions())

    @property
    def listeners(self) -> int:
        """Number of matched subscribers, counting the topic recorder."""
        return len(self._entity.get_matched_subscriptions())

    def _is_recorder(self, handle: int) -> bool:
        if handle not in self._recorders:
            told = self._entity.get_matched_subscription_data(handle)
            self._recorders[handle] = told is not None and RECORDER_MARK in user_data(told.qos)
        return self._recorders[handle]


class Received(NamedTuple):
    """A received DDS message as bytes, with its publisher, and the time at which it was sent, in ns since 1970."""

    sent_ns: int
    """Time of publication in nanoseconds since 1970, by the publisher's clock."""

    writer: int
    """Local handle of the message's publisher."""

    data: bytes
    """CDR bytes of the message with encapsulation header."""


def without_padding(message: bytes) -> bytes:
    """Returns a CDR message without the padding bytes that its header declares."""
    padding = message[3] & 3 if len(message) > 3 else 0
    return message[:3] + b"\0" + message[4:-padding] if padding else message


class Reader:
    """Subscriber of a ROS topic over DDS, with messages as bytes."""

    def __init__(self, entity: Any) -> None:
        from cyclonedds._clayer import ddspy_take
        from cyclonedds.core import DDSStatus

        self.entity, self._take = entity, ddspy_take
        self._data_available = DDSStatus.DataAvailable

    @property
    def has_news(self) -> bool:
        """Returns whether a message has arrived since the last `take`; five times faster than taking none."""
        return bool(self.entity.get_status_changes() & self._data_available)

    def take(self) -> Iterator[tuple[bytes, int]]:
        """Yields the received messages, each with its publication time in nanoseconds since 1970."""
        while not isinstance(taken := self._take(self.entity._ref, _ANY_STATE, _MAX_TAKEN), int):
            for data, info in taken:
                if info.valid_data:
                    yield bytes(data), int(info.source_timestamp)
            if len(taken) < _MAX_TAKEN:
                return

    def take_received(self, most: int) -> "list[Received]":
        """Returns received messages with source and time.

        Args:
            most: Maximum number of messages.
        """
        taken = self._take(self.entity._ref, _ANY_STATE, most)
        if isinstance(taken, int):
            return []
        return [
            Received(info.source_timestamp, info.publication_handle, without_padding(data))
            for data, info in taken
            if info.valid_data
        ]

    @property
    def writers(self) -> int:
        """Number of publishers that match this DDS subscriber."""
        return len(self.entity.get_matched_publications())


def _qos(*, is_reliable: bool, is_latched: bool, depth: int, ros_type: str | None) -> Any:
    from cyclonedds.qos import Policy, Qos
    from cyclonedds.util import duration

    reliable = Policy.Reliability.Reliable(duration(milliseconds=_WRITE_BLOCKED_MS))
    policies = [
        reliable if is_reliable else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal if is_latched else Policy.Durability.Volatile,
        Policy.History.KeepLast(depth),
    ]
    if ros_type is not None:  # `ros2 topic info -v` and recorders read it
        policies.append(Policy.Userdata(f"typehash={type_hash(ros_type)};".encode()))
    return Qos(*policies)


def user_data(qos: Any) -> bytes:
    """Returns the user data bytes that a DDS participant, publisher or subscriber announces."""
    from cyclonedds.qos import Policy

    return bytes(qos[Policy.Userdata].data) if qos is not None and Policy.Userdata in qos else b""


def named_type(ros_type: str) -> Any:
    """Returns a DDS type that has only the ROS type's name, for peers without type information."""
    from cyclonedds.idl.types import uint8

    return _struct(ros_type, {"anything": uint8})


def idl_type(ros_type: str, known: dict[str, Any]) -> Any:
    """Makes the complete DDS type of a ROS type, for tools that read type information.

    Args:
        ros_type: ROS message type, such as `geometry_msgs/msg/Twist`.
        known: Types that were made before; newly needed types are added.
    """
    if ros_type not in known:
        members = {name: _idl_member(kind, known) for name, kind in fields_of(ros_type)}
        if not members:  # as ROS's own generator does for empty messages
            members = {"structure_needs_at_least_one_member": _idl_types().uint8}
        known[ros_type] = _struct(ros_type, members)
    return known[ros_type]


def _idl_types() -> Any:
    from cyclonedds.idl import types as idl_types

    return idl_types


def _idl_member(kind: tuple[int, Any], known: dict[str, Any]) -> Any:
    """Returns the DDS type of a message field from its description by rosbags: base, name, array or sequence.

    Args:
        kind: Description of the field.
        known: Definitions of message types, by name.
    """
    idl, (node, about) = _idl_types(), kind
    match Nodetype(node):
        case Nodetype.BASE:
            name, limit = about
            if name == "string":
                return idl.bounded_str[limit] if limit else str
            return bool if name == "bool" else getattr(idl, _PRIMITIVES[name])
        case Nodetype.NAME:
            return idl_type(about, known)
        case Nodetype.ARRAY:
            return idl.array[_idl_member(about[0], known), about[1]]
        case Nodetype.SEQUENCE:
            item = _idl_member(about[0], known)
            return idl.sequence[item, about[1]] if about[1] else idl.sequence[item]


def _struct(ros_type: str, members: dict[str, Any]) -> Any:
    from cyclonedds.idl import IdlStruct
    from cyclonedds.idl.annotations import final

    name = dds_type_name(ros_type)
    made = types.new_class(
        name.rpartition("::")[2],
        (IdlStruct,),
        {"typename": name.replace("::", ".")},
        lambda space: space.update({"__annotations__": members, "__module__": __name__}),
    )
    return final(dataclass(made))


def _publication(sample: Any) -> Publication | None:
    """Converts a discovery sample of DDS to a ROS publication; None if it is not of ROS, or the publisher has left."""
    topic, kind = getattr(sample, "topic_name", None), getattr(sample, "type_name", None)
    if not topic or not topic.startswith("rt/") or _has_left(sample):
        return None
    ros_type = ros_type_name(kind or "")
    if ros_type is None:
        return None
    policies = {type(policy).__name__: policy for policy in sample.qos}
    told = bytes(getattr(policies.get("Userdata"), "data", b""))
    words = dict(part.split(b"=", 1) for part in told.split(b";") if b"=" in part)
    return Publication(
        topic=topic.removeprefix("rt"),
        ros_type=ros_type,
        type_hash=words.get(b"typehash", b"").decode(errors="replace"),
        is_reliable=any("Reliable" in repr(policy) for policy in sample.qos),
        is_latched=any("TransientLocal" in repr(policy) for policy in sample.qos),
        participant=sample.participant_key.bytes[:12],
    )


def _has_left(sample: Any) -> bool:
    """Returns whether a discovery sample reports that the publisher has left."""
    info = getattr(sample, "sample_info", None)
    state = getattr(info, "instance_state", None)
    with suppress(TypeError, ValueError):
        return state is not None and int(state) != 16  # `InstanceState.Alive`
    return False
