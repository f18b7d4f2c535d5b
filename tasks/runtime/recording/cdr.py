"""ROS 2 messages as bytes: XCDR version 1, little endian.

Values are aligned to their size, counted from the end of the four-byte encapsulation header. The
parts of a message that repeat from one message to the next (frame ids, joint names) are encoded once
and kept, which makes encoding several times faster than walking a schema.
"""

import struct
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import messages as ros
from .display_cdr import DISPLAY_ENCODERS
from .display_messages import DisplayMessage, Path

Message = ros.Message | DisplayMessage
"""What can be recorded."""

_ENCAPSULATION = b"\x00\x01\x00\x00"
_TIME = struct.Struct("<iI")
_CLOCK = struct.Struct("<4siI")
_LENGTH = struct.Struct("<I")
_POSE = struct.Struct("<7d")
_TWIST = struct.Struct("<6d")
_SCAN = struct.Struct("<7f")
_ZEROS = {n: bytes(8 * n) for n in (9, 36)}
_STAMP_SIZE = _TIME.size


def encode(message: Message) -> bytes:
    """Returns a message's CDR bytes with their encapsulation header.

    Raises:
        TypeError: The object is not one of the messages that can be recorded.
        ValueError: A covariance does not have the length its message asks for.
    """
    encoder = _ENCODERS.get(type(message))
    if encoder is None:
        known = ", ".join(kind.__name__ for kind in _ENCODERS)
        raise TypeError(f"cannot encode {type(message).__name__}; the messages that can be recorded are {known}")
    return encoder(message)


def _string(text: str) -> bytes:
    raw = text.encode() + b"\0"
    return _LENGTH.pack(len(raw)) + raw


def _pad(data: bytes, alignment: int, offset: int = 0) -> bytes:
    """Fills `data`, which begins at `offset`, up to the alignment of what follows."""
    return data + bytes(-(offset + len(data)) % alignment)


@lru_cache(maxsize=4096)
def _names(frame_id: str, child_frame_id: str | None, offset: int) -> bytes:
    """What follows a header's stamp up to a block of doubles: one or two strings, padded to 8."""
    data = _string(frame_id)
    if child_frame_id is not None:
        data = _pad(data, 4, offset) + _string(child_frame_id)
    return _pad(data, 8, offset)


@lru_cache(maxsize=1024)
def _joint_layout(frame_id: str, names: tuple[str, ...], lengths: tuple[int, ...]) -> tuple[struct.Struct, bytes]:
    """A joint state's layout with so many positions, velocities and efforts; and its bytes up to their first length.

    The layout takes the stamp, these bytes, and then for each of the three its length and its values.
    """
    text = _pad(_string(frame_id), 4) + _LENGTH.pack(len(names))
    for name in names:
        text = _pad(text, 4) + _string(name)
    text = _pad(text, 4)
    layout, offset = f"<4siI{len(text)}s", _STAMP_SIZE + len(text)
    for length in lengths:
        offset += _LENGTH.size
        padding = -offset % 8 if length else 0
        layout += f"I{padding}x{length}d"
        offset += padding + 8 * length
    return struct.Struct(layout), text


def _doubles(values: Sequence[float] | NDArray[np.float64], length: int) -> bytes:
    """A fixed array of doubles; the all-zero defaults cost nothing."""
    if values is ros.NO_COVARIANCE or values is ros.NO_COVARIANCE_3X3:
        return _ZEROS[length]
    array = np.asarray(values, dtype="<f8")
    if array.size != length:
        raise ValueError(f"a covariance of {length} numbers is needed, not {array.size}")
    return array.tobytes()


def _clock(message: ros.Clock) -> bytes:
    return _CLOCK.pack(_ENCAPSULATION, *message.clock)


@lru_cache(maxsize=256)
def _transform_layout(frame_id: str, child_frame_id: str) -> tuple[struct.Struct, bytes]:
    """The layout of a message of one transform, and its bytes between stamp and translation."""
    names = _names(frame_id, child_frame_id, _LENGTH.size + _STAMP_SIZE)
    return struct.Struct(f"<4sIiI{len(names)}s7d"), names


def _tf(message: ros.TFMessage) -> bytes:
    transforms = message.transforms
    if len(transforms) == 1:
        (stamp, frame_id), child_frame_id, (translation, rotation) = transforms[0]
        layout, names = _transform_layout(frame_id, child_frame_id)
        return layout.pack(_ENCAPSULATION, 1, *stamp, names, *translation, *rotation)
    parts = [_ENCAPSULATION, _LENGTH.pack(len(transforms))]
    # The first transform begins after the count, at 4; each ends with doubles, so the others begin at 0 modulo 8.
    offset = 4
    for header, child_frame_id, (translation, rotation) in transforms:
        parts += (
            _TIME.pack(*header.stamp),
            _names(header.frame_id, child_frame_id, offset + _STAMP_SIZE),
            _POSE.pack(*translation, *rotation),
        )
        offset = 0
    return b"".join(parts)


def _path(message: Path) -> bytes:
    header = message.header
    parts = [_ENCAPSULATION, _TIME.pack(*header.stamp), _pad(_string(header.frame_id), 4)]
    parts.append(_LENGTH.pack(len(message.poses)))
    # Each pose ends with doubles, so that those after the first one begin at 0 modulo 8.
    offset = sum(map(len, parts)) - len(_ENCAPSULATION)
    for (stamp, frame_id), (position, orientation) in message.poses:
        names = _names(frame_id, None, offset % 8 + _STAMP_SIZE)
        parts += (_TIME.pack(*stamp), names, _POSE.pack(*position, *orientation))
        offset = 0
    return b"".join(parts)


@lru_cache(maxsize=64)
def _odometry_layout(frame_id: str, child_frame_id: str) -> tuple[struct.Struct, bytes]:
    """The layout of an odometry without covariances, and its bytes between stamp and pose."""
    names = _names(frame_id, child_frame_id, _STAMP_SIZE)
    zeros = f"{len(_ZEROS[36])}x"
    return struct.Struct(f"<4siI{len(names)}s7d{zeros}6d{zeros}"), names


def _odometry(message: ros.Odometry) -> bytes:
    (stamp, frame_id), child_frame_id, pose, twist, pose_covariance, twist_covariance = message
    if pose_covariance is ros.NO_COVARIANCE and twist_covariance is ros.NO_COVARIANCE:
        layout, names = _odometry_layout(frame_id, child_frame_id)
        return layout.pack(
            _ENCAPSULATION, *stamp, names, *pose.position, *pose.orientation, *twist.linear, *twist.angular
        )  # fmt: skip
    return b"".join(
        (
            _ENCAPSULATION,
            _TIME.pack(*stamp),
            _names(frame_id, child_frame_id, _STAMP_SIZE),
            _POSE.pack(*pose.position, *pose.orientation),
            _doubles(pose_covariance, 36),
            _TWIST.pack(*twist.linear, *twist.angular),
            _doubles(twist_covariance, 36),
        )
    )


def _laser_scan(message: ros.LaserScan) -> bytes:
    header, *numbers, ranges, intensities = message
    return b"".join(
        (
            _ENCAPSULATION,
            _TIME.pack(*header.stamp),
            _pad(_string(header.frame_id), 4),
            _SCAN.pack(*numbers),
            _LENGTH.pack(len(ranges)),
            np.asarray(ranges, dtype="<f4").tobytes(),
            _LENGTH.pack(len(intensities)),
            np.asarray(intensities, dtype="<f4").tobytes(),
        )
    )


def _joint_state(message: ros.JointState) -> bytes:
    (stamp, frame_id), names, position, velocity, effort = message
    lengths = len(position), len(velocity), len(effort)
    layout, text = _joint_layout(frame_id, tuple(names), lengths)
    return layout.pack(
        _ENCAPSULATION, *stamp, text, lengths[0], *position, lengths[1], *velocity, lengths[2], *effort
    )  # fmt: skip


def _imu(message: ros.Imu) -> bytes:
    header = message.header
    return b"".join(
        (
            _ENCAPSULATION,
            _TIME.pack(*header.stamp),
            _names(header.frame_id, None, _STAMP_SIZE),
            struct.pack("<4d", *message.orientation),
            _doubles(message.orientation_covariance, 9),
            struct.pack("<3d", *message.angular_velocity),
            _doubles(message.angular_velocity_covariance, 9),
            struct.pack("<3d", *message.linear_acceleration),
            _doubles(message.linear_acceleration_covariance, 9),
        )
    )


_ENCODERS: dict[type, Callable[[Any], bytes]] = {
    ros.Clock: _clock,
    ros.TFMessage: _tf,
    ros.Odometry: _odometry,
    ros.LaserScan: _laser_scan,
    ros.JointState: _joint_state,
    ros.Imu: _imu,
    Path: _path,
    **DISPLAY_ENCODERS,
}
