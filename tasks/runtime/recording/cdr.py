"""Encoding of ROS 2 messages as CDR bytes: one by one, or many of the same shape at once."""

import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from types import SimpleNamespace
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from . import messages as display
from . import messages as ros
from .mcap_file import RECORD_HEAD_BYTES, TIMES_OFFSET, Rows, message_record

Message = ros.Message | display.DisplayMessage
"""Messages that can be recorded."""

_STORE = get_typestore(Stores.ROS2_HUMBLE)
"""Type store of ROS 2 Humble; later distributions have the same types with the same hashes."""


def encode(message: Message) -> bytes:
    """Returns a ROS message as CDR bytes with their encapsulation header.

    Raises:
        TypeError: The object is not one of the messages that can be recorded, or has parts that are not ROS's.
        ValueError: A covariance does not have the length its message asks for.
    """
    kind = type(message)
    shaped = _SHAPES.get(kind, _as_it_is if hasattr(kind, "ROS_TYPE") else None)
    if shaped is None:
        known = ", ".join(kind.__name__ for kind in _SHAPES)
        raise TypeError(f"cannot encode {kind.__name__}; the messages that can be recorded are {known}")
    try:
        return bytes(_STORE.serialize_cdr(shaped(message), kind.ROS_TYPE, little_endian=True))
    except AttributeError as error:
        raise TypeError(f"cannot encode {kind.__name__}: {error}") from error


@lru_cache
def definition(ros_type: str) -> str:
    """Returns the `.msg` definition of a ROS type and all its parts, for readers without a ROS installation."""
    text, _ = _STORE.generate_msgdef(ros_type, ros_version=2)
    return text


@lru_cache
def type_hash(ros_type: str) -> str:
    """Returns the ROS 2 hash of a message type (REP 2011)."""
    return _STORE.hash_rihs01(ros_type)


def is_known(ros_type: str) -> bool:
    """Whether a message type is one of ROS 2's own."""
    return ros_type in _STORE.fielddefs


def fields_of(ros_type: str) -> Sequence[tuple[str, tuple[Any, Any]]]:
    """Returns the fields of a ROS message type, each with its name and the description of its type."""
    return _STORE.fielddefs[ros_type][1]


def decode(data: bytes, ros_type: str) -> Any:
    """Returns the ROS message that CDR bytes hold.

    Raises:
        ValueError: The bytes are no such message.
    """
    try:
        return _STORE.deserialize_cdr(data, ros_type)
    except Exception as error:  # rosbags' generated code fails in its own ways where bytes are missing
        raise ValueError(f"{len(data)} bytes are no {ros_type}: {error}") from error


def _as_it_is(message: Message) -> Message:
    return message


def _covariance(values: Sequence[float] | NDArray[np.float64], length: int) -> NDArray[np.float64]:
    array = np.ascontiguousarray(values, np.float64)
    if array.size != length:
        raise ValueError(f"a covariance of {length} numbers is needed, not {array.size}")
    return array.ravel()


def _odometry(message: ros.Odometry) -> SimpleNamespace:
    header, child_frame_id, pose, twist, of_pose, of_twist = message
    return SimpleNamespace(
        header=header,
        child_frame_id=child_frame_id,
        pose=SimpleNamespace(pose=pose, covariance=_covariance(of_pose, 36)),
        twist=SimpleNamespace(twist=twist, covariance=_covariance(of_twist, 36)),
    )


def _laser_scan(message: ros.LaserScan) -> ros.LaserScan:
    ranges, intensities = (np.ascontiguousarray(values, np.float32) for values in (message.ranges, message.intensities))
    return message._replace(ranges=ranges, intensities=intensities)


def _joint_state(message: ros.JointState) -> ros.JointState:
    position, velocity, effort = (np.ascontiguousarray(values, np.float64) for values in message[2:])
    return message._replace(position=position, velocity=velocity, effort=effort)


def _imu(message: ros.Imu) -> ros.Imu:
    return message._replace(
        orientation_covariance=_covariance(message.orientation_covariance, 9),
        angular_velocity_covariance=_covariance(message.angular_velocity_covariance, 9),
        linear_acceleration_covariance=_covariance(message.linear_acceleration_covariance, 9),
    )


def _pose_with_covariance(message: display.PoseWithCovarianceStamped) -> SimpleNamespace:
    header, pose, covariance = message
    return SimpleNamespace(header=header, pose=SimpleNamespace(pose=pose, covariance=_covariance(covariance, 36)))


def _compressed_image(message: display.CompressedImage) -> SimpleNamespace:
    return SimpleNamespace(header=message.header, format=message.format, data=np.frombuffer(message.data, np.uint8))


def _image(message: display.Image) -> SimpleNamespace:
    header, encoding, pixels = message
    height, width = pixels.shape[:2]
    data = np.ascontiguousarray(pixels).view(np.uint8).ravel()
    return SimpleNamespace(
        header=header, height=height, width=width, encoding=encoding, is_bigendian=0, step=data.size // height,
        data=data,
    )  # fmt: skip


_FLOAT32 = 7
"""`sensor_msgs/PointField.FLOAT32`."""


def _point_cloud(message: display.PointCloud2) -> SimpleNamespace:
    header, points = message
    height, width = points.shape[:2]
    fields = [
        SimpleNamespace(name=name, offset=place * _FLOAT, datatype=_FLOAT32, count=1)
        for place, name in enumerate("xyz")
    ]
    data = np.ascontiguousarray(points, np.float32).view(np.uint8).ravel()
    return SimpleNamespace(
        header=header, height=height, width=width, fields=fields, is_bigendian=False, point_step=3 * _FLOAT,
        row_step=3 * _FLOAT * width, data=data, is_dense=bool(np.isfinite(points).all()),
    )  # fmt: skip


def _camera_info(message: display.CameraInfo) -> SimpleNamespace:
    header, height, width, fx, fy, cx, cy = message
    all_of_it = SimpleNamespace(x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    return SimpleNamespace(
        header=header, height=height, width=width, binning_x=0, binning_y=0, roi=all_of_it,
        distortion_model="plumb_bob", d=np.zeros(5),
        k=np.array([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]),
        r=np.eye(3).ravel(),
        p=np.array([fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]),
    )  # fmt: skip


def _occupancy_grid(message: display.OccupancyGrid) -> SimpleNamespace:
    header, resolution, width, height, origin, data = message
    info = SimpleNamespace(
        map_load_time=header.stamp, resolution=resolution, width=width, height=height, origin=origin
    )  # fmt: skip
    return SimpleNamespace(header=header, info=info, data=np.frombuffer(data, np.int8))


_SHAPES: dict[type[Message], Callable[[Any], Any]] = {
    ros.Clock: _as_it_is,
    ros.TFMessage: _as_it_is,
    ros.Odometry: _odometry,
    ros.LaserScan: _laser_scan,
    ros.JointState: _joint_state,
    ros.Imu: _imu,
    display.PoseStamped: _as_it_is,
    display.PoseWithCovarianceStamped: _pose_with_covariance,
    display.String: _as_it_is,
    display.Path: _as_it_is,
    display.CompressedImage: _compressed_image,
    display.Image: _image,
    display.PointCloud2: _point_cloud,
    display.CameraInfo: _camera_info,
    display.OccupancyGrid: _occupancy_grid,
    display.MarkerArray: _as_it_is,
}

# The store makes code of a type when it is first asked for: here, once, and not in each run, which is forked off later.
for _kind in _SHAPES:
    _STORE.get_msgdef(_kind.ROS_TYPE)
    definition(_kind.ROS_TYPE)
    type_hash(_kind.ROS_TYPE)


_NANOSECONDS = 1_000_000_000
_DOUBLE, _FLOAT = 8, 4
_DOUBLES, _FLOATS = "<f8", "<f4"
_STRUCT_TYPES = {_DOUBLES: "d", _FLOATS: "f"}
_STAMP = struct.Struct("<iI")
_COVARIANCE = 36 * _DOUBLE
_COVARIANCE_3X3 = 9 * _DOUBLE
_ZERO = ros.Time(0, 0)
_AFTER_ENCAPSULATION = (4,)

Numbers = NDArray[np.float64]
AnyNumbers = NDArray[np.floating[Any]]


class Columns(NamedTuple):
    """Template of a ROS message in which only the stamp and some numbers change, for fast encoding."""

    kind: type[ros.Message]
    """Class of the message."""

    template: bytes
    """CDR encoding of one message of this class, into which stamps and numbers are put."""

    stamps: tuple[int, ...]
    """Byte offsets of the time stamps in the message; a message with several transforms has one each."""

    numbers: Mapping[str, tuple[int, int, str]]
    """Arrays of numbers in the message by name: byte offset, count, and type."""


def clock() -> Columns:
    """Returns the message template of `rosgraph_msgs/Clock`."""
    return Columns(ros.Clock, encode(ros.Clock(_ZERO)), _AFTER_ENCAPSULATION, {})


def transforms(frames: Sequence[tuple[str, str]]) -> Columns:
    """Returns the message template of a `tf2_msgs/TFMessage` with given frames.

    Its numbers are the transforms' translations x, y, z and rotations x, y, z, w, each named by its child frame.

    Args:
        frames: Parent frame and child frame of each transform.
    """
    items = [ros.TransformStamped(ros.Header(_ZERO, frame), child, ros.Transform()) for frame, child in frames]
    # A message with one transform less ends where the next one begins; each ends with its numbers.
    ends = [len(encode(ros.TFMessage(items[:count]))) for count in range(len(items) + 1)]
    numbers = {item.child_frame_id: (end - 7 * _DOUBLE, 7, _DOUBLES) for item, end in zip(items, ends[1:], strict=True)}
    return Columns(ros.TFMessage, encode(ros.TFMessage(items)), tuple(ends[:-1]), numbers)


def odometry(frame_id: str, child_frame_id: str) -> Columns:
    """Returns the message template of `nav_msgs/Odometry` without covariances.

    Its numbers are `pose`, like a transform's, and `twist`: linear x, y, z and angular x, y, z.
    """
    template = encode(ros.Odometry(ros.Header(_ZERO, frame_id), child_frame_id, ros.Pose(), ros.Twist()))
    twist = len(template) - _COVARIANCE - 6 * _DOUBLE
    pose = twist - _COVARIANCE - 7 * _DOUBLE
    numbers = {"pose": (pose, 7, _DOUBLES), "twist": (twist, 6, _DOUBLES)}
    return Columns(ros.Odometry, template, _AFTER_ENCAPSULATION, numbers)


def joint_states(frame_id: str, names: Sequence[str]) -> Columns:
    """Returns the message template of `sensor_msgs/JointState`.

    Its numbers are `position`, `velocity` and `effort`, one of each per joint.

    Raises:
        ValueError: No joints are given.
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
    numbers = {name: (place, len(names), _DOUBLES) for name, place in places.items()}
    return Columns(ros.JointState, template, _AFTER_ENCAPSULATION, numbers)


def laser_scan(scan: ros.LaserScan) -> Columns:
    """Returns the message template of `sensor_msgs/LaserScan` without intensities.

    Its numbers are `ranges`.

    Args:
        scan: Scan with all values that do not change.
    """
    template = encode(scan._replace(header=scan.header._replace(stamp=_ZERO), intensities=ros.NO_INTENSITIES))
    count = len(scan.ranges)
    # After the ranges there is only the length of the intensities.
    place = len(template) - _FLOAT - count * _FLOAT
    return Columns(ros.LaserScan, template, _AFTER_ENCAPSULATION, {"ranges": (place, count, _FLOATS)})


def imu(frame_id: str) -> Columns:
    """Returns the message template of `sensor_msgs/Imu` without covariances.

    Its numbers are `orientation` x, y, z, w, `angular_velocity` and `linear_acceleration`.
    """
    nothing = ros.Imu(ros.Header(_ZERO, frame_id), ros.Quaternion(), ros.Vector3(), ros.Vector3())
    template = encode(nothing)
    # After each of the three comes its covariance; the message ends with the last one.
    acceleration = len(template) - _COVARIANCE_3X3 - 3 * _DOUBLE
    rates = acceleration - _COVARIANCE_3X3 - 3 * _DOUBLE
    orientation = rates - _COVARIANCE_3X3 - 4 * _DOUBLE
    numbers = {
        "orientation": (orientation, 4, _DOUBLES),
        "angular_velocity": (rates, 3, _DOUBLES),
        "linear_acceleration": (acceleration, 3, _DOUBLES),
    }
    return Columns(ros.Imu, template, _AFTER_ENCAPSULATION, numbers)


class Series(Protocol):
    """Interface of a source of ROS messages of fixed size, which the recorder reads whenever it writes a chunk."""

    @property
    def topics(self) -> Sequence[tuple[str, Columns]]:
        """Topics of the source, each with its message template."""
        ...

    def take(self) -> tuple[Numbers, Sequence[Sequence[AnyNumbers]]]:
        """Returns the data since the last call, and forgets it.

        Returns:
            Simulated times in seconds; and for each topic its arrays of numbers, a row for each time.
        """
        ...


class _Single:
    """Encodes a single message of a template again and again, in one buffer."""

    def __init__(self, columns: Columns) -> None:
        self._message = bytearray(columns.template)
        self._stamps = columns.stamps
        self._numbers = [
            (place, struct.Struct(f"<{width}{_STRUCT_TYPES[kind]}")) for place, width, kind in columns.numbers.values()
        ]

    def filled(self, time_ns: int, values: Sequence[Sequence[float]]) -> bytes:
        for place in self._stamps:
            _STAMP.pack_into(self._message, place, *divmod(time_ns, _NANOSECONDS))
        for (place, numbers), row in zip(self._numbers, values, strict=True):
            numbers.pack_into(self._message, place, *row)
        return bytes(self._message)


class RowEncoder:
    """Encodes many ROS messages of fixed size at once: one message on each channel for each time."""

    def __init__(self, columns: Sequence[tuple[int, Columns]]) -> None:
        """Prepares the layout of rows of encoded ROS messages, one message for each channel.

        Args:
            columns: Channel number and message template of each message in a row.
        """
        self._starts: dict[int, int] = {}
        self._template = b""
        self._rows = bytearray()
        self._times: list[int] = []
        self._stamps: list[int] = []
        self._numbers: list[list[tuple[int, int, str]]] = []
        self._single: list[_Single] = []
        for channel, item in columns:
            start = self._starts[channel] = len(self._template)
            data = start + RECORD_HEAD_BYTES
            self._template += message_record(channel, 0, item.template)
            self._times += (start + TIMES_OFFSET, start + TIMES_OFFSET + _DOUBLE)
            self._stamps += (data + stamp for stamp in item.stamps)
            self._numbers.append([(data + place, width, kind) for place, width, kind in item.numbers.values()])
            self._single.append(_Single(item))

    def encode(self, times_s: Numbers, values: Sequence[Sequence[AnyNumbers]]) -> Rows:
        """Returns the messages of rows of numbers, encoded; they are valid until the next call.

        Args:
            times_s: Simulated times of the rows, not negative.
            values: Numbers of each message in the order of `Columns.numbers`, with a row per time.
        """
        times_ns = np.rint(times_s * _NANOSECONDS).astype(np.int64)
        seconds, nanoseconds = np.divmod(times_ns, _NANOSECONDS)
        stamps = seconds + (nanoseconds << 32)  # int32 and uint32 after one another, little end first
        size, count = len(self._template), len(times_ns)
        if len(self._rows) < count * size:
            self._rows = bytearray(self._template * count)
        # What does not change is there from the last time.
        raw = memoryview(self._rows)[: count * size]
        for integers, places in ((times_ns, self._times), (stamps, self._stamps)):
            for place in places:
                np.ndarray(count, "<i8", raw, place, size)[:] = integers
        for places, columns in zip(self._numbers, values, strict=True):
            for (place, width, kind), column in zip(places, columns, strict=True):
                np.ndarray((count, width), kind, raw, place, (size, np.dtype(kind).itemsize))[:] = column
        return Rows(times_ns, raw, self._starts)

    def encode_one(
        self, time_s: float, values: Sequence[Sequence[Sequence[float]]], wanted: Iterable[int]
    ) -> list[bytes]:
        """Returns the encoded messages of a single time; the bytes are the same as in a row.

        Args:
            time_s: Simulated time, not negative.
            values: Numbers of each message in the order of `Columns.numbers`.
            wanted: Indices of the messages to encode.
        """
        time_ns = round(time_s * _NANOSECONDS)
        return [self._single[number].filled(time_ns, values[number]) for number in wanted]
