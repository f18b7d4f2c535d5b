"""Drives of robots that have a `robot.yaml`."""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Callable

import mujoco
import numpy as np

from ..drives import DifferentialDrive, PlanarDrive, RawDrive
from ..robot import Drive, Limits
from .mapping import alternatives, invalid
from .shape import DifferentialDriveModel, RobotModel, VelocityDriveModel

_ACROSS = 0.95
"""Minimum cosine of the angle between a wheel's axis and the robot's y axis."""

_DEVIATION = 0.15
"""Relative deviation between `robot.yaml` and model from which there is a warning."""

_JOINT = mujoco.mjtTrn.mjTRN_JOINT


def make_drive(
    mapping: RobotModel,
    limits: Limits,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    where: str,
    warn: Callable[[str], None],
) -> Drive:
    """Makes the drive that a `robot.yaml` describes.

    Args:
        mapping: Content of `robot.yaml`.
        limits: Velocity and acceleration limits of the robot.
        model: Compiled robot without a world.
        data: State in which the robot stands at the origin and faces along the x axis.
        where: Name of the `robot.yaml` file, for messages.
        warn: Called with each sentence about measures that the model contradicts.

    Raises:
        LaunchError: A name is not in the model, or is no velocity actuator, or a wheel is no wheel.
    """
    drive = mapping.drive
    if drive.kind == "differential":
        return _differential(drive, limits, _Actuators(model, where), data, warn)
    if drive.kind == "velocity":
        return _planar(drive, limits, _Actuators(model, where))
    names = tuple(model.actuator(index).name for index in range(model.nu))
    if not names or not all(names):
        said = "there are no actuators" if not names else "an actuator has no name"
        raise invalid(where, f"drive: {said}; add them under actuators, or name them in the model")
    return RawDrive(names)


def planar_joints(mapping: RobotModel, model: mujoco.MjModel, where: str) -> tuple[str, str, str] | None:
    """Returns the slide and hinge joints that move a robot's base over the floor along the world's axes.

    Returns `None` if the drive moves it otherwise.

    Raises:
        LaunchError: The joints are not two slides and a hinge along the axes.
    """
    drive = mapping.drive
    if drive.kind != "velocity" or drive.frame != "world":
        return None
    if drive.y is None:
        raise invalid(where, "drive.y: is missing; in the world's frame x and y are two slides, each with an actuator")
    actuators, names = _Actuators(model, where), []
    wanted = (("x", drive.x, 0, "slide"), ("y", drive.y, 1, "slide"), ("yaw", drive.yaw, 2, "hinge"))
    for field, name, axis, kind in wanted:
        joint = actuators.joint(actuators.find(name, f"drive.{field}"))
        is_kind = joint is not None and model.jnt_type[joint] == getattr(mujoco.mjtJoint, f"mjJNT_{kind.upper()}")
        if joint is None or not is_kind or abs(model.jnt_axis[joint, axis]) < _ACROSS:
            raise invalid(where, f"drive.{field}: {name!r} has to move a {kind} along the {'xyz'[axis]} axis")
        names.append(model.joint(joint).name)
    return names[0], names[1], names[2]


def _differential(
    drive: DifferentialDriveModel,
    limits: Limits,
    actuators: "_Actuators",
    data: mujoco.MjData,
    warn: Callable[[str], None],
) -> DifferentialDrive:
    model, sides, factors, places = actuators.model, [], [], []
    for field, names, side in (("left", drive.left, 1), ("right", drive.right, -1)):
        found = [actuators.find(name, f"drive.{field}[{index}]") for index, name in enumerate(names)]
        wheels = []
        for index, actuator in enumerate(found):
            actuators.check_velocity(actuator, f"drive.{field}[{index}]")
            joint = actuators.joint(actuator)
            axis = 0.0 if joint is None else float(data.xaxis[joint, 1])
            if joint is None or abs(axis) < _ACROSS:
                raise invalid(
                    actuators.where, f"drive.{field}[{index}]: {names[index]!r} does not turn about the y axis"
                )
            if side * data.xanchor[joint, 1] <= 0:
                raise invalid(
                    actuators.where,
                    f"drive.{field}[{index}]: {names[index]!r} is on the other side, at y = "
                    f"{data.xanchor[joint, 1]:.3f} m; left is where y is positive",
                )
            wheels.append(float(np.sign(axis)) * float(model.actuator_gear[actuator, 0]))
            places.append(data.xanchor[joint])
        sides.append(tuple(model.actuator(actuator).name for actuator in found))
        factors.append(tuple(wheels))
    track_m = 2 * float(np.mean(np.abs([place[1] for place in places])))
    if _is_off(drive.track_width_m, track_m):
        found = f"in the model the wheels are {track_m:.3f} m apart"
        warn(f"{actuators.where}: drive.track_width_m is {drive.track_width_m:g} m; {found}")
    height_m = float(np.mean([place[2] for place in places]))
    if _is_off(drive.wheel_radius_m, height_m):
        found = f"in the model the wheels' axes are {height_m:.3f} m above the floor"
        warn(f"{actuators.where}: drive.wheel_radius_m is {drive.wheel_radius_m:g} m; {found}")
    return DifferentialDrive(
        limits, sides[0], sides[1], drive.wheel_radius_m, drive.track_width_m, (factors[0], factors[1])
    )


def _planar(drive: VelocityDriveModel, limits: Limits, actuators: "_Actuators") -> PlanarDrive:
    names, joint = [], None
    for field, name in (("x", drive.x), ("y", drive.y), ("yaw", drive.yaw)):
        if name is None:
            names.append(None)
            continue
        actuator = actuators.find(name, f"drive.{field}")
        actuators.check_velocity(actuator, f"drive.{field}")
        names.append(actuators.model.actuator(actuator).name)
        joint = actuators.joint(actuator)
    yaw_joint = None if drive.frame == "base" or joint is None else actuators.model.joint(joint).name
    return PlanarDrive(limits, names[0], names[1], names[2], yaw_joint)


def _is_off(said_m: float, found_m: float) -> bool:
    return abs(said_m - found_m) > _DEVIATION * said_m


class _Actuators:
    """Actuators of a robot's model, found by their own names or their joints' names; else `LaunchError` is raised."""

    def __init__(self, model: mujoco.MjModel, where: str) -> None:
        self.model, self.where = model, where
        self._names = [model.actuator(index).name for index in range(model.nu)]

    def find(self, name: str, field: str) -> int:
        """Returns the id of the actuator that has a name, or else of the first that drives the joint of this name.

        Raises:
            LaunchError: The model has no actuator of this name.
        """
        if name in self._names:
            return self._names.index(name)
        joints = [self.model.joint(index).name for index in range(self.model.njnt)]
        if name in joints:
            for actuator in range(self.model.nu):
                if self.joint(actuator) == joints.index(name):
                    return actuator
            added = f"add it: actuators: [{{joint: {name}, kind: velocity, gain: 1}}]"
            raise invalid(self.where, f"{field}: the joint {name!r} has no actuator; {added}")
        hint = alternatives(name, [*self._names, *joints], "joints and actuators")
        raise invalid(self.where, f"{field}: there is no joint or actuator {name!r}; {hint}")

    def joint(self, actuator: int) -> int | None:
        """Returns the number of the joint that an actuator moves; `None` if it moves no joint."""
        is_joint = self.model.actuator_trntype[actuator] == _JOINT
        return int(self.model.actuator_trnid[actuator, 0]) if is_joint else None

    def check_velocity(self, actuator: int, field: str) -> None:
        """Raises an error for an actuator that is not velocity-controlled.

        Raises:
            LaunchError: The actuator is not a velocity actuator.
        """
        gain, bias = self.model.actuator_gainprm[actuator], self.model.actuator_biasprm[actuator]
        if bias[1] != 0 or bias[2] >= 0 or not np.isclose(gain[0], -bias[2]):
            name = self._names[actuator]
            raise invalid(
                self.where,
                f"{field}: {name!r} is no velocity actuator (<velocity kv=…/>); this drive tells its actuators rad/s "
                "and m/s; change the model, or use drive: {kind: actuators}",
            )
