"""Drives of robots, which convert commands to actuator controls; and pose and velocity of robots' bases."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import mujoco
import numpy as np
from dm_env import specs

from ..episode.context import ActionError, KeepsAttributes
from .robot import CONTROL_TIMESTEP_S, Action, Controller, Limits, Robot


class VelocityController(KeepsAttributes):
    """Controller that limits velocity commands (m/s, rad/s) and applies them with acceleration ramps."""

    KEPT = ("_linear", "_angular")

    substep: Callable[[], None] | None = None

    def __init__(self, limits: Limits, move: Callable[[float, float], None]) -> None:
        """Creates the controller of a robot that stands still.

        Args:
            limits: Velocity and acceleration limits of the robot.
            move: Called with forward velocity and turning rate at every control step.
        """
        self._move = move
        self.transmitted = 1.0
        """Share of the motion that reaches the floor: wheels may slip."""
        self._max_linear, self._max_angular = limits.linear_mps, limits.angular_radps
        self._linear_change = limits.linear_mps2 * CONTROL_TIMESTEP_S
        self._angular_change = limits.angular_radps2 * CONTROL_TIMESTEP_S
        self.reset()

    def reset(self) -> None:
        """Sets the commanded velocities to zero, as at the start of a run; see `Controller`."""
        self._linear = self._angular = 0.0

    def command(self, action: Action) -> bool:
        """Moves the robot's velocities towards a command, as far as its accelerations allow in a control step.

        Returns whether the command is to stand still; see `Controller`.
        """
        linear, angular = self._checked(action)
        self._linear += _clip(linear - self._linear, self._linear_change)
        self._angular += _clip(angular - self._angular, self._angular_change)
        self._move(self._linear * self.transmitted, self._angular * self.transmitted)
        return linear == 0.0 and angular == 0.0

    def _checked(self, action: Action) -> tuple[float, float]:
        try:
            linear, angular = (float(value) for value in action)
        except (TypeError, ValueError):
            shown = f"an array of shape {action.shape}" if isinstance(action, np.ndarray) else repr(action)[:80]
            raise ActionError(f"action: {shown} is not (forward velocity in m/s, turning rate in rad/s)") from None
        if not (math.isfinite(linear) and math.isfinite(angular)):
            raise ActionError(f"action: ({linear}, {angular}) has to be two finite numbers, m/s and rad/s")
        return _clip(linear, self._max_linear), _clip(angular, self._max_angular)


@dataclass(frozen=True)
class VelocityDrive:
    """Drive of a robot that is controlled by forward velocity and turning rate."""

    limits: Limits

    def action_spec(self, model: mujoco.MjModel, prefix: str) -> specs.BoundedArray:
        """Returns the spec of actions: forward velocity in m/s and turning rate in rad/s."""
        del model, prefix
        limit = np.array((self.limits.linear_mps, self.limits.angular_radps))
        return specs.BoundedArray((2,), np.float64, -limit, limit, name="velocity_command")


@dataclass(frozen=True)
class DifferentialDrive(VelocityDrive):
    """Drive with velocity-controlled wheels on the left and right."""

    left: tuple[str, ...]
    """Names of the actuators of the left wheels."""

    right: tuple[str, ...]
    wheel_radius_m: float
    track_width_m: float
    """Distance in metres between the contact points of left and right wheels."""

    directions: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    """Factors from a wheel's speed (rad/s, forward positive) to the command of each actuator; absent: 1."""

    def bind(self, model: mujoco.MjModel, data: mujoco.MjData, prefix: str) -> Controller:
        """Returns the controller that turns the wheels of a robot with this drive in a compiled world; see `Drive`.

        Args:
            model: The world with the robot.
            data: Its state, whose controls the controller sets.
            prefix: Prefix of the robot's names in the model.
        """
        control, radius_m, half_track_m = data.ctrl, self.wheel_radius_m, self.track_width_m / 2
        factors = self.directions or ((1.0,) * len(self.left), (1.0,) * len(self.right))
        left, right = (
            [(int(model.actuator(f"{prefix}{name}").id), factor) for name, factor in zip(names, side, strict=True)]
            for names, side in zip((self.left, self.right), factors, strict=True)
        )

        def move(linear: float, angular: float) -> None:
            turn = angular * half_track_m
            for actuator, factor in left:
                control[actuator] = (linear - turn) / radius_m * factor
            for actuator, factor in right:
                control[actuator] = (linear + turn) / radius_m * factor

        return VelocityController(self.limits, move)


@dataclass(frozen=True)
class PlanarDrive(VelocityDrive):
    """Drive with velocity actuators that move the base over the floor."""

    x: str
    """Name of the actuator along x, in m/s."""

    y: str | None
    """Name of the actuator along y, in m/s; required in the world's frame."""

    yaw: str
    """Name of the turning actuator, in rad/s."""

    yaw_joint: str | None = None
    """Name of the hinge that measures the heading; x and y are then along the world's axes, otherwise along the
    robot's.
    """

    def bind(self, model: mujoco.MjModel, data: mujoco.MjData, prefix: str) -> Controller:
        """Returns the controller that moves the base of a robot with this drive in a compiled world; see `Drive`.

        Args:
            model: The world with the robot.
            data: Its state, whose controls the controller sets.
            prefix: Prefix of the robot's names in the model.
        """
        control = data.ctrl
        x, yaw = (int(model.actuator(f"{prefix}{name}").id) for name in (self.x, self.yaw))
        y = None if self.y is None else int(model.actuator(f"{prefix}{self.y}").id)
        joint = None if self.yaw_joint is None else model.joint(f"{prefix}{self.yaw_joint}")
        heading = data.qpos[0:0] if joint is None else data.qpos[int(joint.qposadr[0]) :]

        def move(linear: float, angular: float) -> None:
            # Halfway through the step the robot has turned that far.
            angle = float(heading[0]) + angular * CONTROL_TIMESTEP_S / 2 if joint is not None else 0.0
            control[x] = linear * math.cos(angle)
            if y is not None:
                control[y] = linear * math.sin(angle)
            control[yaw] = angular

        return VelocityController(self.limits, move)


class RawController(KeepsAttributes):
    """Controller that passes actions directly to the actuators, clipped to their ranges."""

    KEPT = ("_last",)

    substep: Callable[[], None] | None = None

    def __init__(self, data: mujoco.MjData, actuators: list[int], spec: specs.BoundedArray) -> None:
        self._control, self._actuators, self._spec = data.ctrl, np.array(actuators, np.intp), spec
        self._last: bytes | None = None

    def reset(self) -> None:
        """Forgets the last actuator controls, as at the start of a run; see `Controller`."""
        self._last = None

    def command(self, action: Action) -> bool:
        """Sets the actuator controls, clipped to their ranges; see `Controller`.

        Returns whether they are the same as before, which tells the robot to stand still. Raises `ActionError` if the
        action is not an array of finite numbers of the right shape.
        """
        wanted = self._spec.name
        try:
            values = np.asarray(action, np.float64)
        except (TypeError, ValueError):
            raise ActionError(f"action: {repr(action)[:80]} is not an array of numbers, {wanted}") from None
        if values.shape != self._spec.shape or not np.isfinite(values).all():
            shown = f"an array of shape {values.shape}" if values.shape != self._spec.shape else repr(values)[:80]
            raise ActionError(f"action: {shown} has to be {self._spec.shape[0]} finite numbers: {wanted}")
        clipped = np.clip(values, self._spec.minimum, self._spec.maximum)
        self._control[self._actuators] = clipped
        before, self._last = self._last, clipped.tobytes()
        return before == self._last


@dataclass(frozen=True)
class RawDrive:
    """Drive without velocity commands: actions are the controls of the robot's actuators."""

    actuators: tuple[str, ...]

    def action_spec(self, model: mujoco.MjModel, prefix: str) -> specs.BoundedArray:
        """Returns the spec of actions: the controls of the robot's actuators, with their ranges."""
        ids = [int(model.actuator(f"{prefix}{name}").id) for name in self.actuators]
        limited = model.actuator_ctrllimited[ids].astype(np.bool_)
        low = np.where(limited, model.actuator_ctrlrange[ids, 0], -np.inf)
        high = np.where(limited, model.actuator_ctrlrange[ids, 1], np.inf)
        return specs.BoundedArray((len(ids),), np.float64, low, high, name=", ".join(self.actuators))

    def bind(self, model: mujoco.MjModel, data: mujoco.MjData, prefix: str) -> Controller:
        """Returns the controller that passes actions to a robot's actuators in a compiled world; see `Drive`."""
        ids = [int(model.actuator(f"{prefix}{name}").id) for name in self.actuators]
        return RawController(data, ids, self.action_spec(model, prefix))


def _clip(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))


class BaseState(NamedTuple):
    """Position and heading on the floor, forward speed, turning rate and tilt of a robot's base (m, rad, s)."""

    x: float
    y: float
    yaw: float
    linear: float
    """Velocity along the robot's x axis, in m/s."""

    angular: float
    tilt: float
    """Angle between the base's axis and the vertical, in radians."""


class Base(Protocol):
    """Interface to the base of a robot in a simulation, by which it is placed, and its pose and velocity are read."""

    def place(self, heading: float) -> None:
        """Places the robot at the origin with a heading in radians; the caller calls `mj_forward`."""
        ...

    def read(self) -> BaseState:
        """Returns the base's present pose (m, rad) and velocity (m/s, rad/s)."""
        ...


def bind_base(robot: Robot, model: mujoco.MjModel, data: mujoco.MjData) -> Base:
    """Returns the access to pose and velocity of a robot's base in a compiled world, planar or free."""
    return PlanarBase(robot, model, data) if robot.planar_joints else FreeBase(robot, model, data)


def take_home_pose(robot: Robot, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Sets the robot's joints to their home positions, and all position servos of the model to hold their joints."""
    for name, value in robot.home.items():
        data.qpos[int(model.joint(f"{robot.prefix}{name}").qposadr[0])] = value
    for actuator in range(model.nu):
        moves_joint = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
        if moves_joint and model.actuator_biasprm[actuator, 1] != 0:
            joint = int(model.actuator_trnid[actuator, 0])
            place = data.qpos[int(model.jnt_qposadr[joint])]
            data.ctrl[actuator] = model.actuator_gear[actuator, 0] * place


class FreeBase:
    """Base of a robot that moves freely, by a free joint, and so can tip over."""

    def __init__(self, robot: Robot, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        root = model.joint(f"{robot.prefix}{robot.free_joint}")
        position, velocity = int(root.qposadr[0]), int(root.dofadr[0])
        # Views, so that a step need not look anything up.
        self._pose = data.qpos[position : position + 7]
        self._velocity = data.qvel[velocity : velocity + 6]
        self._height_m = robot.spawn_height_m

    def place(self, heading: float) -> None:
        """Places the robot, which moves freely, at the origin at its height, with a heading in radians; see `Base`."""
        self._pose[:] = (0.0, 0.0, self._height_m, math.cos(heading / 2), 0.0, 0.0, math.sin(heading / 2))

    def read(self) -> BaseState:
        """Returns the freely moving base's pose and velocity in the plane, and its tilt in radians; see `Base`."""
        x, y, _, qw, qx, qy, qz = self._pose.tolist()
        yaw = math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))
        vx, vy, _, _, _, turning = self._velocity.tolist()
        tilt = 2 * math.asin(min(1.0, math.hypot(qx, qy)))
        return BaseState(x, y, yaw, vx * math.cos(yaw) + vy * math.sin(yaw), turning, tilt)


class PlanarBase:
    """Robot base on two slide joints and a hinge, which cannot tip over."""

    def __init__(self, robot: Robot, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        assert robot.planar_joints is not None
        joints = [model.joint(f"{robot.prefix}{name}") for name in robot.planar_joints]
        self._positions = [data.qpos[int(joint.qposadr[0]) :] for joint in joints]
        self._velocities = [data.qvel[int(joint.dofadr[0]) :] for joint in joints]

    def place(self, heading: float) -> None:
        """Places the robot, which moves on planar joints, at the origin with a heading in radians; see `Base`."""
        for view, value in zip(self._positions, (0.0, 0.0, heading), strict=True):
            view[0] = value

    def read(self) -> BaseState:
        """Returns the planar base's pose (m, rad) and velocity (m/s, rad/s); it never tilts; see `Base`."""
        x, y, yaw = (float(view[0]) for view in self._positions)
        vx, vy, turning = (float(view[0]) for view in self._velocities)
        yaw = math.remainder(yaw, math.tau)
        return BaseState(x, y, yaw, vx * math.cos(yaw) + vy * math.sin(yaw), turning, 0.0)
