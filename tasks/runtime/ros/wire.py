"""The way from a simulation to ROS nodes: topics out, velocity commands in."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol


class Topic(NamedTuple):
    """A ROS topic that the simulation publishes."""

    name: str
    """With its slash: `/scan`."""

    ros_type: str
    """Type in ROS 2's form: `sensor_msgs/msg/LaserScan`."""

    is_latched: bool = False
    """Whether nodes that subscribe later get the last message: `transient local` in ROS 2, `latch` in ROS 1."""

    depth: int = 10
    """Messages that are kept for a slow reader."""

    is_on_demand: bool = False
    """Whether it costs so much that it is made only where a node listens."""


Vector = tuple[float, float, float]
STILL: Vector = (0.0, 0.0, 0.0)


class Command(NamedTuple):
    """A velocity command of a ROS node, from `geometry_msgs/Twist` or `TwistStamped`."""

    linear_mps: Vector
    """Along x, y and z of the robot's base, metres a second."""

    angular_radps: Vector
    """About its axes, radians a second."""

    stamp_s: float | None = None
    """Time in its header, seconds; none where it has no header."""


@dataclass(frozen=True)
class Peers:
    """The ROS nodes that the simulation knows of."""

    heard: frozenset[str] = frozenset()
    """Topics of the simulation that at least one node subscribes."""

    commanders: int = 0
    """Publishers of the command topic."""

    mistyped: Mapping[str, str] = field(default_factory=dict)
    """Types of publishers of the command topic that cannot be understood, by the name of their topic."""


class Wire(Protocol):
    """Interface of a connection from the simulation to ROS nodes.

    All methods are called by the thread that simulates; none but `wait` waits.
    """

    name: str
    """Its name in messages: `ROS 2, domain 7`."""

    def open(self, topics: Sequence[Topic], command_topic: str) -> None:
        """Announces topics, and subscribes the velocity commands.

        Raises:
            LaunchError: The topics cannot be announced; the message says what would help.
        """
        ...

    def send(self, topic: str, message: bytes) -> None:
        """Publishes a message: CDR, little endian, with its encapsulation header of four bytes."""
        ...

    def take(self) -> list[Command]:
        """Returns the velocity commands received since the last call, oldest first."""
        ...

    def wait(self, timeout_s: float) -> bool:
        """Waits until a velocity command is there; returns whether one is."""
        ...

    def peers(self) -> Peers:
        """Returns which ROS nodes are connected."""
        ...

    def close(self) -> None:
        """Disconnects from the ROS nodes; a second call does nothing."""
        ...
