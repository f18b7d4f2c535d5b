"""ROS 2 messages about plans, pictures and what is drawn into the scene; see `messages`."""

from collections.abc import Sequence
from enum import IntEnum
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from .messages import Header, Pose, Time, Vector3

_NO_BYTES = np.zeros(0, np.uint8)


class PoseStamped(NamedTuple):
    """`geometry_msgs/PoseStamped`, by custom on `/goal_pose`."""

    header: Header
    pose: Pose

    ROS_TYPE = "geometry_msgs/msg/PoseStamped"


class Path(NamedTuple):
    """`nav_msgs/Path`, by custom on `/plan`."""

    header: Header
    poses: Sequence[PoseStamped]

    ROS_TYPE = "nav_msgs/msg/Path"


class CompressedImage(NamedTuple):
    """`sensor_msgs/CompressedImage`: a picture as a file, x to the right, y down, seen along z."""

    header: Header
    format: str
    """`jpeg` or `png`."""

    data: bytes

    ROS_TYPE = "sensor_msgs/msg/CompressedImage"


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
    """Column of the principal point (straight ahead) in the picture, in pixels."""

    cy: float

    ROS_TYPE = "sensor_msgs/msg/CameraInfo"


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


class ColorRGBA(NamedTuple):
    """`std_msgs/ColorRGBA`: 0 to 1."""

    r: float
    g: float
    b: float
    a: float = 1.0


class MarkerType(IntEnum):
    """Shapes of markers (those that are used here)."""

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

    # What all markers have in common: they are added or modified, and have nothing of the rest.
    action = 0
    colors = uv_coordinates = ()
    texture_resource = mesh_resource = ""
    texture = SimpleNamespace(header=Header(Time(0, 0), ""), format="", data=_NO_BYTES)
    mesh_file = SimpleNamespace(filename="", data=_NO_BYTES)
    mesh_use_embedded_materials = False


class MarkerArray(NamedTuple):
    """`visualization_msgs/MarkerArray`."""

    markers: Sequence[Marker]

    ROS_TYPE = "visualization_msgs/msg/MarkerArray"


DisplayMessage = PoseStamped | Path | CompressedImage | CameraInfo | OccupancyGrid | MarkerArray
