"""Pose of a robot's base, read from the joints that move it through the world."""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false

import math
from typing import NamedTuple, Protocol

import mujoco

from .robot import Robot


class BaseState(NamedTuple):
    """Place and motion of a robot's base; metres, radians and seconds."""

    x: float
    y: float
    yaw: float
    linear: float
    """Along the robot's own x axis."""

    angular: float
    tilt: float
    """Angle between the base's axis and the vertical."""


class Base(Protocol):
    """The base of one robot in one physics."""

    def place(self, heading: float) -> None:
        """Stands the robot on the origin; without `mj_forward`."""
        ...

    def read(self) -> BaseState:
        """Returns its pose and motion now."""
        ...


def bind_base(robot: Robot, model: mujoco.MjModel, data: mujoco.MjData) -> Base:
    """The base of a robot in a compiled world."""
    return PlanarBase(robot, model, data) if robot.planar_joints else FreeBase(robot, model, data)


def take_home_pose(robot: Robot, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Sets the joints' initial positions, and has position servos hold them."""
    for name, value in robot.home.items():
        data.qpos[int(model.joint(f"{robot.prefix}{name}").qposadr[0])] = value
    for actuator in range(model.nu):
        moves_joint = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
        if moves_joint and model.actuator_biasprm[actuator, 1] != 0:
            joint = int(model.actuator_trnid[actuator, 0])
            place = data.qpos[int(model.jnt_qposadr[joint])]
            data.ctrl[actuator] = model.actuator_gear[actuator, 0] * place


class FreeBase:
    """A base with a free joint."""

    def __init__(self, robot: Robot, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        root = model.joint(f"{robot.prefix}{robot.free_joint}")
        position, velocity = int(root.qposadr[0]), int(root.dofadr[0])
        # Views, so that a step need not look anything up.
        self._pose = data.qpos[position : position + 7]
        self._velocity = data.qvel[velocity : velocity + 6]
        self._height_m = robot.spawn_height_m

    def place(self, heading: float) -> None:
        """See `Base`."""
        self._pose[:] = (0.0, 0.0, self._height_m, math.cos(heading / 2), 0.0, 0.0, math.sin(heading / 2))

    def read(self) -> BaseState:
        """See `Base`."""
        x, y, _, qw, qx, qy, qz = self._pose.tolist()
        yaw = math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))
        vx, vy, _, _, _, turning = self._velocity.tolist()
        tilt = 2 * math.asin(min(1.0, math.hypot(qx, qy)))
        return BaseState(x, y, yaw, vx * math.cos(yaw) + vy * math.sin(yaw), turning, tilt)


class PlanarBase:
    """A base on two slides along the world's axes and a hinge; it cannot tip over."""

    def __init__(self, robot: Robot, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        assert robot.planar_joints is not None
        joints = [model.joint(f"{robot.prefix}{name}") for name in robot.planar_joints]
        self._positions = [data.qpos[int(joint.qposadr[0]) :] for joint in joints]
        self._velocities = [data.qvel[int(joint.dofadr[0]) :] for joint in joints]

    def place(self, heading: float) -> None:
        """See `Base`."""
        for view, value in zip(self._positions, (0.0, 0.0, heading), strict=True):
            view[0] = value

    def read(self) -> BaseState:
        """See `Base`."""
        x, y, yaw = (float(view[0]) for view in self._positions)
        vx, vy, turning = (float(view[0]) for view in self._velocities)
        yaw = math.remainder(yaw, math.tau)
        return BaseState(x, y, yaw, vx * math.cos(yaw) + vy * math.sin(yaw), turning, 0.0)
