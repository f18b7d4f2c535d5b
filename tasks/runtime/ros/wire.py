"""Interface of a connection from a simulation to ROS nodes: publishes topics, receives velocity commands."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol


class Topic(NamedTuple):
    """A ROS topic that the simulation publishes: name, type, and quality of service."""

    name: str
    """Topic name with its slash, such as `/scan`."""

    ros_type: str
    """Message type in ROS 2's form, such as `sensor_msgs/msg/LaserScan`."""

    is_latched: bool = False
    """Whether nodes that subscribe later get the last message: `transient local` in ROS 2, `latch` in ROS 1."""

    depth: int = 10
    """Number of messages that are kept for a slow subscriber (QoS history depth)."""

    is_on_demand: bool = False
    """Whether messages are so expensive that they are made only if a node subscribes."""


Vector = tuple[float, float, float]
STILL: Vector = (0.0, 0.0, 0.0)


class Command(NamedTuple):
    """A velocity command of a ROS node, from `geometry_msgs/Twist` or `TwistStamped`."""

    linear_mps: Vector
    """Linear velocity along x, y and z of the robot's base, in m/s."""

    angular_radps: Vector
    """Angular velocity about the axes of the robot's base, in rad/s."""

    stamp_s: float | None = None
    """Time stamp of the message in seconds; None if it has no header."""


@dataclass(frozen=True)
class Peers:
    """Facts about connected ROS nodes: topics that they hear, senders of commands, and commands of a wrong type."""

    heard: frozenset[str] = frozenset()
    """Topics of the simulation that at least one node subscribes to."""

    commanders: int = 0
    """Number of publishers of the command topic."""

    mistyped: Mapping[str, str] = field(default_factory=dict)
    """Unsupported message types of publishers of the command topic, by topic name."""

    elsewhere: Mapping[str, str] = field(default_factory=dict)
    """Message types of velocity commands on other topics, by topic name; a bridge of ROS 1 tells none."""

    has_ros_nodes: bool = True
    """Whether a node of ROS is among them, and not only programs that speak DDS by themselves."""

    @property
    def not_taken(self) -> list[str]:
        """Publishers whose commands are not taken, as `/cmd_vel with std_msgs/msg/String`."""
        return [f"{topic} with {kind}" for topic, kind in {**self.mistyped, **self.elsewhere}.items()]


class Wire(Protocol):
    """Interface of a connection from the simulation to ROS nodes.

    All methods are called by the simulation thread; only `wait` blocks.
    """

    name: str
    """Name of the connection in messages: `ROS 2, domain 7`."""

    def open(self, topics: Sequence[Topic], command_topic: str) -> None:
        """Announces topics, and subscribes the velocity commands.

        Raises:
            LaunchError: The topics cannot be announced; the message says what would help.
        """
        ...

    def send(self, topic: str, message: bytes) -> None:
        """Publishes a message to the ROS nodes that subscribe to a topic.

        Args:
            topic: Name of an announced topic.
            message: The message in CDR, little endian, with its encapsulation header of four bytes.
        """
        ...

    def take(self) -> list[Command]:
        """Returns the velocity commands received since the last call, oldest first."""
        ...

    def wait(self, timeout_s: float) -> bool:
        """Waits until a velocity command arrives, at most for a time in seconds; returns whether one did."""
        ...

    def peers(self) -> Peers:
        """Returns the topics that connected ROS nodes hear, and number and wrong types of publishers of commands."""
        ...

    def close(self) -> None:
        """Disconnects from the ROS nodes; a second call does nothing."""
        ...
