"""The ROS 2 messages a simulation run records.

Named tuples with the members of the ROS 2 messages, in their order; `cdr.encode` turns them into
bytes and `recording.McapRecorder` writes them. The messages that can be recorded by themselves carry their `ROS_TYPE`.
What is only for showing and planning is in `display_messages`.

Frames follow REP 103 and REP 105: x forward, y left, z up; `map`, `odom`, `base_link`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_NANOSECONDS = 1_000_000_000


class Time(NamedTuple):
    """`builtin_interfaces/Time`."""

    sec: int
    nanosec: int

    @classmethod
    def from_seconds(cls, time_s: float) -> "Time":
        """Returns the nearest time with nanoseconds; negative times count back from zero."""
        return cls(*divmod(round(time_s * _NANOSECONDS), _NANOSECONDS))


class Header(NamedTuple):
    """`std_msgs/Header`."""

    stamp: Time
    frame_id: str


class Vector3(NamedTuple):
    """`geometry_msgs/Vector3`, also `geometry_msgs/Point`."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


class Quaternion(NamedTuple):
    """`geometry_msgs/Quaternion`. MuJoCo keeps w first; this keeps it last."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


class Transform(NamedTuple):
    """`geometry_msgs/Transform`."""

    translation: Vector3 = Vector3()
    rotation: Quaternion = Quaternion()


class TransformStamped(NamedTuple):
    """`geometry_msgs/TransformStamped`: where the child frame is, seen from the header's frame."""

    header: Header
    child_frame_id: str
    transform: Transform


class Pose(NamedTuple):
    """`geometry_msgs/Pose`."""

    position: Vector3 = Vector3()
    orientation: Quaternion = Quaternion()


class Twist(NamedTuple):
    """`geometry_msgs/Twist`: metres and radians per second."""

    linear: Vector3 = Vector3()
    angular: Vector3 = Vector3()


class Clock(NamedTuple):
    """`rosgraph_msgs/Clock`, by custom on the topic `/clock`."""

    clock: Time

    ROS_TYPE = "rosgraph_msgs/msg/Clock"


class TFMessage(NamedTuple):
    """`tf2_msgs/TFMessage`, by custom on `/tf` and `/tf_static`."""

    transforms: Sequence[TransformStamped]

    ROS_TYPE = "tf2_msgs/msg/TFMessage"


NO_COVARIANCE = (0.0,) * 36
NO_COVARIANCE_3X3 = (0.0,) * 9


class Odometry(NamedTuple):
    """`nav_msgs/Odometry`: pose in the header's frame, twist in the child's; covariances 6 x 6 by rows."""

    header: Header
    child_frame_id: str
    pose: Pose
    twist: Twist
    pose_covariance: Sequence[float] = NO_COVARIANCE
    twist_covariance: Sequence[float] = NO_COVARIANCE

    ROS_TYPE = "nav_msgs/msg/Odometry"


NO_INTENSITIES: NDArray[np.float32] = np.zeros(0, dtype=np.float32)


class LaserScan(NamedTuple):
    """`sensor_msgs/LaserScan`: ranges in metres, counter-clockwise from `angle_min` in radians."""

    header: Header
    angle_min: float
    angle_max: float
    angle_increment: float
    time_increment: float
    scan_time: float
    range_min: float
    range_max: float
    ranges: NDArray[np.float32]
    intensities: NDArray[np.float32] = NO_INTENSITIES

    ROS_TYPE = "sensor_msgs/msg/LaserScan"


class JointState(NamedTuple):
    """`sensor_msgs/JointState`: radians or metres, their rates, and N m or N; lists may be empty."""

    header: Header
    name: Sequence[str]
    position: Sequence[float] | NDArray[np.float64] = ()
    velocity: Sequence[float] | NDArray[np.float64] = ()
    effort: Sequence[float] | NDArray[np.float64] = ()

    ROS_TYPE = "sensor_msgs/msg/JointState"


class Imu(NamedTuple):
    """`sensor_msgs/Imu`: rad/s and m/s²; covariances 3 x 3 by rows, first element -1 for "not measured"."""

    header: Header
    orientation: Quaternion
    angular_velocity: Vector3
    linear_acceleration: Vector3
    orientation_covariance: Sequence[float] = NO_COVARIANCE_3X3
    angular_velocity_covariance: Sequence[float] = NO_COVARIANCE_3X3
    linear_acceleration_covariance: Sequence[float] = NO_COVARIANCE_3X3

    ROS_TYPE = "sensor_msgs/msg/Imu"


Message = Clock | TFMessage | Odometry | LaserScan | JointState | Imu
"""Messages that can be recorded, besides those of `display_messages`."""
