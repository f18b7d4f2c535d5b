"""Publishes the robot's state as ROS 2 messages."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import messages as ros
from ..context import Recorder
from . import lidar
from .robots.robot import Robot


class RobotState(NamedTuple):
    """Where the robot is and how it moves; metres, radians and seconds."""

    time_s: float
    x: float
    y: float
    yaw: float
    linear: float
    angular: float
    joint_positions: tuple[float, ...]
    """In the order of the robot's joints; likewise the velocities."""

    joint_velocities: tuple[float, ...]


class Telemetry:
    """Writes what a robot's own ROS nodes would publish.

    | topic | what | how often |
    | --- | --- | --- |
    | `/clock`, `/tf`, `/odom`, `/joint_states` | time, `odom` to `base_link`, motion, joints | every control step |
    | `/scan` | the lidar | with every measurement |
    | `/tf_static` | `map` to `odom`, `base_link` to `base_scan` | once |

    The odometry is exact, so that `map` and `odom` are the same.
    """

    def __init__(self, recorder: Recorder, scan_period_s: float, robot: Robot) -> None:
        self._recorder = recorder
        self._scan_period_s = scan_period_s
        # Scout's wheels are called as in ROS; those who describe a robot call its joints as they like.
        self._joints = tuple(f"{joint}_joint" for joint in robot.joints) if robot.name == "scout" else robot.joints
        self._lidar_height_m = robot.lidar_height_m

    def start(self, time_s: float) -> None:
        """Publishes what does not change."""
        stamp = ros.Time.from_seconds(time_s)
        transforms = [ros.TransformStamped(ros.Header(stamp, "map"), "odom", ros.Transform())]
        if self._lidar_height_m is not None:
            mount = ros.Transform(translation=ros.Vector3(z=self._lidar_height_m))
            transforms.append(ros.TransformStamped(ros.Header(stamp, "base_link"), "base_scan", mount))
        self._recorder.write("/tf_static", ros.TFMessage(tuple(transforms)), time_s)

    def publish_state(self, state: RobotState) -> None:
        """Publishes time, pose, motion and joints."""
        time_s = state.time_s
        stamp = ros.Time.from_seconds(time_s)
        header = ros.Header(stamp, "odom")
        position = ros.Vector3(state.x, state.y, 0.0)
        rotation = ros.Quaternion(0.0, 0.0, math.sin(state.yaw / 2), math.cos(state.yaw / 2))
        twist = ros.Twist(ros.Vector3(state.linear, 0.0, 0.0), ros.Vector3(0.0, 0.0, state.angular))
        write = self._recorder.write
        write("/clock", ros.Clock(stamp), time_s)
        transform = ros.TransformStamped(header, "base_link", ros.Transform(position, rotation))
        write("/tf", ros.TFMessage((transform,)), time_s)
        write("/odom", ros.Odometry(header, "base_link", ros.Pose(position, rotation), twist), time_s)
        joints = ros.JointState(
            ros.Header(stamp, "base_link"), self._joints, state.joint_positions, state.joint_velocities
        )
        write("/joint_states", joints, time_s)

    def publish_scan(self, time_s: float, ranges: NDArray[np.float32]) -> None:
        """Publishes a measurement of the lidar."""
        scan = ros.LaserScan(
            header=ros.Header(ros.Time.from_seconds(time_s), "base_scan"),
            angle_min=lidar.SCAN_ANGLE_MIN_RAD,
            angle_max=lidar.SCAN_ANGLE_MIN_RAD + (lidar.SCAN_RAYS - 1) * lidar.SCAN_ANGLE_INCREMENT_RAD,
            angle_increment=lidar.SCAN_ANGLE_INCREMENT_RAD,
            time_increment=0.0,
            scan_time=self._scan_period_s,
            range_min=lidar.SCAN_RANGE_MIN_M,
            range_max=lidar.SCAN_RANGE_MAX_M,
            ranges=ranges,
        )
        self._recorder.write("/scan", scan, time_s)
