"""ROS 2 messages that can be recorded."""

from collections.abc import Sequence
from enum import IntEnum
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_NANOSECONDS = 1_000_000_000


class Time(NamedTuple):
    """ROS message `builtin_interfaces/Time`."""

    sec: int
    nanosec: int

    @classmethod
    def from_seconds(cls, time_s: float) -> "Time":
        """Converts seconds to a ROS time, rounded to nanoseconds; negative times count back from zero."""
        return cls(*divmod(round(time_s * _NANOSECONDS), _NANOSECONDS))


class Header(NamedTuple):
    """ROS message `std_msgs/Header`."""

    stamp: Time
    frame_id: str


class Vector3(NamedTuple):
    """ROS message `geometry_msgs/Vector3`, also used for `geometry_msgs/Point`."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


class Quaternion(NamedTuple):
    """ROS message `geometry_msgs/Quaternion` with w last (MuJoCo has w first)."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


class Transform(NamedTuple):
    """ROS message `geometry_msgs/Transform`."""

    translation: Vector3 = Vector3()
    rotation: Quaternion = Quaternion()


class TransformStamped(NamedTuple):
    """ROS message `geometry_msgs/TransformStamped`: pose of the child frame in the header's frame."""

    header: Header
    child_frame_id: str
    transform: Transform


class Pose(NamedTuple):
    """ROS message `geometry_msgs/Pose`."""

    position: Vector3 = Vector3()
    orientation: Quaternion = Quaternion()


class Twist(NamedTuple):
    """ROS message `geometry_msgs/Twist`, in metres and radians per second."""

    linear: Vector3 = Vector3()
    angular: Vector3 = Vector3()


class Clock(NamedTuple):
    """ROS message `rosgraph_msgs/Clock`, by custom on the topic `/clock`."""

    clock: Time

    ROS_TYPE = "rosgraph_msgs/msg/Clock"


class TFMessage(NamedTuple):
    """ROS message `tf2_msgs/TFMessage`, by custom on `/tf` and `/tf_static`."""

    transforms: Sequence[TransformStamped]

    ROS_TYPE = "tf2_msgs/msg/TFMessage"


NO_COVARIANCE = (0.0,) * 36
NO_COVARIANCE_3X3 = (0.0,) * 9


class Odometry(NamedTuple):
    """ROS message `nav_msgs/Odometry`: pose in the header's frame, twist in the child's; covariances 6 x 6 by rows."""

    header: Header
    child_frame_id: str
    pose: Pose
    twist: Twist
    pose_covariance: Sequence[float] = NO_COVARIANCE
    twist_covariance: Sequence[float] = NO_COVARIANCE

    ROS_TYPE = "nav_msgs/msg/Odometry"


NO_INTENSITIES: NDArray[np.float32] = np.zeros(0, dtype=np.float32)


class LaserScan(NamedTuple):
    """ROS message `sensor_msgs/LaserScan`: ranges in metres, counter-clockwise from `angle_min` in radians."""

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
    """ROS message `sensor_msgs/JointState`: radians or metres, their rates, and N m or N; lists may be empty."""

    header: Header
    name: Sequence[str]
    position: Sequence[float] | NDArray[np.float64] = ()
    velocity: Sequence[float] | NDArray[np.float64] = ()
    effort: Sequence[float] | NDArray[np.float64] = ()

    ROS_TYPE = "sensor_msgs/msg/JointState"


class Imu(NamedTuple):
    """ROS message `sensor_msgs/Imu`: rad/s and m/s²; covariances 3 x 3 by rows, first element -1 if not measured."""

    header: Header
    orientation: Quaternion
    angular_velocity: Vector3
    linear_acceleration: Vector3
    orientation_covariance: Sequence[float] = NO_COVARIANCE_3X3
    angular_velocity_covariance: Sequence[float] = NO_COVARIANCE_3X3
    linear_acceleration_covariance: Sequence[float] = NO_COVARIANCE_3X3

    ROS_TYPE = "sensor_msgs/msg/Imu"


Message = Clock | TFMessage | Odometry | LaserScan | JointState | Imu
"""Messages that can be recorded, besides those below about plans, images and drawings."""


_NO_BYTES = np.zeros(0, np.uint8)


class PoseStamped(NamedTuple):
    """ROS message `geometry_msgs/PoseStamped`, by custom on `/goal_pose`."""

    header: Header
    pose: Pose

    ROS_TYPE = "geometry_msgs/msg/PoseStamped"


class PoseWithCovarianceStamped(NamedTuple):
    """ROS message `geometry_msgs/PoseWithCovarianceStamped`, by custom on `/initialpose`."""

    header: Header
    pose: Pose
    covariance: Sequence[float] = NO_COVARIANCE

    ROS_TYPE = "geometry_msgs/msg/PoseWithCovarianceStamped"


class String(NamedTuple):
    """ROS message `std_msgs/String`, by custom on `/robot_description`."""

    data: str

    ROS_TYPE = "std_msgs/msg/String"


class Path(NamedTuple):
    """ROS message `nav_msgs/Path`, by custom on `/plan`."""

    header: Header
    poses: Sequence[PoseStamped]

    ROS_TYPE = "nav_msgs/msg/Path"


class CompressedImage(NamedTuple):
    """ROS message `sensor_msgs/CompressedImage`: a JPEG or PNG; x points right, y down, z into the picture."""

    header: Header
    format: str
    """Format of the compressed image: `jpeg` or `png`."""

    data: bytes

    ROS_TYPE = "sensor_msgs/msg/CompressedImage"


class Image(NamedTuple):
    """ROS message `sensor_msgs/Image`: rows from the top, pixels from the left."""

    header: Header
    encoding: str
    """Encoding of the pixels: `rgb8`, `32FC1` (metres) or `16UC1` (millimetres)."""

    pixels: NDArray[np.generic]
    """Pixels as an array of height x width (x channels), of the encoding's type."""

    ROS_TYPE = "sensor_msgs/msg/Image"


class PointCloud2(NamedTuple):
    """ROS message `sensor_msgs/PointCloud2` with one point x, y, z for each pixel; NaN for pixels without depth."""

    header: Header
    points: NDArray[np.float32]
    """Points of the cloud in metres, shape (height, width, 3)."""

    ROS_TYPE = "sensor_msgs/msg/PointCloud2"


class CameraInfo(NamedTuple):
    """ROS message `sensor_msgs/CameraInfo` of a camera without distortion.

    Pixel coordinates are as in ROS and OpenCV: (0, 0) is the centre of the first pixel.
    """

    header: Header
    """Header with the optical frame: x right, y down, z forward (REP 103)."""

    height: int
    width: int
    fx: float
    """Horizontal focal length in pixels; `fy` is the vertical one."""

    fy: float
    cx: float
    """Column of the principal point (straight ahead) in the picture, in pixels."""

    cy: float

    ROS_TYPE = "sensor_msgs/msg/CameraInfo"


class OccupancyGrid(NamedTuple):
    """ROS message `nav_msgs/OccupancyGrid`, by custom on `/map`: rows from the south, columns from the west."""

    header: Header
    resolution: float
    """Side length of a cell, in metres."""

    width: int
    height: int
    origin: Pose
    """Pose of the first cell's south-west corner."""

    data: bytes
    """Cells of the map, one int8 each: 0 is free, 100 occupied, -1 unknown."""

    ROS_TYPE = "nav_msgs/msg/OccupancyGrid"


class ColorRGBA(NamedTuple):
    """ROS message `std_msgs/ColorRGBA`, values from 0 to 1."""

    r: float
    g: float
    b: float
    a: float = 1.0


class MarkerType(IntEnum):
    """Shapes of ROS markers (`visualization_msgs/Marker`) that are used here."""

    ARROW = 0
    CUBE = 1
    SPHERE = 2
    CYLINDER = 3
    TEXT_VIEW_FACING = 9


class Marker(NamedTuple):
    """ROS message `visualization_msgs/Marker` without textures, meshes and point colours."""

    header: Header
    ns: str
    """Namespace of the marker, which replaces an earlier one with the same `ns` and `id`."""

    id: int
    type: MarkerType
    pose: Pose = Pose()
    scale: Vector3 = Vector3(1.0, 1.0, 1.0)
    color: ColorRGBA = ColorRGBA(1.0, 1.0, 1.0)
    lifetime: Time = Time(0, 0)
    """Time after which the marker disappears; 0: never."""

    points: Sequence[Vector3] = ()
    text: str = ""
    frame_locked: bool = False
    """Whether the marker moves with its frame; else it stays at the frame's pose at the time stamp."""

    # What all markers have in common: they are added or modified, and have nothing of the rest.
    action = 0
    colors = uv_coordinates = ()
    texture_resource = mesh_resource = ""
    texture = SimpleNamespace(header=Header(Time(0, 0), ""), format="", data=_NO_BYTES)
    mesh_file = SimpleNamespace(filename="", data=_NO_BYTES)
    mesh_use_embedded_materials = False


class MarkerArray(NamedTuple):
    """ROS message `visualization_msgs/MarkerArray`."""

    markers: Sequence[Marker]

    ROS_TYPE = "visualization_msgs/msg/MarkerArray"


DisplayMessage = (
    PoseStamped
    | PoseWithCovarianceStamped
    | String
    | Path
    | CompressedImage
    | Image
    | PointCloud2
    | CameraInfo
    | OccupancyGrid
    | MarkerArray
)
