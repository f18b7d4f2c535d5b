"""Connection from a simulation to ROS 2 nodes over DDS, without ROS installed."""

import math
from collections.abc import Sequence
from typing import Any

from ..recording.cdr import decode
from .dds import Participant, Reach, Reader, Waiter, Writer
from .wire import Command, Peers, Topic

TWIST, TWIST_STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
"""ROS types of velocity commands. In DDS one topic name with two types is two topics, so that each has a subscriber."""

_OF_ALL_NODES = ("/rosout", "/parameter_events")
"""Topics that each node of ROS 2 publishes, unless it is told to leave out one of them."""
_NO_NUMBERS = (math.nan, math.nan, math.nan)


class DdsWire:
    """Connection from the simulation to the ROS 2 nodes of one domain over DDS: an implementation of `Wire`."""

    def __init__(self, domain: int, reach: Reach, *, is_reliable: bool = False) -> None:
        """Stores the settings of a connection to ROS 2 nodes; nothing is announced before `open`.

        Args:
            domain: ROS 2 domain id of the nodes.
            reach: Machines and interfaces on which the nodes are discovered.
            is_reliable: Whether the command subscriber is reliable, which best-effort publishers do not match.
        """
        self.name = f"ROS 2, domain {domain}"
        self._domain, self._reach, self._is_reliable = domain, reach, is_reliable
        self._participant: Participant | None = None
        self._writers: dict[str, Writer] = {}
        self._readers: list[tuple[str, Reader]] = []
        self._waiter: Waiter | None = None
        self._command_topic = ""
        self._own = b""

    def open(self, topics: Sequence[Topic], command_topic: str) -> None:
        """Joins the ROS 2 domain, announces topics, and subscribes the velocity commands; see `Wire`.

        Args:
            topics: Topics that the simulation publishes.
            command_topic: Topic of the velocity commands, with or without stamp.
        """
        participant = self._participant = Participant(self._domain, self._reach, is_simulation=True)
        self._own, self._command_topic = participant.prefix, command_topic
        for kind in (TWIST, TWIST_STAMPED):
            self._readers.append((kind, participant.reader(command_topic, kind, is_reliable=self._is_reliable)))
        self._waiter = participant.waiter([reader for _, reader in self._readers])
        for topic in topics:
            self._writers[topic.name] = participant.writer(
                topic.name, topic.ros_type, is_latched=topic.is_latched, depth=topic.depth
            )

    def send(self, topic: str, message: bytes) -> None:
        """Publishes a message (CDR) on an announced ROS 2 topic; see `Wire`."""
        self._writers[topic].write(message)

    def take(self) -> list[Command]:
        """Returns the velocity commands received since the last call, in the order in which they were sent; see `Wire`.

        A message that cannot be read is returned as a command without numbers.
        """
        found: list[tuple[int, Command]] = []
        for kind, reader in [each for each in self._readers if each[1].has_news]:
            for data, published_ns in reader.take():
                try:
                    found.append((published_ns, _command(decode(data, kind), kind)))
                except ValueError:  # told as a command that no robot can carry out
                    found.append((published_ns, Command(_NO_NUMBERS, _NO_NUMBERS)))
        found.sort(key=lambda each: each[0])
        return [command for _, command in found]

    def wait(self, timeout_s: float) -> bool:
        """Waits for a velocity command, at most for a time in seconds; returns whether one came. See `Wire`."""
        assert self._waiter is not None
        return self._waiter.wait(timeout_s)

    def peers(self) -> Peers:
        """Returns which topics ROS nodes hear, how many send commands, and topics with a wrong type; see `Wire`."""
        assert self._participant is not None
        publications = [each for each in self._participant.publications() if each.participant != self._own]
        of_commands = [each for each in publications if each.topic == self._command_topic]
        others = {each.topic: each.ros_type for each in of_commands if each.ros_type not in (TWIST, TWIST_STAMPED)}
        if self._is_reliable:
            others |= {each.topic: f"best effort {each.ros_type}" for each in of_commands if not each.is_reliable}
        return Peers(
            heard=frozenset(topic for topic, writer in self._writers.items() if writer.readers),
            commanders=sum(reader.writers for _, reader in self._readers),
            mistyped=others,
            elsewhere={
                each.topic: each.ros_type
                for each in publications
                if each.ros_type in (TWIST, TWIST_STAMPED) and each.topic != self._command_topic
            },
            has_ros_nodes=any(each.topic in _OF_ALL_NODES for each in publications),
        )

    def close(self) -> None:
        """Leaves the ROS 2 domain, which disconnects from the nodes; a second call does nothing; see `Wire`."""
        participant, self._participant = self._participant, None
        if participant is not None:
            participant.close()


def _command(message: Any, kind: str) -> Command:
    stamp_s = None
    if kind == TWIST_STAMPED:
        stamp = message.header.stamp
        stamp_s, message = stamp.sec + stamp.nanosec * 1e-9, message.twist
    linear, angular = message.linear, message.angular
    return Command((linear.x, linear.y, linear.z), (angular.x, angular.y, angular.z), stamp_s)
