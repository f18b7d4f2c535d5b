"""The ROS 2 messages a simulation run records.

Named tuples with the members of the ROS 2 messages, in their order; `cdr.encode` turns them into
bytes and `recording.McapRecorder` writes them. The messages that can be recorded by themselves carry
`ROS_TYPE`, `DEFINITION` (the text a reader needs to decode them without a ROS installation) and `TYPE_HASH`
(REP 2011; the same from Humble to Kilted). What is only for showing and planning is in `display_messages`.

Frames follow REP 103 and REP 105: x forward, y left, z up; `map`, `odom`, `base_link`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .message_texts import definition

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
    TYPE_HASH = "RIHS01_692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564"
    DEFINITION = definition("builtin_interfaces/Time clock", "builtin_interfaces/Time")


class TFMessage(NamedTuple):
    """`tf2_msgs/TFMessage`, by custom on `/tf` and `/tf_static`."""

    transforms: Sequence[TransformStamped]

    ROS_TYPE = "tf2_msgs/msg/TFMessage"
    TYPE_HASH = "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"
    DEFINITION = definition(
        "geometry_msgs/TransformStamped[] transforms",
        "geometry_msgs/TransformStamped",
        "std_msgs/Header",
        "builtin_interfaces/Time",
        "geometry_msgs/Transform",
        "geometry_msgs/Vector3",
        "geometry_msgs/Quaternion",
    )


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
    TYPE_HASH = "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0"
    DEFINITION = definition(
        "std_msgs/Header header\n"
        "string child_frame_id\n"
        "geometry_msgs/PoseWithCovariance pose\n"
        "geometry_msgs/TwistWithCovariance twist",
        "std_msgs/Header",
        "builtin_interfaces/Time",
        "geometry_msgs/PoseWithCovariance",
        "geometry_msgs/Pose",
        "geometry_msgs/Point",
        "geometry_msgs/Quaternion",
        "geometry_msgs/TwistWithCovariance",
        "geometry_msgs/Twist",
        "geometry_msgs/Vector3",
    )


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
    TYPE_HASH = "RIHS01_64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828"
    DEFINITION = definition(
        "std_msgs/Header header\n"
        "float32 angle_min\n"
        "float32 angle_max\n"
        "float32 angle_increment\n"
        "float32 time_increment\n"
        "float32 scan_time\n"
        "float32 range_min\n"
        "float32 range_max\n"
        "float32[] ranges\n"
        "float32[] intensities",
        "std_msgs/Header",
        "builtin_interfaces/Time",
    )


class JointState(NamedTuple):
    """`sensor_msgs/JointState`: radians or metres, their rates, and N m or N; lists may be empty."""

    header: Header
    name: Sequence[str]
    position: Sequence[float] | NDArray[np.float64] = ()
    velocity: Sequence[float] | NDArray[np.float64] = ()
    effort: Sequence[float] | NDArray[np.float64] = ()

    ROS_TYPE = "sensor_msgs/msg/JointState"
    TYPE_HASH = "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"
    DEFINITION = definition(
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort",
        "std_msgs/Header",
        "builtin_interfaces/Time",
    )


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
    TYPE_HASH = "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b"
    DEFINITION = definition(
        "std_msgs/Header header\n"
        "geometry_msgs/Quaternion orientation\n"
        "float64[9] orientation_covariance\n"
        "geometry_msgs/Vector3 angular_velocity\n"
        "float64[9] angular_velocity_covariance\n"
        "geometry_msgs/Vector3 linear_acceleration\n"
        "float64[9] linear_acceleration_covariance",
        "std_msgs/Header",
        "builtin_interfaces/Time",
        "geometry_msgs/Quaternion",
        "geometry_msgs/Vector3",
    )


Message = Clock | TFMessage | Odometry | LaserScan | JointState | Imu
"""What can be recorded, besides what `display_messages` has."""
