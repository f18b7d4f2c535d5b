"""dm_control task of indoor navigation: drive through every room of a world and stop.

Built for dm_control's `rl.control.Environment`, which calls the methods in this order at every step:
`before_step`, (physics), `after_step`, `get_reward`, `get_observation`, `get_termination`.
"""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false
# dm_control has no annotations, so that its abstract methods seem to return None.
# pyright: reportIncompatibleMethodOverride=false

import math
from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np
from dm_control.rl.control import Task
from dm_env import specs
from numpy.typing import NDArray

from .....schemas.worlds.world import World
from ...axes.imperfections import (
    CommandDelay,
    CommandGains,
    DelayedController,
    LateItems,
    LidarErrors,
    OdometryDrift,
    OdometryErrors,
    ScaledController,
    WheelSlip,
)
from ...episode.occupancy_map import OccupancyMap
from ...episode.run_results import EnvironmentReport
from ...recording.recording import Frames, Recorder
from ...robots.drives import DifferentialDrive, VelocityController, VelocityDrive, bind_base, take_home_pose
from ...robots.robot import CONTROL_TIMESTEP_S, Action, Lidar, Robot
from . import lidar
from .mission import CollisionMonitor, Mission
from .scene_markers import ContactMarkers
from .standstill import Standstill
from .telemetry import RobotState, Telemetry
from .world_with_robot import ScenePhysics

_SETTLED_S = 0.5
"""Seconds of standing still on command that end the run once all rooms are visited."""

_IDLE_S = 10.0
"""Seconds of standing still on command that end the run in any case: the agent has given up."""

_KEPT = ("_steps", "_still_s", "_ever_moved", "_newly_visited", "_visited")
_KEPT_RANGES = ("_scan", "_proximity", "_scan_time")


Ranges = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float64]]
"""Lidar scan and proximity ranges in metres, and the time of the measurement in seconds."""


class NavigationTask(Task):
    """dm_control task: applies the robot's actions, reads its sensors, and scores visited rooms and collisions."""

    def __init__(
        self,
        world: World,
        robot: Robot,
        rng: np.random.Generator,
        recorder: Recorder,
        time_limit_s: float,
        known: OccupancyMap | None = None,
    ) -> None:
        """Prepares the task; each run begins with `initialize_episode`.

        Args:
            world: World that the physics was made from.
            robot: Robot that was put into the world.
            rng: Random generator for the first heading and for the lidar's noise.
            recorder: Recorder of ROS 2 messages.
            time_limit_s: Simulated time that ends a run.
            known: The world's map, for the recording.
        """
        self._world = world
        self._robot = robot
        self._rng = rng
        self._recorder = recorder
        self._telemetry = Telemetry(recorder, robot, known)
        self.time_limit_s = time_limit_s
        self.lidar_errors = LidarErrors(robot.lidar.noise_std_m) if robot.lidar else None
        """Errors of the robot's lidar; None: the robot has none."""
        self.command_delay = CommandDelay()
        self.command_gains = CommandGains(turn=1.0 if isinstance(robot.drive, VelocityDrive) else None)
        self.wheel_slip = WheelSlip() if isinstance(robot.drive, DifferentialDrive) else None
        """Slip of the wheels; None: the robot has none on two sides."""
        self.odometry_errors = OdometryErrors()
        self._goals = np.array([room.goal for room in world.floorplan.rooms], dtype=np.float64)
        self._goals.setflags(write=False)

    # -- Called by dm_control ------------------------------------------------

    def initialize_episode(self, physics: ScenePhysics) -> None:
        """Places the robot at the origin with a random heading, and resets its controller, sensors and score."""
        self._bind(physics)
        heading = self._rng.uniform(-math.pi, math.pi)
        self._base.place(heading)
        take_home_pose(self._robot, physics.model.ptr, physics.data.ptr)
        mujoco.mj_forward(physics.model.ptr, physics.data.ptr)
        self._start_sensing(physics)
        self._controller = self._robot.drive.bind(physics.model.ptr, physics.data.ptr, self._robot.prefix)
        if self.wheel_slip is not None and isinstance(self._controller, VelocityController):
            self._controller.transmitted = self.wheel_slip.transmitted
        # Generators of their own leave the run's as it is; this one comes after that of the lidar.
        self._drift = OdometryDrift(self.odometry_errors, self._rng.spawn(1)[0])
        if not self.command_gains.change_nothing:
            self._controller = ScaledController(self._controller, self.command_gains)
        if self.command_delay.delay_s > 0:
            self._controller = DelayedController(self._controller, self.command_delay.delay_s)
        physics.between_substeps = self._between_substeps()
        self.mission = Mission(self._world.floorplan.rooms, self.time_limit_s)
        self._standstill = Standstill(self._robot, physics.model.ptr, physics.data.ptr)
        self._steps = 0
        self._still_s = 0.0
        self._ever_moved = False
        self._newly_visited = 0
        self._visited = np.zeros(len(self._goals), dtype=np.bool_)
        self._visited.setflags(write=False)
        if self._recorder.enabled:
            self._telemetry.start(physics.model.ptr, physics.data.ptr)
            self._telemetry.publish_goals(self._world.floorplan.rooms, self._visited.tolist())
        self._sense()

    def before_step(self, action: Action, physics: ScenePhysics) -> None:
        """Passes a velocity command to the robot's controller, which limits it to the robot's largest speeds.

        Args:
            action: Command in the form of `action_spec`.
            physics: Unused; the task is bound to it.

        Raises:
            ActionError: The action does not fit this robot.
        """
        del physics
        standing = self._controller.command(action)
        self._standstill.command(action)
        self._ever_moved |= not standing
        self._still_s = self._still_s + CONTROL_TIMESTEP_S if standing else 0.0

    def after_step(self, physics: ScenePhysics) -> None:
        """Reads the sensors, updates the score, and records ROS messages, after each control step."""
        del physics
        self._steps += 1
        self._sense()

    def get_reward(self, physics: ScenePhysics) -> float:
        """Returns the reward: 1 for every room that was entered for the first time in this step."""
        del physics
        return float(self._newly_visited)

    def get_observation(self, physics: ScenePhysics) -> dict[str, NDArray[Any]]:
        """Returns the robot's observation of the current step, an array for each name; see `observation_spec`."""
        del physics
        state = self._state
        observation = {
            "time": np.array(state.time_s),
            "pose": np.array(self._pose),
            "velocity": np.array((state.linear, state.angular)),
            "goals": self._goals,
            "visited": self._visited,
        }
        if self._robot.is_differential:
            # Encoders count what the wheels turn, also what is lost to the floor.
            transmitted = self.wheel_slip.transmitted if self.wheel_slip else 1.0
            observation["wheel_velocity"] = np.array(state.joint_velocities) / transmitted
        else:
            observation["joint_position"] = np.array(state.joint_positions)
            observation["joint_velocity"] = np.array(state.joint_velocities)
        observation |= {kind.name: np.array(read()) for kind, read in self._sensors.items()}
        if self._ranging is not None:
            observation.update(scan=self._scan, proximity=self._proximity, scan_time=self._scan_time)
        return observation

    def get_termination(self, physics: ScenePhysics) -> float | None:
        """Returns the discount 0 when the run is over, else `None`.

        It is over when the robot stands with all rooms visited, stands long after it has moved, has tipped over, or the
        time limit is reached.
        """
        del physics
        over = (
            (self.mission.all_visited and self._still_s >= _SETTLED_S)
            or (self._ever_moved and self._still_s >= _IDLE_S)
            or self.mission.tipped_over
            or self._state.time_s >= self.time_limit_s - 1e-6
        )
        return 0.0 if over else None

    def action_spec(self, physics: ScenePhysics) -> specs.BoundedArray:
        """Returns the spec of actions: forward velocity (m/s) and turning rate (rad/s), or actuator commands."""
        return self._robot.drive.action_spec(physics.model.ptr, self._robot.prefix)

    def observation_spec(self, physics: ScenePhysics) -> dict[str, specs.Array]:
        """Returns the shape, type and unit of each array in the robot's observation, by name."""
        rooms, joints = len(self._goals), len(self._robot.joints)
        observed = {
            "time": specs.Array((), np.float64, name="time: s"),
            "pose": specs.Array((3,), np.float64, name="pose: x m, y m, yaw rad in the map"),
            "velocity": specs.Array((2,), np.float64, name="velocity: forward m/s, turning rad/s"),
            "goals": specs.Array((rooms, 2), np.float64, name="goals: m, one free spot per room"),
            "visited": specs.Array((rooms,), np.bool_, name="visited: rooms entered so far"),
        }
        if self._robot.is_differential:
            observed["wheel_velocity"] = specs.Array((2,), np.float64, name="wheel_velocity: left, right rad/s")
        else:
            called = ", ".join(self._robot.joints)
            observed["joint_position"] = specs.Array((joints,), np.float64, name=f"joint_position: rad or m, {called}")
            observed["joint_velocity"] = specs.Array((joints,), np.float64, name=f"joint_velocity: 1/s, {called}")
        for kind, names in self._robot.sensors:
            size = len(self._reader(names, physics)())
            observed[kind.name] = specs.Array((size,), np.float64, name=f"{kind.name}: {kind.units}")
        return observed if self._robot.lidar is None else observed | _range_specs(self._robot.lidar)

    # -- Called by the environment --------------------------------------------

    @property
    def frames(self) -> Frames:
        """Names of the ROS frames in the robot's recording."""
        return self._recorder.frames

    def renew(self, rng: np.random.Generator) -> None:
        """Gives the task another random generator, for the episode that begins next."""
        self._rng = rng

    def state(self) -> dict[str, Any]:
        """Returns the task's state without that of the physics, for a checkpoint; see `checkpoints.Resumable`."""
        return {
            "own": {name: getattr(self, name) for name in (*_KEPT, *_KEPT_RANGES) if hasattr(self, name)},
            "mission": self.mission.state(),
            "standstill": self._standstill.state(),
            "monitor": self._monitor.state(),
            "controller": self._controller.state(),
            "telemetry": self._telemetry.state(),
            "drift": self._drift.state(),
            "late": (self._chance.bit_generator.state, self._late.state()),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Restores the task's state from a checkpoint, once the physics have been restored.

        Args:
            state: Result of `state`, perhaps of an earlier release.
        """
        for name, value in state["own"].items():
            setattr(self, name, value)
        self.mission.restore(state["mission"])
        self._monitor.restore(state["monitor"])
        if "standstill" in state:  # checkpoints of an earlier release have none
            self._standstill.restore(state["standstill"])
        self._controller.restore(state["controller"])
        self._telemetry.restore(state["telemetry"])
        self._chance.bit_generator.state, late = state["late"]
        self._late.restore(late)
        if "drift" in state:  # checkpoints of an earlier release have none
            self._drift.restore(state["drift"])
        self._state, _ = self._read_state()
        self._pose = self._drift.told(self._state.x, self._state.y, self._state.yaw)

    def report(self) -> EnvironmentReport:
        """Ends open collisions, and returns the verdict, metrics and notes of the run so far."""
        collisions = self._monitor.finish()
        monitor = self._monitor
        report = self.mission.report(collisions, monitor.count, monitor.max_force_N, can_touch=monitor.can_touch)
        return report.model_copy(update={"notes": [*self._robot.warnings, *self._standstill.notes()]})

    # -- Inside -----------------------------------------------------------------

    def _bind(self, physics: ScenePhysics) -> None:
        """Stores views of the robot's part of the physics state, which saves look-ups in each step."""
        model, data, robot = physics.model.ptr, physics.data.ptr, self._robot
        self._data = data
        self._base = bind_base(robot, model, data)
        joints = [model.joint(f"{robot.prefix}{name}") for name in robot.joints]
        self._joint_positions = _picked(data.qpos, [int(joint.qposadr[0]) for joint in joints])
        self._joint_velocities = _picked(data.qvel, [int(joint.dofadr[0]) for joint in joints])
        self._sensors = {kind: self._reader(names, physics) for kind, names in robot.sensors}

    def _reader(self, names: Sequence[str], physics: ScenePhysics) -> Callable[[], tuple[float, ...]]:
        """Returns a function that reads the present numbers of some of the robot's MuJoCo sensors."""
        found = [physics.model.ptr.sensor(f"{self._robot.prefix}{name}") for name in names]
        places = [int(each.adr[0]) + axis for each in found for axis in range(int(each.dim[0]))]
        return _picked(physics.data.ptr.sensordata, places)

    def _start_sensing(self, physics: ScenePhysics) -> None:
        model, data, robot = physics.model.ptr, physics.data.ptr, self._robot
        body = robot.footprint_id(model)
        furniture = [item.id for item in self._world.furniture]
        show = ContactMarkers(self._recorder, model, data, body, furniture).publish if self._recorder.enabled else None
        self._monitor = CollisionMonitor(model, data, body, furniture, show)
        self._ranging = None
        self._late: LateItems[Ranges] = LateItems()
        # A generator of its own, which leaves the run's as it is.
        self._chance = self._rng.spawn(1)[0]
        self._scan_every_steps = robot.lidar.every_steps if robot.lidar else 0
        if robot.lidar is not None:
            unseen = physics.unseen_group
            far = (robot.lidar.height_m, robot.lidar.angles_rad, robot.lidar.range_max_m)
            near = (robot.proximity_height_m, lidar.PROXIMITY_ANGLES_RAD, lidar.PROXIMITY_RANGE_MAX_M)
            self._ranging = (
                lidar.RangeFinder(model, data, body, *far, unseen),
                lidar.RangeFinder(model, data, body, *near, unseen),
                robot.lidar,
            )

    def _between_substeps(self) -> Callable[[], None]:
        """Returns a function to call every 10 ms: it samples contacts, and if needed records states and moves legs."""
        sample, move, record = self._monitor.sample, self._controller.substep, self._telemetry.sample

        def sample_and_record() -> None:
            sample()
            record()

        look = sample_and_record if self._recorder.enabled else sample
        if move is None:
            return look

        def look_and_move() -> None:
            look()
            move()

        return look_and_move

    def _sense(self) -> None:
        self._state, tilt_rad = self._read_state()
        self._pose = self._drift.told(self._state.x, self._state.y, self._state.yaw)
        self._newly_visited = self.mission.update(self._state, tilt_rad)
        self._standstill.look(self._state)
        if self._newly_visited:
            self._visited = np.array([time_s is not None for time_s in self.mission.first_visit_s])
            self._visited.setflags(write=False)
            if self._recorder.enabled:
                self._telemetry.publish_goals(self._world.floorplan.rooms, self._visited.tolist())
        if self._recorder.enabled:
            for sensor in self._robot.sensors:
                self._telemetry.publish_reading(sensor.kind, self._state.time_s, self._sensors[sensor.kind]())
        if self._ranging is not None:
            if self._steps % self._scan_every_steps == 0:
                self._measure_ranges(*self._ranging)
            if (ranges := self._late.take(self._state.time_s)) is not None:
                self._scan, self._proximity, self._scan_time = ranges

    def _measure_ranges(self, scanner: lidar.RangeFinder, bumper: lidar.RangeFinder, model: Lidar) -> None:
        """Measures ranges with lidar and bumper once, and queues them for the observation after the latency.

        The lidar's errors are added, and the scan is also recorded.
        """
        assert self.lidar_errors is not None
        time_s, latency_s = self._state.time_s, self.lidar_errors.latency_s if self._steps else 0.0
        measured = self.lidar_errors.disturb(scanner.measure(), self._rng, self._chance)
        scan = np.maximum(measured, model.range_min_m).astype(np.float32)
        self._late.add(time_s + latency_s, (scan, bumper.measure().astype(np.float32), np.array(time_s)))
        if self._recorder.enabled:
            self._telemetry.publish_scan(time_s, scan)

    def _read_state(self) -> tuple[RobotState, float]:
        base = self._base.read()
        state = RobotState(
            time_s=float(self._data.time),
            x=base.x,
            y=base.y,
            yaw=base.yaw,
            linear=base.linear,
            angular=base.angular,
            joint_positions=self._joint_positions(),
            joint_velocities=self._joint_velocities(),
        )
        return state, base.tilt


def _picked(values: NDArray[np.float64], places: list[int]) -> Callable[[], tuple[float, ...]]:
    """Returns a function that reads the values at some indices; consecutive indices use a view, which is faster."""
    if places and places == list(range(places[0], places[0] + len(places))):
        view = values[places[0] : places[0] + len(places)]
        return lambda: tuple(view.tolist())
    indices = np.array(places, np.intp)
    return lambda: tuple(values[indices].tolist())


def _range_specs(model: Lidar) -> dict[str, specs.Array]:
    """Returns the dm_env array specs of the range sensors' observations, by name.

    These are the lidar scan and the proximity ranges in metres, and the time of both in seconds.
    """
    near = specs.BoundedArray(
        lidar.PROXIMITY_ANGLES_RAD.shape, np.float32, 0.0, np.inf, name="proximity: m, in the bumper, right to left"
    )
    first, last = model.angles_rad[0], model.angles_rad[-1]
    around = f"from {first:.4g} to {last:.4g} rad"
    return {
        "scan": specs.BoundedArray(
            (model.rays,), np.float32, 0.0, np.inf, name=f"scan: m, {around}, {model.rate_hz:g} Hz"
        ),
        "proximity": near,
        "scan_time": specs.Array((), np.float64, name="scan_time: s, of scan and proximity"),
    }
