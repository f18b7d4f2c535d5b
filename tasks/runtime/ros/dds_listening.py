"""Listening to a whole ROS 2 domain: all publishers, their messages, and service calls to nodes."""

# cyclonedds' decorators hide the types of what they make.
# pyright: reportMissingTypeStubs=false, reportAttributeAccessIssue=false, reportUnknownMemberType=false

import time
from contextlib import suppress
from typing import Any, NamedTuple

from .dds import RECORDER_MARK, SIMULATION_MARK, Participant, Reach, Reader, Received, Writer, named_type, user_data

_AT_ONCE = 100
_BLOCKED_NS = 100_000_000
_NANOSECONDS = 1_000_000_000
_HASH = b"typehash="
_MATCH_PAUSE_S = 0.4
"""Seconds to wait after a subscriber and a publisher have matched: the other side learns of it later, and messages
before that are lost.
"""
_ASK_AGAIN_S = 2.0
_REPLIES = 10


class Announced(NamedTuple):
    """A publisher of any DDS topic that was discovered in the domain, with its type and quality of service."""

    writer: int
    """Handle of the publisher, as in its messages."""

    participant: str
    """Id of the publisher's DDS participant (a process, or a part of one)."""

    topic: str
    """DDS topic name, such as `rt/scan`."""

    type: str
    """DDS type name, such as `sensor_msgs::msg::dds_::LaserScan_`."""

    type_hash: str
    """Type hash `RIHS01_…`; empty if the publisher announces none."""

    is_latched: bool
    is_reliable: bool
    depth: int
    """Number of messages that the publisher keeps (QoS history depth)."""


class Subscription:
    """Subscription of one ROS topic of one type by the topic recorder; counts lost messages."""

    def __init__(self, reader: Reader, depth: int) -> None:
        from cyclonedds.core import DDSStatus

        self.reader = reader
        self._depth = depth
        reader.entity.set_status_mask(DDSStatus.DataAvailable)

    def take(self) -> list[Received]:
        """Returns the messages received since the last call."""
        return self.reader.take_received(self._depth) if self.reader.has_news else []

    @property
    def lost(self) -> int:
        """Number of messages that were lost, as far as known."""
        return int(self.reader.entity.get_sample_lost_status().total_count)


class Call:
    """A ROS 2 service call to a node, whose request is repeated until a reply arrives."""

    def __init__(self, writer: Writer, subscription: Subscription, request: bytes) -> None:
        self._writer = writer
        self._replies = subscription
        self._request = request
        self._send_at: float | None = None

    def replies(self) -> list[bytes]:
        """Returns the service's replies received since the last call, and sends the request when it is due, also again.

        The request is sent once the service is connected.
        """
        now = time.monotonic()
        if self._send_at is None:
            if self._writer.readers:
                self._send_at = now + _MATCH_PAUSE_S
        elif now >= self._send_at:
            self._send_at = now + _ASK_AGAIN_S
            self._writer.write(self._request)
        return [each.data for each in self._replies.take()]


class Listener:
    """DDS participant that finds and subscribes all topics of a domain for recording, without being a ROS node."""

    def __init__(self, domain: int, reach: Reach) -> None:
        """Joins a ROS 2 domain, to listen to all of its topics.

        Raises:
            LaunchError: The domain cannot be joined; the message says why.
        """
        from cyclonedds import builtin
        from cyclonedds.core import DDSStatus, WaitSet

        self._participant = Participant(domain, reach)
        entity = self._participant.entity
        self._participants = builtin.BuiltinDataReader(entity, builtin.BuiltinTopicDcpsParticipant)
        self._publications = builtin.BuiltinDataReader(entity, builtin.BuiltinTopicDcpsPublication)
        self._publications.set_status_mask(DDSStatus.DataAvailable)
        self._waits = WaitSet(entity)
        self._waits.attach(self._publications)
        self.simulations: set[str] = set()
        """Ids of the participants that are simulations."""

    def wait(self, timeout_s: float) -> None:
        """Waits for a new publisher or message, with a time limit."""
        self._waits.wait(int(timeout_s * _NANOSECONDS))

    def changes(self) -> list[Announced]:
        """Returns the publishers that appeared in the domain since the last call; also notes which are simulations."""
        from cyclonedds.core import InstanceState

        samples: list[Any] = []
        while found := self._publications.take(N=_AT_ONCE):
            samples += found
        # After that: a publisher's participant is known before it is.
        while found := self._participants.take(N=_AT_ONCE):
            for each in found:
                if each.qos is not None and SIMULATION_MARK in user_data(each.qos):
                    self.simulations.add(str(each.key))
        return [
            _announced(sample)
            for sample in samples
            if sample.sample_info.instance_state == InstanceState.Alive and sample.sample_info.valid_data
        ]

    def subscribe(self, topic: str, type_name: str, depth: int, *, is_latched: bool) -> Subscription:
        """Subscribes a topic for recording, and returns the subscription.

        Args:
            topic: DDS topic name.
            type_name: ROS message type.
            depth: Number of messages that are kept between two takes.
            is_latched: Whether earlier messages are requested (`transient local`).

        Raises:
            ListenError: The topic cannot be subscribed.
        """
        subscription = self._reader(topic, named_type(type_name), depth, is_reliable=is_latched, is_latched=is_latched)
        self._waits.attach(subscription.reader.entity)
        return subscription

    def call(self, service: str, ros_type: str, request: bytes) -> Call:
        """Starts to call a ROS 2 service of a node, and returns the call, which is asked for its replies.

        Args:
            service: Service name without a leading slash, such as `robot/get_type_description`.
            ros_type: Service type, such as `type_description_interfaces/srv/GetTypeDescription`.
            request: CDR bytes of the request with encapsulation header.

        Raises:
            ListenError: The service cannot be called.
        """
        from cyclonedds import core, pub, topic

        replies = named_type(f"{ros_type}_Response")
        subscription = self._reader(f"rr/{service}Reply", replies, _REPLIES, is_reliable=True, is_latched=False)
        try:
            asked = topic.Topic(self._participant.entity, f"rq/{service}Request", named_type(f"{ros_type}_Request"))
            writer = pub.DataWriter(self._participant.entity, asked, qos=_qos(1, is_reliable=True, is_latched=False))
        except core.DDSException as error:
            raise ListenError(str(error)) from error
        return Call(Writer(writer), subscription, request)

    def _reader(self, name: str, kind: Any, depth: int, *, is_reliable: bool, is_latched: bool) -> Subscription:
        from cyclonedds import core, sub, topic

        entity = self._participant.entity
        qos = _qos(depth, is_reliable=is_reliable, is_latched=is_latched)
        try:
            return Subscription(Reader(sub.DataReader(entity, topic.Topic(entity, name, kind), qos=qos)), depth)
        except core.DDSException as error:
            raise ListenError(str(error)) from error


class ListenError(Exception):
    """Raised when a topic or service cannot be subscribed or called; the message says why."""


def _qos(depth: int, *, is_reliable: bool, is_latched: bool) -> Any:
    from cyclonedds.qos import Policy, Qos

    return Qos(
        Policy.Reliability.Reliable(_BLOCKED_NS) if is_reliable else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal if is_latched else Policy.Durability.Volatile,
        Policy.History.KeepLast(depth),
        Policy.Userdata(RECORDER_MARK),
    )


def _announced(sample: Any) -> Announced:
    from cyclonedds.qos import Policy

    qos = sample.qos
    depth = 1
    with suppress(KeyError, AttributeError):
        depth = max(1, int(qos[Policy.History].depth))
    return Announced(
        writer=sample.sample_info.instance_handle,
        participant=str(sample.participant_key),
        topic=sample.topic_name,
        type=sample.type_name,
        type_hash=user_data(qos).partition(_HASH)[2].partition(b";")[0].decode("ascii", "replace"),
        is_latched=Policy.Durability in qos and qos[Policy.Durability] != Policy.Durability.Volatile,
        is_reliable=Policy.Reliability in qos and qos[Policy.Reliability] != Policy.Reliability.BestEffort,
        depth=depth,
    )
