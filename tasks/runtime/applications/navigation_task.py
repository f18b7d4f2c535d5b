"""The task of indoor navigation: drive through every room of a world and stop.

Built for dm_control's `rl.control.Environment`, which calls the methods in this order at every step:
`before_step`, (physics), `after_step`, `get_reward`, `get_observation`, `get_termination`.
"""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false
# dm_control has no annotations, so that its abstract methods seem to return None.
# pyright: reportIncompatibleMethodOverride=false

import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from dm_control.rl.control import Task
from dm_env import specs
from numpy.typing import NDArray

from ....schemas.world import World
from ..context import ActionError, Recorder
from ..results import EnvironmentReport
from . import lidar
from .collisions import CollisionMonitor
from .mission import Mission
from .robot_scout import (
    LIDAR_HEIGHT_M,
    MAX_ANGULAR_RADPS,
    MAX_LINEAR_MPS,
    PREFIX,
    TRACK_WIDTH_M,
    WHEEL_RADIUS_M,
    WHEELS,
)
from .scene import ScenePhysics
from .telemetry import RobotState, Telemetry

CONTROL_TIMESTEP_S = 0.05
SCAN_EVERY_STEPS = 4

_MAX_LINEAR_CHANGE = 1.2 * CONTROL_TIMESTEP_S
_MAX_ANGULAR_CHANGE = 8.0 * CONTROL_TIMESTEP_S
"""The motor controller's ramps: 1.2 m/s² and 8 rad/s²."""

_SETTLED_S = 0.5
"""With all rooms visited, standing still on command for this long ends the run."""

_IDLE_S = 10.0
"""Standing still on command for this long ends the run in any case: the agent has given up."""

Action = NDArray[np.float64]


class NavigationTask(Task):
    """Moves Scout by commanded velocities, senses, keeps the score."""

    def __init__(self, world: World, rng: np.random.Generator, recorder: Recorder, time_limit_s: float) -> None:
        """Prepares the task; a run begins with `initialize_episode`.

        Args:
          world: the world that the physics was made from.
          rng: source of the first heading and of the lidar's noise.
          recorder: where ROS 2 messages go.
          time_limit_s: simulated time that ends a run.
        """
        self._world = world
        self._rng = rng
        self._recorder = recorder
        self._telemetry = Telemetry(recorder, SCAN_EVERY_STEPS * CONTROL_TIMESTEP_S)
        self._time_limit_s = time_limit_s
        self._goals = np.array([room.goal for room in world.floorplan.rooms], dtype=np.float64)
        self._goals.setflags(write=False)

    # -- Called by dm_control ------------------------------------------------

    def initialize_episode(self, physics: ScenePhysics) -> None:
        """Stands the robot on the origin with a random heading and starts a new score."""
        self._bind(physics)
        heading = self._rng.uniform(-math.pi, math.pi)
        self._root_pose[:] = (0.0, 0.0, 0.0, math.cos(heading / 2), 0.0, 0.0, math.sin(heading / 2))
        mujoco.mj_forward(physics.model.ptr, physics.data.ptr)
        self._start_sensing(physics)
        self.mission = Mission(self._world.floorplan.rooms, self._time_limit_s)
        self._linear = self._angular = 0.0
        self._steps = 0
        self._still_s = 0.0
        self._ever_moved = False
        self._newly_visited = 0
        self._visited = np.zeros(len(self._goals), dtype=np.bool_)
        self._visited.setflags(write=False)
        if self._recorder.enabled:
            self._telemetry.start(float(self._data.time))
        self._sense()

    def before_step(self, action: Action | Sequence[float], physics: ScenePhysics) -> None:
        """Hands a command to the motor controller, clipped to what the robot can do.

        Args:
          action: forward velocity in m/s and turning rate in rad/s.
          physics: unused; the task is bound to it.

        Raises:
          ActionError: the action is not two finite numbers.
        """
        del physics
        linear, angular = self._checked(action)
        standing = linear == 0.0 and angular == 0.0
        self._ever_moved |= not standing
        self._still_s = self._still_s + CONTROL_TIMESTEP_S if standing else 0.0
        self._linear += _clip(linear - self._linear, _MAX_LINEAR_CHANGE)
        self._angular += _clip(angular - self._angular, _MAX_ANGULAR_CHANGE)
        turn = self._angular * TRACK_WIDTH_M / 2
        self._control[0] = (self._linear - turn) / WHEEL_RADIUS_M
        self._control[1] = (self._linear + turn) / WHEEL_RADIUS_M

    def after_step(self, physics: ScenePhysics) -> None:
        """Reads the sensors, keeps the score, records."""
        del physics
        self._steps += 1
        self._sense()

    def get_reward(self, physics: ScenePhysics) -> float:
        """1 for every room that was entered for the first time."""
        del physics
        return float(self._newly_visited)

    def get_observation(self, physics: ScenePhysics) -> dict[str, NDArray[Any]]:
        """What the robot knows; see `observation_spec`."""
        del physics
        state = self._state
        return {
            "time": np.array(state.time_s),
            "pose": np.array((state.x, state.y, state.yaw)),
            "velocity": np.array((state.linear, state.angular)),
            "wheel_velocity": np.array(state.wheel_velocities),
            "imu": self._imu.copy(),
            "scan": self._scan,
            "proximity": self._proximity,
            "scan_time": self._scan_time,
            "goals": self._goals,
            "visited": self._visited,
        }

    def get_termination(self, physics: ScenePhysics) -> float | None:
        """0 when the run is over, else nothing."""
        del physics
        over = (
            (self.mission.all_visited and self._still_s >= _SETTLED_S)
            or (self._ever_moved and self._still_s >= _IDLE_S)
            or self.mission.tipped_over
            or self._state.time_s >= self._time_limit_s - 1e-6
        )
        return 0.0 if over else None

    def action_spec(self, physics: ScenePhysics) -> specs.BoundedArray:
        """Forward velocity in m/s and turning rate in rad/s, counter-clockwise positive."""
        del physics
        limit = np.array((MAX_LINEAR_MPS, MAX_ANGULAR_RADPS))
        return specs.BoundedArray((2,), np.float64, -limit, limit, name="velocity_command")

    def observation_spec(self, physics: ScenePhysics) -> dict[str, specs.Array]:
        """Names, shapes and units of what the robot knows."""
        del physics
        rooms = len(self._goals)
        ranges = specs.BoundedArray((lidar.SCAN_RAYS,), np.float32, 0.0, np.inf, name="scan: m, from -pi on, 5 Hz")
        near = specs.BoundedArray(
            lidar.PROXIMITY_ANGLES_RAD.shape, np.float32, 0.0, np.inf, name="proximity: m, in the bumper, right to left"
        )
        return {
            "time": specs.Array((), np.float64, name="time: s"),
            "pose": specs.Array((3,), np.float64, name="pose: x m, y m, yaw rad in the map"),
            "velocity": specs.Array((2,), np.float64, name="velocity: forward m/s, turning rad/s"),
            "wheel_velocity": specs.Array((2,), np.float64, name="wheel_velocity: left, right rad/s"),
            "imu": specs.Array((6,), np.float64, name="imu: gyro rad/s, accelerometer m/s^2"),
            "scan": ranges,
            "proximity": near,
            "scan_time": specs.Array((), np.float64, name="scan_time: s, of scan and proximity"),
            "goals": specs.Array((rooms, 2), np.float64, name="goals: m, one free spot per room"),
            "visited": specs.Array((rooms,), np.bool_, name="visited: rooms entered so far"),
        }

    # -- Called by the environment --------------------------------------------

    def report(self) -> EnvironmentReport:
        """Judges the run so far."""
        collisions = self._monitor.finish()
        return self.mission.report(collisions, self._monitor.count, self._monitor.max_force_N)

    # -- Inside -----------------------------------------------------------------

    def _bind(self, physics: ScenePhysics) -> None:
        """Takes views of the robot's part of the state, so that a step need not look anything up."""
        model, data = physics.model.ptr, physics.data.ptr
        self._data = data
        root = model.joint(f"{PREFIX}base")
        position, velocity = int(root.qposadr[0]), int(root.dofadr[0])
        self._root_pose = data.qpos[position : position + 7]
        self._root_velocity = data.qvel[velocity : velocity + 6]
        wheels = [model.joint(f"{PREFIX}{wheel}") for wheel in WHEELS]
        first = int(wheels[0].qposadr[0])
        self._wheel_positions = data.qpos[first : first + 2]
        first = int(wheels[0].dofadr[0])
        self._wheel_velocities = data.qvel[first : first + 2]
        first = model.actuator(f"{PREFIX}{WHEELS[0]}").id
        self._control = data.ctrl[first : first + 2]
        first = int(model.sensor(f"{PREFIX}gyro").adr[0])
        self._imu = data.sensordata[first : first + 6]

    def _start_sensing(self, physics: ScenePhysics) -> None:
        model, data = physics.model.ptr, physics.data.ptr
        body = model.body(f"{PREFIX}base").id
        self._monitor = CollisionMonitor(model, data, body, [item.id for item in self._world.furniture])
        physics.between_substeps = self._monitor.sample
        self._lidar = lidar.RangeFinder(
            model, data, body, LIDAR_HEIGHT_M, lidar.SCAN_ANGLES_RAD, lidar.SCAN_RANGE_MAX_M, physics.unseen_group
        )
        self._bumper = lidar.RangeFinder(
            model,
            data,
            body,
            lidar.PROXIMITY_HEIGHT_M,
            lidar.PROXIMITY_ANGLES_RAD,
            lidar.PROXIMITY_RANGE_MAX_M,
            physics.unseen_group,
        )

    def _sense(self) -> None:
        self._state = self._read_state()
        _, _, _, _, qx, qy, _ = self._root_pose.tolist()
        tilt_rad = 2 * math.asin(min(1.0, math.hypot(qx, qy)))
        self._newly_visited = self.mission.update(self._state, tilt_rad)
        if self._newly_visited:
            self._visited = np.array([time_s is not None for time_s in self.mission.first_visit_s])
            self._visited.setflags(write=False)
        if self._recorder.enabled:
            self._telemetry.publish_state(self._state)
        if self._steps % SCAN_EVERY_STEPS == 0:
            self._measure_ranges()

    def _measure_ranges(self) -> None:
        noise = self._rng.normal(0.0, lidar.SCAN_NOISE_STD_M, lidar.SCAN_RAYS)
        ranges = np.maximum(self._lidar.measure() + noise, lidar.SCAN_RANGE_MIN_M)
        self._scan = ranges.astype(np.float32)
        self._proximity = self._bumper.measure().astype(np.float32)
        self._scan_time = np.array(self._state.time_s)
        if self._recorder.enabled:
            self._telemetry.publish_scan(self._state.time_s, self._scan)

    def _read_state(self) -> RobotState:
        x, y, _, qw, qx, qy, qz = self._root_pose.tolist()
        yaw = math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))
        vx, vy, _, _, _, turning = self._root_velocity.tolist()
        return RobotState(
            time_s=float(self._data.time),
            x=x,
            y=y,
            yaw=yaw,
            linear=vx * math.cos(yaw) + vy * math.sin(yaw),
            angular=turning,
            wheel_positions=tuple(self._wheel_positions.tolist()),
            wheel_velocities=tuple(self._wheel_velocities.tolist()),
        )

    @staticmethod
    def _checked(action: Action | Sequence[float]) -> tuple[float, float]:
        try:
            linear, angular = (float(value) for value in action)
        except (TypeError, ValueError):
            shown = f"an array of shape {action.shape}" if isinstance(action, np.ndarray) else repr(action)[:80]
            raise ActionError(f"action: {shown} is not (forward velocity in m/s, turning rate in rad/s)") from None
        if not (math.isfinite(linear) and math.isfinite(angular)):
            raise ActionError(f"action: ({linear}, {angular}) has to be two finite numbers, m/s and rad/s")
        return _clip(linear, MAX_LINEAR_MPS), _clip(angular, MAX_ANGULAR_RADPS)


def _clip(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
