"""Environment of the simulation application `indoor-navigation`: a robot has to visit all rooms of a world."""

import logging
import math
import os
import sys
from functools import cached_property
from pathlib import Path

from .....schemas.runs.plan import why_a_world
from .....schemas.runs.variables import TIME_LIMIT_VARIABLE, number_in
from .....schemas.wire.errors import LaunchError
from .....schemas.worlds.world import World
from ...axes.imperfections import CommandDelay, CommandGains, LidarErrors, OdometryErrors, WheelSlip
from ...episode.context import ResumableEnvironment, SimulationContext
from ...episode.occupancy_map import OccupancyMap, read_world_map
from ...episode.run_results import EnvironmentReport
from ...rendering.views import FOLLOW
from ...robots.robot import CONTROL_TIMESTEP_S, Robot
from ...robots.robot_lookup import find_robot
from ...robots.scout import SCOUT
from .navigation_task import NavigationTask
from .telemetry import frames_of_bodies
from .world_with_robot import ScenePhysics, assemble

_logger = logging.getLogger(__name__)


class IndoorNavigation(ResumableEnvironment):
    """dm_control environment in which a robot has to visit every room; has its own verdict and checkpoints."""

    records_itself = True
    """True: the environment publishes the robot's clock and joint states itself, so the runtime does not."""

    def __init__(self, physics: ScenePhysics, task: NavigationTask, robot: Robot) -> None:
        super().__init__(physics, task, control_timestep=CONTROL_TIMESTEP_S, legacy_step=False)
        self._navigation = task
        self.robot = robot
        """Robot in the world; agents that plan paths read its limits."""
        if robot.video_camera is not None:
            # The robot's own `follow` by its full name is a camera that tips over with it.
            self.video_camera = FOLLOW if robot.video_camera == FOLLOW else f"{robot.prefix}{robot.video_camera}"

    @property
    def time_limit_s(self) -> float:
        """Limit of simulated time in seconds, at which a run ends."""
        return self._navigation.time_limit_s

    @property
    def lidar_errors(self) -> LidarErrors | None:
        """Errors of the robot's lidar, which axes of trials can change; None: the robot has no lidar."""
        return self._navigation.lidar_errors

    @property
    def command_delay(self) -> CommandDelay:
        """Delay of the agent's commands, which axes of trials can change."""
        return self._navigation.command_delay

    @property
    def wheel_slip(self) -> WheelSlip | None:
        """Slip of the robot's wheels, which axes change; `None`: it has none on two sides."""
        return self._navigation.wheel_slip

    @property
    def odometry_errors(self) -> OdometryErrors:
        """Errors of the pose that the robot is told, which axes change."""
        return self._navigation.odometry_errors

    @property
    def command_gains(self) -> CommandGains:
        """Factors on the agent's commands, which axes of trials can change."""
        return self._navigation.command_gains

    @cached_property
    def tf_frames(self) -> dict[int, str]:
        """ROS frame name of each moving body, by body number; these are the frames in a recording's `/tf`."""
        return frames_of_bodies(self.robot, self.physics.model.ptr, self._navigation.frames)

    def renew(self, context: SimulationContext) -> None:
        """Gives the environment the random generator of the next trial, which begins with `reset`."""
        self._navigation.renew(context.rng)

    def run_result(self) -> EnvironmentReport:
        """Returns verdict, requirements, metrics, rooms, collisions and path of the run.

        Raises:
            RuntimeError: No run has begun.
        """
        if self._reset_next_step and self._step_count == 0:
            raise RuntimeError("there is no run to report on; call reset first")
        return self._navigation.report()


def make_environment(context: SimulationContext) -> IndoorNavigation:
    """Makes the indoor navigation environment of one run.

    The robot is the one that the robot application names (`robots/robot_lookup.py`). Actions and observations are
    described by the environment's specs. A run ends when the robot has been in every room and is commanded to stand
    still, when it is commanded to stand still for 10 s, when it tips over, or at the limit of simulated time: the
    environment variable `ROBOMAKER_SIM_TIME_LIMIT_S` in seconds, else a limit that fits the size of the world.

    Args:
        context: Context of the run, which has to have a world.

    Raises:
        LaunchError: The world is missing or cannot be used, the time limit is not a number of seconds, or there is
            no such robot.
    """
    if context.world is None or context.world_dir is None:
        raise LaunchError(why_a_world("indoor-navigation") or "")
    plan = context.plan
    is_container = any(program.role == "robot" and program.image_id is not None for program in plan.programs)
    found = find_robot(plan.robot_application, {**os.environ, **context.environment}, is_container=is_container)
    sys.stdout.write(f"{found}\n")
    robot = found.robot
    limit_s = _time_limit_s(context.environment.get(TIME_LIMIT_VARIABLE), context.world, robot)
    try:
        physics = assemble(context.world_dir / "world.xml", robot)
    except ValueError as cause:
        raise LaunchError(str(cause)) from cause
    known = _known_map(context.world_dir) if context.recorder.enabled else None
    task = NavigationTask(context.world, robot, context.rng, context.recorder, limit_s, known)
    return IndoorNavigation(physics, task, robot)


def _known_map(world_dir: Path) -> OccupancyMap | None:
    """Reads the world's occupancy map; `None` if there is none, or it cannot be read, which is logged."""
    try:
        return read_world_map(world_dir) if (world_dir / "map.yaml").is_file() else None
    except (OSError, ValueError) as cause:
        _logger.warning("there is no map in the recording: %s", cause)
        return None


def _time_limit_s(text: str | None, world: World, robot: Robot) -> float:
    """Returns the requested time limit in simulated seconds, or a default that grows with the world's rooms.

    The default is about three times what the robot Scout needs, more for slower robots. Raises `LaunchError` if the
    text is no number above 0.
    """
    if text is None:
        rooms = world.floorplan.rooms
        slowness = max(1.0, SCOUT.limits.linear_mps / robot.limits.linear_mps)
        return math.ceil(slowness * (60 + 20 * len(rooms) + 2 * sum(room.area_m2 for room in rooms)))
    limit_s = number_in(text)
    if not (math.isfinite(limit_s) and limit_s > 0):
        raise LaunchError(
            f"{TIME_LIMIT_VARIABLE}: {text!r} is not a limit; it has to be simulated seconds above 0, such as 300"
        )
    return limit_s
