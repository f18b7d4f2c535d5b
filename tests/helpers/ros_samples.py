"""Messages that a simulation sends to ROS nodes, as CDR, and the topics that they are of."""

from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from prefect_robomaker.tasks.runtime.ros.wire import Topic

STORE = get_typestore(Stores.ROS2_HUMBLE)
TOPICS = [
    Topic("/clock", "rosgraph_msgs/msg/Clock"),
    Topic("/tf", "tf2_msgs/msg/TFMessage", depth=100),
    Topic("/odom", "nav_msgs/msg/Odometry"),
    Topic("/scan", "sensor_msgs/msg/LaserScan"),
    Topic("/map", "nav_msgs/msg/OccupancyGrid", is_latched=True, depth=1),
]
COMMANDS = "/cmd_vel"


def made(ros_type: str, **members: Any) -> Any:
    """A message of ROS 2."""
    return STORE.types[ros_type](**members)


def stamp(time_s: float) -> Any:
    return made("builtin_interfaces/msg/Time", sec=int(time_s), nanosec=round(1e9 * (time_s % 1)))


def header(time_s: float, frame: str) -> Any:
    return made("std_msgs/msg/Header", stamp=stamp(time_s), frame_id=frame)


def point(kind: str, *values: float) -> Any:
    return made(f"geometry_msgs/msg/{kind}", **dict(zip("xyzw", values, strict=False)))


def written(message: Any) -> bytes:
    return bytes(STORE.serialize_cdr(message, message.__msgtype__))


def clock(time_s: float) -> bytes:
    return written(made("rosgraph_msgs/msg/Clock", clock=stamp(time_s)))


def scan(time_s: float, count: int = 360) -> bytes:
    members = {
        "header": header(time_s, "base_scan"), "angle_min": -1.5, "angle_max": 1.5, "angle_increment": 0.25,
        "time_increment": 0.0, "scan_time": 0.05, "range_min": 0.1, "range_max": 12.0,
        "ranges": np.arange(count, dtype=np.float32) / 8, "intensities": np.zeros(0, np.float32),
    }  # fmt: skip
    return written(made("sensor_msgs/msg/LaserScan", **members))


def odometry(time_s: float) -> bytes:
    pose = made("geometry_msgs/msg/Pose", position=point("Point", 1.0, 2.0, 0.0), orientation=point("Quaternion", 0.0, 0.0, 0.6, 0.8))  # noqa: E501  # fmt: skip
    twist = made("geometry_msgs/msg/Twist", linear=point("Vector3", 0.5, 0.0, 0.0), angular=point("Vector3", 0.0, 0.0, 0.25))  # noqa: E501  # fmt: skip
    members = {
        "header": header(time_s, "odom"), "child_frame_id": "base_link",
        "pose": made("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.arange(36.0)),
        "twist": made("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
    }  # fmt: skip
    return written(made("nav_msgs/msg/Odometry", **members))


def transforms(time_s: float) -> bytes:
    def one(parent: str, child: str) -> Any:
        members = {"translation": point("Vector3", 1.0, 2.0, 3.0), "rotation": point("Quaternion", 0.0, 0.0, 0.0, 1.0)}
        transform = made("geometry_msgs/msg/Transform", **members)
        return made("geometry_msgs/msg/TransformStamped", header=header(time_s, parent), child_frame_id=child, transform=transform)  # noqa: E501  # fmt: skip

    message = made("tf2_msgs/msg/TFMessage", transforms=[one("odom", "base_link"), one("base_link", "base_scan")])
    return written(message)


def grid(value: int = 100) -> bytes:
    origin = made("geometry_msgs/msg/Pose", position=point("Point", -1.0, -2.0, 0.0), orientation=point("Quaternion", 0.0, 0.0, 0.0, 1.0))  # noqa: E501  # fmt: skip
    info = made("nav_msgs/msg/MapMetaData", map_load_time=stamp(0.0), resolution=0.05, width=3, height=2, origin=origin)
    cells = np.array([0, value, -1, 0, 0, value], np.int8)
    return written(made("nav_msgs/msg/OccupancyGrid", header=header(0.0, "map"), info=info, data=cells))
