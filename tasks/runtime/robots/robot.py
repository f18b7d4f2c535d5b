"""Interface of robots for the navigation task.

A robot is a MuJoCo model with names for its parts, and a drive. The task uses nothing else of a robot, so that Scout, a
walker and robots from bundles are interchangeable.
"""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import mujoco
import numpy as np
from dm_env import specs
from numpy.typing import NDArray

from .sensors.kind import Sensor

CONTROL_TIMESTEP_S = 0.05
"""Simulated seconds between two actions."""

Action = NDArray[np.float64] | Sequence[float]


@dataclass(frozen=True)
class Limits:
    """Size and velocity limits of a robot, for path planners."""

    radius_m: float
    """Radius in metres of the smallest disc that contains the robot, seen from above."""

    linear_mps: float
    angular_radps: float
    linear_mps2: float = 1.2
    """Acceleration limit of the motor controller, in m/s²."""

    angular_radps2: float = 8.0


@dataclass(frozen=True)
class Lidar:
    """Settings of a horizontal lidar on a robot: height, rays, rate, range in metres, and noise."""

    height_m: float
    """Height of the lidar over the floor, in metres."""

    rate_hz: float = 5.0
    """Scans per second; the time between scans is a whole number of control steps."""

    rays: int = 360
    field_of_view_rad: float = math.tau
    """Field of view in radians, over which rays are spread evenly, half on each side of the robot's x axis."""

    range_min_m: float = 0.06
    range_max_m: float = 3.5
    noise_std_m: float = 0.005

    @property
    def every_steps(self) -> int:
        """Number of control steps between two scans."""
        return round(1 / (self.rate_hz * CONTROL_TIMESTEP_S))

    @property
    def angle_increment_rad(self) -> float:
        """Angle between two rays in radians."""
        gaps = self.rays if math.isclose(self.field_of_view_rad, math.tau) else self.rays - 1
        return self.field_of_view_rad / gaps

    @property
    def angles_rad(self) -> NDArray[np.float64]:
        """Directions of the rays in radians, counter-clockwise from the robot's x axis."""
        return -self.field_of_view_rad / 2 + self.angle_increment_rad * np.arange(self.rays, dtype=np.float64)


class Controller(Protocol):
    """Interface of a controller that moves one robot in a simulation."""

    substep: Callable[[], None] | None
    """Function to call every 10 ms of simulated time, if there is one."""

    def reset(self) -> None:
        """Resets the controller at the start of a run: the robot stands still."""
        ...

    def state(self) -> Any:
        """Returns the controller's state for a checkpoint."""
        ...

    def restore(self, state: Any) -> None:
        """Restores the controller's state from a checkpoint."""
        ...

    def command(self, action: Action) -> bool:
        """Applies the agent's action for the next control step.

        Returns:
            Whether the robot is told to stand still.

        Raises:
            ActionError: The action does not fit this robot's action spec.
        """
        ...


class Drive(Protocol):
    """Interface of a robot's drive, which converts actions to actuator controls."""

    def action_spec(self, model: mujoco.MjModel, prefix: str) -> specs.BoundedArray:
        """Returns the spec of the actions that robots with this drive take, with limits and units."""
        ...

    def bind(self, model: mujoco.MjModel, data: mujoco.MjData, prefix: str) -> Controller:
        """Makes the controller of this drive in a compiled world.

        Args:
            model: The world with the robot.
            data: State of the model, after `mj_forward`.
            prefix: Prefix of all names of the robot.
        """
        ...


@dataclass(frozen=True)
class Robot:
    """A robot model that can be placed in a world: body, drive, sensors and limits."""

    name: str
    """Short name of the robot; `<name>/` is the prefix of the names of its parts in a compiled world."""

    build: Callable[[], mujoco.MjSpec]
    """Function that makes a new MjSpec of the robot at every call."""

    base: str
    """Name of the body that is attached to the world; x points forward, z up."""

    limits: Limits
    drive: Drive
    joints: tuple[str, ...]
    """Names of the hinges and slides whose positions are published; for a differential drive its wheels, left and
    right.
    """

    footprint: str | None = None
    """Name of the body that carries the range sensors on its z axis, and whose origin is on the floor; absent: the
    base.
    """

    free_joint: str | None = None
    """Name of the free joint that moves the robot through the world."""

    planar_joints: tuple[str, str, str] | None = None
    """Names of two slides along the world's axes and a hinge that move the robot instead of a free joint."""

    spawn_height_m: float = 0.0
    """Height of the base's origin over the floor at the start, in metres."""

    home: Mapping[str, float] = field(default_factory=dict)
    """Joint positions at the start, in radians or metres, by joint name."""

    lidar: Lidar | None = None
    """Lidar of the robot; absent: it has no range sensors."""

    proximity_height_m: float = 0.04
    sensors: Sequence[Sensor] = ()
    """Other sensors, which observations and recordings contain."""

    video_camera: str | None = None
    """Name of the camera for videos; absent: the model's first."""

    ros: Mapping[str, Any] = field(default_factory=dict)
    """Options of the ROS bridge from the robot's `robot.yaml`; see `RosOptions`."""

    warnings: Sequence[str] = ()
    """Sentences about the robot's `robot.yaml` that a person should know beside a verdict."""

    is_differential: bool = False
    """Whether `joints` are one wheel on the left and one on the right, which the observation `wheel_velocity` has."""

    @property
    def prefix(self) -> str:
        """Prefix of the robot's names in a compiled world."""
        return f"{self.name}/"

    def footprint_id(self, model: mujoco.MjModel) -> int:
        """Returns the id of the body that marks the robot's place on the floor."""
        return int(model.body(f"{self.prefix}{self.footprint or self.base}").id)


def add_look(
    body: mujoco.MjsBody, shape: mujoco.mjtGeom, pos: Sequence[float], size: Sequence[float], rgba: Sequence[float]
) -> None:
    """Adds to a body a visual geom without mass and collisions; lengths are in metres."""
    body.add_geom(type=shape, pos=pos, size=size, rgba=rgba, contype=0, conaffinity=0, mass=0)


def add_camera(
    body: mujoco.MjsBody, name: str, pos: Sequence[float], up: Sequence[float], fovy_deg: float = 62
) -> None:
    """Adds a camera to a robot's part.

    Args:
        body: Body that carries the camera.
        name: Name of the camera.
        pos: Position on the body, in metres.
        up: Direction on the body that points up in the image.
        fovy_deg: Vertical field of view.
    """
    camera = body.add_camera(name=name, pos=pos, fovy=fovy_deg)
    camera.alt.type = mujoco.mjtOrientation.mjORIENTATION_XYAXES
    camera.alt.xyaxes = [0, -1, 0, *up]


def add_sensors(spec: mujoco.MjSpec, site: str, kinds: Mapping[str, str]) -> None:
    """Adds MuJoCo sensors at a site of a robot.

    Args:
        spec: The robot's model.
        site: Name of the site.
        kinds: MuJoCo's sensor types by sensor name, `{"gyro": "GYRO"}`.
    """
    for name, kind in kinds.items():
        spec.add_sensor(name=name, type=sensor_type(kind), objtype=mujoco.mjtObj.mjOBJ_SITE, objname=site)


def sensor_type(kind: str) -> mujoco.mjtSensor:
    """Returns MuJoCo's sensor type of a name, such as `GYRO`; MuJoCo must have it."""
    return getattr(mujoco.mjtSensor, f"mjSENS_{kind}")


def robot_of(environment: Any) -> Robot | None:
    """Returns an environment's robot; `None` if it has none."""
    robot = getattr(environment, "robot", None)
    return robot if isinstance(robot, Robot) else None
