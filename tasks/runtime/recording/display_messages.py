"""ROS 2 messages about plans, pictures and what is drawn into the scene; see `messages`."""

from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

from .message_texts import definition
from .messages import Header, Pose, Time, Vector3


class PoseStamped(NamedTuple):
    """`geometry_msgs/PoseStamped`, by custom on `/goal_pose`."""

    header: Header
    pose: Pose

    ROS_TYPE = "geometry_msgs/msg/PoseStamped"
    TYPE_HASH = "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8"
    DEFINITION = definition(
        "std_msgs/Header header\ngeometry_msgs/Pose pose",
        "std_msgs/Header",
        "builtin_interfaces/Time",
        "geometry_msgs/Pose",
        "geometry_msgs/Point",
        "geometry_msgs/Quaternion",
    )


class Path(NamedTuple):
    """`nav_msgs/Path`, by custom on `/plan`."""

    header: Header
    poses: Sequence[PoseStamped]

    ROS_TYPE = "nav_msgs/msg/Path"
    TYPE_HASH = "RIHS01_1957a5bb3cee5da65c4e52e52b65a93df227efce4c20f8458b36e73066ca334b"
    DEFINITION = definition(
        "std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses",
        "std_msgs/Header",
        "builtin_interfaces/Time",
        "geometry_msgs/PoseStamped",
        "geometry_msgs/Pose",
        "geometry_msgs/Point",
        "geometry_msgs/Quaternion",
    )


class CompressedImage(NamedTuple):
    """`sensor_msgs/CompressedImage`: a picture as a file, x to the right, y down, seen along z."""

    header: Header
    format: str
    """`jpeg` or `png`."""

    data: bytes

    ROS_TYPE = "sensor_msgs/msg/CompressedImage"
    TYPE_HASH = "RIHS01_15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a"
    DEFINITION = definition(
        "std_msgs/Header header\nstring format\nuint8[] data", "std_msgs/Header", "builtin_interfaces/Time"
    )


class CameraInfo(NamedTuple):
    """`sensor_msgs/CameraInfo` of a camera without distortion, by custom on `camera_info` beside its pictures.

    Pixels are counted as ROS and OpenCV do: (0, 0) is the middle of the first one.
    """

    header: Header
    """Its frame is the optical one: x to the right, y down, z ahead (REP 103)."""

    height: int
    width: int
    fx: float
    """Focal lengths, pixels."""

    fy: float
    cx: float
    """Where in the picture straight ahead is, pixels."""

    cy: float

    ROS_TYPE = "sensor_msgs/msg/CameraInfo"
    TYPE_HASH = "RIHS01_b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275"
    DEFINITION = definition(
        "std_msgs/Header header\n"
        "uint32 height\n"
        "uint32 width\n"
        "string distortion_model\n"
        "float64[] d\n"
        "float64[9] k\n"
        "float64[9] r\n"
        "float64[12] p\n"
        "uint32 binning_x\n"
        "uint32 binning_y\n"
        "sensor_msgs/RegionOfInterest roi",
        "std_msgs/Header",
        "builtin_interfaces/Time",
        "sensor_msgs/RegionOfInterest",
    )


class OccupancyGrid(NamedTuple):
    """`nav_msgs/OccupancyGrid`, by custom on `/map`: rows from the south, columns from the west."""

    header: Header
    resolution: float
    """Side of a cell, metres."""

    width: int
    height: int
    origin: Pose
    """South-west corner of the first cell."""

    data: bytes
    """A cell each, int8: 0 is free, 100 occupied, -1 unknown."""

    ROS_TYPE = "nav_msgs/msg/OccupancyGrid"
    TYPE_HASH = "RIHS01_8d348150c12913a31ee0ec170fbf25089e4745d17035792a1ba94d6f0bc0cfc7"
    DEFINITION = definition(
        "std_msgs/Header header\nnav_msgs/MapMetaData info\nint8[] data",
        "std_msgs/Header",
        "builtin_interfaces/Time",
        "nav_msgs/MapMetaData",
        "geometry_msgs/Pose",
        "geometry_msgs/Point",
        "geometry_msgs/Quaternion",
    )


class ColorRGBA(NamedTuple):
    """`std_msgs/ColorRGBA`: 0 to 1."""

    r: float
    g: float
    b: float
    a: float = 1.0


class MarkerType(IntEnum):
    """What a marker looks like (those that are used here)."""

    ARROW = 0
    CUBE = 1
    SPHERE = 2
    CYLINDER = 3
    TEXT_VIEW_FACING = 9


class Marker(NamedTuple):
    """`visualization_msgs/Marker` without textures, meshes and a colour per point, which are always empty."""

    header: Header
    ns: str
    """With `id`, what the marker is: a new one with both the same takes its place."""

    id: int
    type: MarkerType
    pose: Pose = Pose()
    scale: Vector3 = Vector3(1.0, 1.0, 1.0)
    color: ColorRGBA = ColorRGBA(1.0, 1.0, 1.0)
    lifetime: Time = Time(0, 0)
    """After which it disappears; 0: never."""

    points: Sequence[Vector3] = ()
    text: str = ""
    frame_locked: bool = False
    """Whether it moves with its frame; else it stays where that was at the stamp."""


class MarkerArray(NamedTuple):
    """`visualization_msgs/MarkerArray`."""

    markers: Sequence[Marker]

    ROS_TYPE = "visualization_msgs/msg/MarkerArray"
    TYPE_HASH = "RIHS01_86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf"
    DEFINITION = definition(
        "visualization_msgs/Marker[] markers",
        "visualization_msgs/Marker",
        "std_msgs/Header",
        "builtin_interfaces/Time",
        "geometry_msgs/Pose",
        "geometry_msgs/Point",
        "geometry_msgs/Quaternion",
        "geometry_msgs/Vector3",
        "std_msgs/ColorRGBA",
        "builtin_interfaces/Duration",
        "sensor_msgs/CompressedImage",
        "visualization_msgs/UVCoordinate",
        "visualization_msgs/MeshFile",
    )


DisplayMessage = PoseStamped | Path | CompressedImage | CameraInfo | OccupancyGrid | MarkerArray
