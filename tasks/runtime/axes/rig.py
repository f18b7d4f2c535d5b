"""Access to a MuJoCo environment for axes of trials: finds the robot in the compiled model, changes and restores it."""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from copy import copy
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....schemas.runs.axis_kinds.kind import (
    AxisError,
    CommandDelay,
    CommandGains,
    LidarErrors,
    OdometryErrors,
    WheelSlip,
)
from ..episode.physics import acting_body, actuators_of, floor_geoms, raw_physics, robot_bodies

_DERIVED = (
    *("body_subtreemass", "body_invweight0", "dof_invweight0", "dof_M0", "tendon_invweight0", "flexedge_invweight0"),
    *("actuator_acc0", "cam_poscom0", "light_poscom0"),
)
"""Fields of a MuJoCo model that `mj_setConst` computes from masses."""
_OF_BODIES = ("body_mass", "body_inertia")
_GAINS = (int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtGain.mjGAIN_AFFINE))
_BIASES = (int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE))


class ModelRig:
    """Access of axes to an environment: the robot in its compiled model, and the robot's imperfections.

    Args:
        environment: The environment, before its `reset`.

    Raises:
        AxisError: The environment has no MuJoCo model.
    """

    def __init__(self, environment: Any) -> None:
        physics = getattr(environment, "physics", None)
        if not hasattr(physics, "model"):
            raise AxisError(f"the environment ({type(environment).__name__}) has no MuJoCo physics")
        self._environment = environment
        self._model: mujoco.MjModel = raw_physics(physics)[0]
        self._built = copy(self._model)
        self._owners: dict[str, str] = {}
        self.axis = ""
        """Name of the axis whose value is being applied."""
        self._scaled: set[str] = set()
        self._parts: dict[str, Any] = {}

    @cached_property
    def robot_bodies(self) -> NDArray[np.bool_]:
        """Mask of the robot's bodies, shape (nbody,).

        Raises:
            AxisError: No body of the model can be taken for a robot.
        """
        named = getattr(self._environment, "robot_body", None)
        if named is not None:
            body = mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_BODY, named)
            if body < 0:
                raise AxisError(f"the model has no body {named!r}, as the environment's robot_body says")
        elif (body := acting_body(self._model)) is None:
            raise AxisError("no body of its model has actuators; name the robot's as the environment's robot_body")
        return robot_bodies(self._model, body)

    @cached_property
    def touching_geoms(self) -> NDArray[np.bool_]:
        """Mask of the geoms of robot and floor whose contacts have friction, shape (ngeom,).

        Raises:
            AxisError: None of them can touch and rub.
        """
        model = self._model
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        robot, floor = self.robot_bodies[model.geom_bodyid], floor_geoms(model, data)
        if not self.touching_pairs.any() and not _rub(model, robot, floor):
            raise AxisError("no part of the robot can touch a floor and rub on it")
        is_free = model.jnt_type[self.robot_bodies[model.jnt_bodyid]] == int(mujoco.mjtJoint.mjJNT_FREE)
        pairs = data.contact.geom
        touches = (robot[pairs[:, 0]] & floor[pairs[:, 1]]) | (robot[pairs[:, 1]] & floor[pairs[:, 0]])
        if not is_free.any() and not touches.any():
            raise AxisError("the robot cannot fall, and is held where it touches no floor")
        return robot | floor

    @cached_property
    def touching_pairs(self) -> NDArray[np.bool_]:
        """Mask of the model's explicit contact pairs that have a geom of the robot, shape (npair,)."""
        robot = self.robot_bodies[self._model.geom_bodyid]
        return robot[self._model.pair_geom1] | robot[self._model.pair_geom2]

    @cached_property
    def motors(self) -> NDArray[np.intp]:
        """Numbers of the actuators that move the robot.

        Raises:
            AxisError: There are no such actuators, or the force of one cannot be scaled.
        """
        model = self._model
        found = actuators_of(model, self.robot_bodies)
        if not found:
            raise AxisError("no actuator moves the robot")
        for actuator in found:
            gain, bias = int(model.actuator_gaintype[actuator]), int(model.actuator_biastype[actuator])
            if gain not in _GAINS or bias not in _BIASES:
                name = model.actuator(actuator).name or f"actuator {actuator}"
                raise AxisError(f"{name} is neither a motor nor a servo, so that its force cannot be scaled")
        return np.array(found, np.intp)

    @cached_property
    def motor_joints(self) -> NDArray[np.intp]:
        """Numbers of the robot's joints whose actuator forces are limited."""
        model = self._model
        limited = model.jnt_actfrclimited.astype(np.bool_) & self.robot_bodies[model.jnt_bodyid]
        return np.flatnonzero(limited)

    @property
    def first_motor(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Number of the first motor, and of the joint that it moves if the joint limits the force.

        Raises:
            AxisError: No motor moves the robot, or the force of one cannot be scaled.
        """
        first = self.motors[:1]
        moves_joint = self._model.actuator_trntype[first[0]] == int(mujoco.mjtTrn.mjTRN_JOINT)
        joint = self._model.actuator_trnid[first[0], 0] if moves_joint else -1
        return first, self.motor_joints[self.motor_joints == joint]

    @property
    def lidar(self) -> LidarErrors:
        """Changeable noise, bias, dropout and latency of the robot's lidar.

        Raises:
            AxisError: The environment has no lidar whose readings axes could change.
        """
        return self._part("lidar_errors", "lidar")

    @property
    def commands(self) -> CommandDelay:
        """Changeable delay between the agent's commands and the robot's motors.

        Raises:
            AxisError: The environment cannot delay commands.
        """
        return self._part("command_delay", "commands of a robot")

    @property
    def command_gains(self) -> CommandGains:
        """Changeable factors by which the agent's commands to the robot are multiplied.

        Raises:
            AxisError: The environment cannot scale commands.
        """
        return self._part("command_gains", "commands of a robot")

    @property
    def wheels(self) -> WheelSlip:
        """Changeable slip of the robot's wheels.

        Raises:
            AxisError: The robot has no wheels on two sides, or the environment cannot let them slip.
        """
        return self._part("wheel_slip", "wheels on two sides")

    @property
    def odometry(self) -> OdometryErrors:
        """Changeable errors of the pose that the robot is told.

        Raises:
            AxisError: The environment tells no pose that could drift.
        """
        return self._part("odometry_errors", "odometry")

    def scale(self, field: str, where: Any, factor: float | None) -> None:
        """Sets numbers of a model field to a factor times the values that the model was built with; see `Rig`.

        `None` as the factor sets the values that the model was built with.

        Raises:
            AxisError: Another axis has changed the same numbers.
        """
        if (other := self._owners.setdefault(field, self.axis)) != self.axis:
            raise AxisError(
                f"trials.axes: {self.axis} and {other} both change {field} of the model, of which one would be lost"
            )
        self._scaled.add(field)
        built = getattr(self._built, field)[where]
        getattr(self._model, field)[where] = built if factor is None else built * factor

    def derive_constants(self) -> None:
        """Sets the model's constants that depend on masses, computed on a copy, so that nothing else changes."""
        source = self._built
        if any(not np.array_equal(getattr(self._model, name), getattr(source, name)) for name in _OF_BODIES):
            source, data = self._scratch
            for name in _OF_BODIES:
                getattr(source, name)[:] = getattr(self._model, name)
            mujoco.mj_setConst(source, data)
        for field in _DERIVED:
            getattr(self._model, field)[:] = getattr(source, field)
        self._scaled.update(_DERIVED)

    def changes(self) -> dict[str, Any]:
        """Returns a copy of all values that axes have set, to check later that they are still in effect."""
        fields = {field: getattr(self._model, field).copy() for field in self._scaled}
        return fields | {name: copy(vars(part)) for name, part in self._parts.items()}

    def lost(self, changes: dict[str, Any]) -> str:
        """Returns the reason why a value set by an axis is no longer in effect, as text; empty if all are in effect.

        Args:
            changes: Values to compare with, from `changes`.
        """
        model = raw_physics(self._environment.physics)[0]
        if self._scaled and model is not self._model:
            return "the environment has made a new model since"
        for name, value in changes.items():
            if name in self._parts:
                part = getattr(self._environment, name, None)
                if part is not self._parts[name] or vars(part) != value:
                    return f"the environment has changed {name} since"
            elif not np.array_equal(getattr(model, name), value):
                return f"the environment has changed {name} of its model since"
        return ""

    @cached_property
    def _scratch(self) -> tuple[mujoco.MjModel, mujoco.MjData]:
        return copy(self._built), mujoco.MjData(self._built)

    def _part(self, name: str, words: str) -> Any:
        part = getattr(self._environment, name, None)
        if part is None and hasattr(self._environment, name):
            raise AxisError(f"the robot has no {words}")
        if part is None:
            raise AxisError(f"the environment ({type(self._environment).__name__}) has no {words} that axes can change")
        self._parts[name] = part
        return part


def _rub(model: mujoco.MjModel, robot: NDArray[np.bool_], floor: NDArray[np.bool_]) -> bool:
    """Whether some geom of the robot and some geom of the floor can collide with friction.

    Args:
        model: The model.
        robot: Geoms of the robot, shape (geoms,).
        floor: Geoms of the floor, shape (geoms,).
    """

    def kinds(geoms: NDArray[np.bool_]) -> set[tuple[int, int, int]]:
        columns = (model.geom_contype, model.geom_conaffinity, model.geom_condim)
        return {
            (int(kind), int(affinity), int(dim))
            for kind, affinity, dim in zip(*(c[geoms] for c in columns), strict=True)
        }

    return any(
        max(dim, other_dim) > 1 and (kind & other_affinity or other_kind & affinity)
        for kind, affinity, dim in kinds(robot)
        for other_kind, other_affinity, other_dim in kinds(floor)
    )
