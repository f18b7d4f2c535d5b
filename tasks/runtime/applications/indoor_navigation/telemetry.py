"""Publisher of the robot's state as ROS 2 messages."""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from .....schemas.worlds.world import Room
from ...episode.context import KeepsAttributes
from ...episode.occupancy_map import OccupancyMap
from ...recording import messages as ros
from ...recording.cdr import laser_scan
from ...recording.companions import WORLD_TOPIC
from ...recording.links import Links
from ...recording.recording import DEFAULT_FRAMES, Frames, Recorder
from ...recording.robot_description import robot_description
from ...recording.state_series import STATE_RATE_HZ, RowSeries, StateSeries
from ...robots.robot import Lidar, Robot
from ...robots.sensors.kind import SensorKind
from .scene_markers import goal_markers, occupancy_grid, robot_markers, world_markers

_ROUNDING_S = 1e-6
"""Tolerance for rounding errors in sums of time steps, in seconds."""


class RobotState(NamedTuple):
    """Pose, velocity and joint positions of the robot, in metres, radians and seconds."""

    time_s: float
    x: float
    y: float
    yaw: float
    linear: float
    angular: float
    joint_positions: tuple[float, ...]
    """Positions of the robot's joints, in the order of its joint list; joint velocities have the same order."""

    joint_velocities: tuple[float, ...]


def moving_body(robot: Robot) -> str:
    """Returns the name of the robot's body whose frame is `base_link`."""
    return f"{robot.prefix}{robot.footprint if robot.planar_joints and robot.footprint else robot.base}"


def links_of(robot: Robot, model: mujoco.MjModel, frames: Frames = DEFAULT_FRAMES) -> Links:
    """Returns the moving parts of a robot that have ROS frames (not the wheels of Scout-like robots)."""
    return Links(model, model.body(moving_body(robot)).id, frames.base, _wheels(robot, model))


def frames_of_bodies(robot: Robot, model: mujoco.MjModel, frames: Frames = DEFAULT_FRAMES) -> dict[int, str]:
    """Returns the ROS frame name of each body in `/tf`, by body number."""
    base = model.body(moving_body(robot)).id
    return {0: frames.map, base: frames.base, **links_of(robot, model, frames).frame_of}


def _wheels(robot: Robot, model: mujoco.MjModel) -> list[int]:
    """Returns the numbers of bodies that turn without a visible change, such as wheels."""
    joints = robot.joints if robot.is_differential else ()
    return [int(model.joint(f"{robot.prefix}{name}").bodyid[0]) for name in joints]


def _joint_names(robot: Robot) -> list[tuple[str, str]]:
    """Returns for each joint of a robot a pair of names: in the model, and in ROS messages."""
    # Scout's wheels are called as in ROS; those who describe a robot call its joints as they like.
    return [(name, f"{name}_joint" if robot.is_differential else name) for name in robot.joints]


class Telemetry(KeepsAttributes):
    """Publishes the ROS topics that the nodes of the real robot would publish.

    | topic | content | rate |
    | --- | --- | --- |
    | `/clock`, `/tf`, `/odom`, `/joint_states` | time, `odom` to `base_link`, motion, joints | 50 Hz |
    | `/scan` | the lidar | with every measurement |
    | topics of `robots/sensors`, as `/imu` | readings, with attitude in `/imu` | 20 Hz |
    | `/contacts` | what the robot touches | 50 Hz while it does |
    | `/goals` | the rooms' goals and which were visited | at the start and with every change |
    | `/map`, `/world`, `/robot` | the map, and what world and robot look like | once |
    | `/robot_description` | the robot as a URDF | once |
    | `/tf_static` | `map` to `odom`, `base_link` to `base_scan` and `base_footprint`, a link to `imu_link` | once |

    The odometry is exact, so that `map` and `odom` are the same.
    """

    KEPT = ("_start_s", "_samples", "_due_s")

    def __init__(self, recorder: Recorder, robot: Robot, known: OccupancyMap | None = None) -> None:
        self._recorder = recorder
        self._map = known
        self._robot = robot
        self._series: StateSeries | None = None
        self._scans: RowSeries | None = None
        self._readings: dict[type[SensorKind], RowSeries] = {}
        self._sites: dict[type[SensorKind], int] = {}
        """Ids of the sensors' sites in the model, by kind of sensor; they may be on moving parts."""
        self._shown: mujoco.MjModel | None = None
        self._start_s, self._samples, self._due_s = 0.0, 0, 0.0

    @property
    def frames(self) -> Frames:
        """Names of the robot's ROS frames."""
        return self._recorder.frames

    def start(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Publishes static topics and the first state.

        Args:
            model: The world with the robot.
            data: State of the model, after `mj_forward`.
        """
        self._model, self._data = model, data
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
        """Records the robot's current state if it is due; call it at least as often as topics are due."""
        if self._data.time >= self._due_s:
            self._samples += 1
            self._due_s = self._start_s + self._samples / STATE_RATE_HZ - _ROUNDING_S
            assert self._series is not None
            self._series.sample(self._recorder)

    def _make_series(self, model: mujoco.MjModel, data: mujoco.MjData) -> StateSeries:
        robot = self._robot
        base = robot.planar_joints or ((robot.free_joint,) if robot.free_joint else ())
        return StateSeries(
            model,
            data,
            [model.joint(f"{robot.prefix}{name}").id for name in robot.joints],
            base=[model.joint(f"{robot.prefix}{name}").id for name in base],
            joint_names=[shown for _, shown in _joint_names(robot)],
            joint_frame=self.frames.base,
            links=links_of(robot, model, self.frames) if base else None,
            frames=self.frames,
        )

    def _publish_static(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        robot, frames = self._robot, self.frames
        stamp = ros.Time.from_seconds(data.time)
        transforms = [ros.TransformStamped(ros.Header(stamp, frames.map), frames.odometry, ros.Transform())]
        base = model.body(moving_body(robot)).id
        known = frames_of_bodies(robot, model, frames)
        fixed_to = {int(model.body_weldid[body]): body for body in known}
        """Body with a ROS frame, by the body to which it is rigidly attached."""

        def add(frame: str, place: NDArray[np.float64], axes: NDArray[np.float64], body: int = base) -> None:
            """Adds a static ROS frame that is fixed to a body, from its position and axes in the world."""
            turn = data.xmat[body].reshape(3, 3).T
            quaternion = np.zeros(4)
            mujoco.mju_mat2Quat(quaternion, (turn @ axes).ravel())
            w, x, y, z = quaternion.tolist()
            pose = ros.Transform(ros.Vector3(*(turn @ (place - data.xpos[body])).tolist()), ros.Quaternion(x, y, z, w))
            transforms.append(ros.TransformStamped(ros.Header(stamp, known[body]), frame, pose))

        if frames.footprint != frames.base:
            at = data.xpos[base]
            add(frames.footprint, np.array((at[0], at[1], 0.0)), data.xmat[base].reshape(3, 3))
        if robot.lidar is not None:
            body = robot.footprint_id(model)
            foot = data.xmat[body].reshape(3, 3)
            add(frames.scan, data.xpos[body] + foot[:, 2] * robot.lidar.height_m, foot)
        for kind, names in robot.sensors:
            site = int(model.sensor_objid[model.sensor(f"{robot.prefix}{names[0]}").id])
            self._sites[kind] = site
            body = fixed_to.get(int(model.body_weldid[model.site_bodyid[site]]))
            if body is not None:  # what moves against all that has a frame, as on a ball, has no fixed place
                add(self._frame_of(kind), data.site_xpos[site], data.site_xmat[site].reshape(3, 3), body)
        self._recorder.add_static_transforms(transforms, data.time)
        self._mounts = transforms[1:]

    def _publish_looks(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        robot, stamp, frame = self._robot, ros.Time.from_seconds(data.time), self.frames.map
        if self._map is not None:
            self._recorder.write("/map", occupancy_grid(self._map, ros.Header(stamp, frame)), data.time)
        self._recorder.write(WORLD_TOPIC, world_markers(model, data, frame, stamp), data.time)
        frames = frames_of_bodies(robot, model, self.frames)
        del frames[0]  # the world has its own markers
        looks = robot_markers(model, data, frames, _wheels(robot, model), stamp)
        self._recorder.write("/robot", looks, data.time)
        self._recorder.announce("/contacts", type(looks))
        joints = {int(model.joint(f"{robot.prefix}{name}").id): shown for name, shown in _joint_names(robot)}
        base = model.body(moving_body(robot)).id
        described = robot_description(robot.name, model, data, base, frames, joints, self._mounts)
        self._recorder.write("/robot_description", ros.String(described), data.time)

    def publish_goals(self, rooms: Sequence[Room], visited: Sequence[bool]) -> None:
        """Publishes markers for the rooms' goals.

        Args:
            rooms: The rooms, each with its goal.
            visited: Whether the robot has been in each room.
        """
        time_s = self._data.time
        self._recorder.write("/goals", goal_markers(rooms, visited, time_s, self.frames.map), time_s)

    def publish_scan(self, time_s: float, ranges: NDArray[np.float32]) -> None:
        """Records a lidar measurement (metres) as a ROS `LaserScan` message."""
        if self._scans is None:
            assert self._robot.lidar is not None
            self._scans = RowSeries("/scan", laser_scan(_scan(self._robot.lidar, ranges, self.frames.scan)))
            self._recorder.add_series(self._scans)
        self._scans.add(self._recorder, time_s, ranges)

    def publish_reading(self, kind: type[SensorKind], time_s: float, numbers: Sequence[float]) -> None:
        """Records a sensor's measurement as a ROS message; does nothing if the kind of sensor has no topic.

        Args:
            kind: Kind of the sensor.
            time_s: Simulated time of the measurement, in seconds.
            numbers: The measurement, in the kind's units.
        """
        frame = self._frame_of(kind)
        if not kind.topic:
            return
        if kind.columns is None:
            header = ros.Header(ros.Time.from_seconds(time_s), frame)
            self._recorder.write(kind.topic, kind.message(header, numbers), time_s)
            return
        if kind not in self._readings:
            self._readings[kind] = RowSeries(kind.topic, kind.columns(frame))
            self._recorder.add_series(self._readings[kind])
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, self._data.site_xmat[self._sites[kind]])
        self._readings[kind].add(self._recorder, time_s, np.array((*quaternion[[1, 2, 3, 0]], *numbers)))

    def _frame_of(self, kind: type[SensorKind]) -> str:
        return self.frames._asdict().get(kind.name, f"{kind.name}_link")


def _scan(lidar: Lidar, ranges: NDArray[np.float32], frame: str) -> ros.LaserScan:
    angles = lidar.angles_rad
    return ros.LaserScan(
        header=ros.Header(ros.Time(0, 0), frame),
        angle_min=float(angles[0]),
        angle_max=float(angles[-1]),
        angle_increment=lidar.angle_increment_rad,
        time_increment=0.0,
        scan_time=1 / lidar.rate_hz,
        range_min=lidar.range_min_m,
        range_max=lidar.range_max_m,
        ranges=ranges,
    )
