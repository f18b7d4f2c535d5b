"""Messages of fixed size, many at once.

State is published at a steady rate in messages that differ from one time to the next only in their stamp and in some
numbers. So it is kept as columns of numbers, and turned into the records of an MCAP file for a whole chunk at once:
copies of one encoded message, with stamps and numbers put in their places. The bytes are those of `cdr.encode`.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from . import messages as ros
from .cdr import encode
from .mcap_file import RECORD_HEAD_BYTES, TIMES_OFFSET, Rows, message_record

_NANOSECONDS = 1_000_000_000
_DOUBLE = 8
_COVARIANCE = 36 * _DOUBLE
_ZERO = ros.Time(0, 0)

Numbers = NDArray[np.float64]


class Columns(NamedTuple):
    """A kind of message of which only stamp and some numbers change."""

    kind: type[ros.Message]
    """Its type."""

    template: bytes
    """Such a message, encoded."""

    stamp: int
    """Where in it the stamp is."""

    numbers: Mapping[str, tuple[int, int]]
    """By name, where in it a row of doubles begins and how many there are."""


def clock() -> Columns:
    """Returns the columns of `rosgraph_msgs/Clock`: nothing but the time."""
    return Columns(ros.Clock, encode(ros.Clock(_ZERO)), 4, {})


def transform(frame_id: str, child_frame_id: str) -> Columns:
    """Returns the columns of a `tf2_msgs/TFMessage` with one transform.

    Its numbers are `pose`: translation x, y, z and rotation x, y, z, w.
    """
    transform = ros.TransformStamped(ros.Header(_ZERO, frame_id), child_frame_id, ros.Transform())
    template = encode(ros.TFMessage((transform,)))
    return Columns(ros.TFMessage, template, 8, {"pose": (len(template) - 7 * _DOUBLE, 7)})


def odometry(frame_id: str, child_frame_id: str) -> Columns:
    """Returns the columns of `nav_msgs/Odometry` without covariances.

    Its numbers are `pose`, like a transform's, and `twist`: linear x, y, z and angular x, y, z.
    """
    template = encode(ros.Odometry(ros.Header(_ZERO, frame_id), child_frame_id, ros.Pose(), ros.Twist()))
    twist = len(template) - _COVARIANCE - 6 * _DOUBLE
    pose = twist - _COVARIANCE - 7 * _DOUBLE
    return Columns(ros.Odometry, template, 4, {"pose": (pose, 7), "twist": (twist, 6)})


def joint_states(frame_id: str, names: Sequence[str]) -> Columns:
    """Returns the columns of `sensor_msgs/JointState`.

    Its numbers are `position`, `velocity` and `effort`, one of each per joint.

    Raises:
        ValueError: There are no joints.
    """
    if not names:
        raise ValueError("joint states need at least one joint")
    zeros, values = (0.0,) * len(names), len(names) * _DOUBLE
    template = encode(ros.JointState(ros.Header(_ZERO, frame_id), tuple(names), zeros, zeros, zeros))
    # Each array is its length, filled up to eight bytes, and its values; the message ends with the last array.
    effort = len(template) - values
    velocity = effort - _DOUBLE - values
    position = velocity - _DOUBLE - values
    places = {"position": position, "velocity": velocity, "effort": effort}
    return Columns(ros.JointState, template, 4, {name: (place, len(names)) for name, place in places.items()})


class Series(Protocol):
    """A source of messages of fixed size; the recorder asks for them when it writes a chunk."""

    @property
    def topics(self) -> Sequence[tuple[str, Columns]]:
        """What a row of messages has, and on which topics."""
        ...

    def take(self) -> tuple[Numbers, Sequence[Sequence[Numbers]]]:
        """Returns what came since the last time: simulated times, and for each topic its numbers, a row per time."""
        ...


class RowEncoder:
    """Encodes rows: at each time one message on each of some channels."""

    def __init__(self, columns: Sequence[tuple[int, Columns]]) -> None:
        """Prepares the layout.

        Args:
            columns: Channel and kind of the messages, in the order in which a row has them.
        """
        self._starts: dict[int, int] = {}
        self._template = b""
        self._stamps: list[str] = []
        self._times: list[str] = []
        self._numbers: list[list[str]] = []
        fields: dict[str, tuple[Any, int]] = {}
        for channel, item in columns:
            start = self._starts[channel] = len(self._template)
            data = start + RECORD_HEAD_BYTES
            self._template += message_record(channel, 0, item.template)
            fields[f"{channel} times"] = (("<u8", (2,)), start + TIMES_OFFSET)
            fields[f"{channel} stamp"] = ("<u8", data + item.stamp)
            for name, (place, count) in item.numbers.items():
                fields[f"{channel} {name}"] = (("<f8", (count,)), data + place)
            self._times.append(f"{channel} times")
            self._stamps.append(f"{channel} stamp")
            self._numbers.append([f"{channel} {name}" for name in item.numbers])
        self._layout = np.dtype(
            {
                "names": [*fields],
                "formats": [kind for kind, _ in fields.values()],
                "offsets": [place for _, place in fields.values()],
                "itemsize": len(self._template),
            }
        )

    def encode(self, times_s: Numbers, values: Sequence[Sequence[Numbers]]) -> Rows:
        """Returns rows, the same bytes as encoding message by message.

        Args:
            times_s: Simulated times of the rows, not negative.
            values: For each kind of message its numbers in the order of `Columns.numbers`, each with a row per time.
        """
        times_ns = np.rint(times_s * _NANOSECONDS).astype(np.int64)
        seconds, nanoseconds = np.divmod(times_ns, _NANOSECONDS)
        stamps = seconds + (nanoseconds << 32)  # int32 and uint32 after one another, little end first
        raw = bytearray(self._template * len(times_ns))
        rows = np.frombuffer(raw, self._layout)
        for name in self._times:
            rows[name] = times_ns[:, np.newaxis]
        for name in self._stamps:
            rows[name] = stamps
        for names, columns in zip(self._numbers, values, strict=True):
            for name, column in zip(names, columns, strict=True):
                rows[name] = column
        del rows
        return Rows(times_ns, bytes(raw), self._starts)
