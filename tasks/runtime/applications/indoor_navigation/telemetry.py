"""Publishes the robot's state as ROS 2 messages."""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from .....schemas.worlds.world import Room
from ...episode.context import KeepsAttributes
from ...recording import messages as ros
from ...recording.companions import WORLD_TOPIC
from ...recording.links import Links
from ...recording.recording import Recorder
from ...recording.state_series import BASE_FRAME, ODOMETRY_FRAME, STATE_RATE_HZ, ScanSeries, StateSeries
from ...robots.robot import Lidar, Robot
from .occupancy_map import OccupancyMap
from .scene_markers import goal_markers, occupancy_grid, robot_markers, world_markers

MAP_FRAME = "map"
_ROUNDING_S = 1e-6
"""Forgives rounding in sums of time steps."""


class RobotState(NamedTuple):
    """Pose, velocity and joints of the robot; metres, radians and seconds."""

    time_s: float
    x: float
    y: float
    yaw: float
    linear: float
    angular: float
    joint_positions: tuple[float, ...]
    """Joint positions, in the order of the robot's joints; likewise the velocities."""

    joint_velocities: tuple[float, ...]


def moving_body(robot: Robot) -> str:
    """Returns the body whose frame is `base_link`."""
    return f"{robot.prefix}{robot.footprint if robot.planar_joints and robot.footprint else robot.base}"


def links_of(robot: Robot, model: mujoco.MjModel) -> Links:
    """Returns the moving parts of a robot that have frames of their own: all but the wheels of those like Scout."""
    return Links(model, model.body(moving_body(robot)).id, BASE_FRAME, _wheels(robot, model))


def frames_of_bodies(robot: Robot, model: mujoco.MjModel) -> dict[int, str]:
    """Returns the frames that `/tf` tells of, by numbers of bodies in a compiled world: not all of them have names."""
    return {0: MAP_FRAME, model.body(moving_body(robot)).id: BASE_FRAME, **links_of(robot, model).frame_of}


def _wheels(robot: Robot, model: mujoco.MjModel) -> list[int]:
    """Bodies that turn without being seen to."""
    joints = robot.joints if robot.is_differential else ()
    return [int(model.joint(f"{robot.prefix}{name}").bodyid[0]) for name in joints]


class Telemetry(KeepsAttributes):
    """Writes what a robot's own ROS nodes would publish.

    | topic | what | how often |
    | --- | --- | --- |
    | `/clock`, `/tf`, `/odom`, `/joint_states` | time, `odom` to `base_link`, motion, joints | 50 Hz |
    | `/scan` | the lidar | with every measurement |
    | `/contacts` | what the robot touches | 50 Hz while it does |
    | `/goals` | the rooms' goals and which were visited | at the start and with every change |
    | `/map`, `/world`, `/robot` | the map, and what world and robot look like | once |
    | `/tf_static` | `map` to `odom`, `base_link` to `base_scan` | once |

    The odometry is exact, so that `map` and `odom` are the same.
    """

    KEPT = ("_start_s", "_samples", "_due_s")

    def __init__(self, recorder: Recorder, robot: Robot, known: OccupancyMap | None = None) -> None:
        self._recorder = recorder
        self._map = known
        self._robot = robot
        self._series: StateSeries | None = None
        self._scans: ScanSeries | None = None
        self._shown: mujoco.MjModel | None = None
        self._start_s, self._samples, self._due_s = 0.0, 0, 0.0

    def start(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Publishes what does not change, and the first state.

        Args:
            model: the world with the robot.
            data: its state, after `mj_forward`.
        """
        self._data = data
        self._start_s, self._samples, self._due_s = data.time, 0, data.time - _ROUNDING_S
        self._publish_static(model, data)
        if self._shown is not model:
            self._shown = model
            self._publish_looks(model, data)
        if self._series is None or self._series.data is not data:
            if self._series is not None:
                self._recorder.remove_series(self._series)
            self._series = self._make_series(model, data)
            self._recorder.add_series(self._series)
        self.sample()

    def sample(self) -> None:
        """Samples the state when it is time; to be called at least as often as that is."""
        if self._data.time >= self._due_s:
            self._samples += 1
            self._due_s = self._start_s + self._samples / STATE_RATE_HZ - _ROUNDING_S
            assert self._series is not None
            self._series.sample(self._recorder)

    def _make_series(self, model: mujoco.MjModel, data: mujoco.MjData) -> StateSeries:
        robot = self._robot
        base = robot.planar_joints or ((robot.free_joint,) if robot.free_joint else ())
        # Scout's wheels are called as in ROS; those who describe a robot call its joints as they like.
        names = [f"{joint}_joint" for joint in robot.joints] if robot.is_differential else robot.joints
        return StateSeries(
            model,
            data,
            [model.joint(f"{robot.prefix}{name}").id for name in robot.joints],
            base=[model.joint(f"{robot.prefix}{name}").id for name in base],
            joint_names=names,
            joint_frame=BASE_FRAME,
            links=links_of(robot, model) if base else None,
        )

    def _publish_static(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        robot = self._robot
        stamp = ros.Time.from_seconds(data.time)
        transforms = [ros.TransformStamped(ros.Header(stamp, MAP_FRAME), ODOMETRY_FRAME, ros.Transform())]
        if robot.lidar is not None:
            # Where the lidar stands on the body it is fixed to, seen from the robot's base.
            base, body = model.body(moving_body(robot)).id, robot.footprint_id(model)
            turn = data.xmat[base].reshape(3, 3).T
            foot = data.xmat[body].reshape(3, 3)
            place = turn @ (data.xpos[body] + foot[:, 2] * robot.lidar.height_m - data.xpos[base])
            quaternion = np.zeros(4)
            mujoco.mju_mat2Quat(quaternion, (turn @ foot).ravel())
            w, x, y, z = quaternion.tolist()
            mount = ros.Transform(ros.Vector3(*place.tolist()), ros.Quaternion(x, y, z, w))
            transforms.append(ros.TransformStamped(ros.Header(stamp, BASE_FRAME), "base_scan", mount))
        self._recorder.add_static_transforms(transforms, data.time)

    def _publish_looks(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        robot, stamp = self._robot, ros.Time.from_seconds(data.time)
        if self._map is not None:
            self._recorder.write("/map", occupancy_grid(self._map, ros.Header(stamp, MAP_FRAME)), data.time)
        self._recorder.write(WORLD_TOPIC, world_markers(model, data, MAP_FRAME, stamp), data.time)
        frames = {model.body(moving_body(robot)).id: BASE_FRAME, **links_of(robot, model).frame_of}
        looks = robot_markers(model, data, frames, _wheels(robot, model), stamp)
        self._recorder.write("/robot", looks, data.time)

    def publish_goals(self, rooms: Sequence[Room], visited: Sequence[bool]) -> None:
        """Publishes the goals.

        Args:
            rooms: the rooms, each with its goal.
            visited: which of them the robot has been in.
        """
        time_s = self._data.time
        self._recorder.write("/goals", goal_markers(rooms, visited, time_s), time_s)

    def publish_scan(self, time_s: float, ranges: NDArray[np.float32]) -> None:
        """Publishes a measurement of the lidar."""
        if self._scans is None:
            assert self._robot.lidar is not None
            self._scans = ScanSeries("/scan", _scan(self._robot.lidar, ranges))
            self._recorder.add_series(self._scans)
        self._scans.add(self._recorder, time_s, ranges)


def _scan(lidar: Lidar, ranges: NDArray[np.float32]) -> ros.LaserScan:
    angles = lidar.angles_rad
    return ros.LaserScan(
        header=ros.Header(ros.Time(0, 0), "base_scan"),
        angle_min=float(angles[0]),
        angle_max=float(angles[-1]),
        angle_increment=lidar.angle_increment_rad,
        time_increment=0.0,
        scan_time=1 / lidar.rate_hz,
        range_min=lidar.range_min_m,
        range_max=lidar.range_max_m,
        ranges=ranges,
    )
