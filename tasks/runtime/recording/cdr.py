"""Serialises ROS 2 messages to CDR, with the definitions and hashes of their types from `rosbags`.

The bytes are XCDR version 1, little endian. The store reads members by name, so that most messages go into it as they
are; those that are flatter than in ROS, or whose arrays may be any sequence, get its shape here first. What is recorded
at a steady rate is not encoded message by message: see `columns`.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from . import display_messages as display
from . import messages as ros

Message = ros.Message | display.DisplayMessage
"""Messages that can be recorded."""

_STORE = get_typestore(Stores.ROS2_HUMBLE)
"""Later distributions have the same types, with the same hashes."""


def encode(message: Message) -> bytes:
    """Returns a message's CDR bytes with their encapsulation header.

    Raises:
        TypeError: The object is not one of the messages that can be recorded, or has parts that are not ROS's.
        ValueError: A covariance does not have the length its message asks for.
    """
    kind = type(message)
    shaped = _SHAPES.get(kind)
    if shaped is None:
        known = ", ".join(kind.__name__ for kind in _SHAPES)
        raise TypeError(f"cannot encode {kind.__name__}; the messages that can be recorded are {known}")
    try:
        return bytes(_STORE.serialize_cdr(shaped(message), kind.ROS_TYPE, little_endian=True))
    except AttributeError as error:
        raise TypeError(f"cannot encode {kind.__name__}: {error}") from error


@lru_cache
def definition(ros_type: str) -> str:
    """Returns what a reader needs to decode a type without a ROS installation: concatenated `.msg` files."""
    text, _ = _STORE.generate_msgdef(ros_type, ros_version=2)
    return text


@lru_cache
def type_hash(ros_type: str) -> str:
    """Returns the hash of a type (REP 2011)."""
    return _STORE.hash_rihs01(ros_type)


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


def _compressed_image(message: display.CompressedImage) -> SimpleNamespace:
    return SimpleNamespace(header=message.header, format=message.format, data=np.frombuffer(message.data, np.uint8))


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
    display.Path: _as_it_is,
    display.CompressedImage: _compressed_image,
    display.CameraInfo: _camera_info,
    display.OccupancyGrid: _occupancy_grid,
    display.MarkerArray: _as_it_is,
}

# The store makes code of a type when it is first asked for: here, once, and not in each run, which is forked off later.
for _kind in _SHAPES:
    _STORE.get_msgdef(_kind.ROS_TYPE)
    definition(_kind.ROS_TYPE)
    type_hash(_kind.ROS_TYPE)
