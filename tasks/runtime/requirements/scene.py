"""Scene in which requirements are measured: MuJoCo's state, the world, functions of applications."""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.requirement_kinds.kind import (
    NOT_READ,
    NotMeasuredError,
    PosePair,
    RequirementError,
    Rule,
    is_meant,
)
from ....schemas.wire.request_problems import nearest
from ....schemas.worlds.world import World, contains
from ..episode.floor import MapFloor, floor_of
from ..episode.loading import load_judging_function
from ..episode.physics import (
    ClearanceMeter,
    ContactForces,
    acting_body,
    bodies_below,
    can_touch,
    floor_geoms,
    geom_names,
    robot_geoms,
)

_MAX_SHOWN = 12
_UPRIGHT_AXIS = 0.99999
"""Cosine above which an axis counts as vertical."""
_LEVEL_AXIS = 1e-5
"""Cosine below which an axis counts as level."""


@dataclass(frozen=True)
class Scene:
    """MuJoCo simulation in which requirements are measured: positions, contacts, distances, the world.

    Measurements that the environment does not allow raise `NotMeasuredError`.
    """

    environment: Any
    model: mujoco.MjModel
    data: mujoco.MjData
    plan: RunPlan
    read_world: Callable[[], World | None]

    @property
    def world(self) -> World | None:
        """Description of the run's world, read when first needed; `None` if the run has no world."""
        return self.read_world()

    @cached_property
    def names(self) -> list[str]:
        """Names of the model's geoms, for messages about contacts."""
        return geom_names(self.model, [piece.id for piece in self.world.furniture] if self.world else [])

    @cached_property
    def is_stale(self) -> bool:
        """Whether contacts have no forces yet, as between `mj_step1` and `mj_step2`; see `ContactForces`."""
        return bool(getattr(self.environment.physics, "legacy_step", False))

    def refresh(self) -> None:
        """Takes the present state over into the arrays that `position` and `orientation` have returned."""
        if "_now" in self.__dict__:  # else no rule has asked for a pose
            self._update(self._now)

    def position(self, rule: Rule[Any]) -> Sequence[float]:
        """Returns the robot's present position x, y, z in metres, as an array that follows at each `refresh`."""
        self.refresh()
        return self._now.xpos[self._robot(rule)]

    def room_of(self, rule: Rule[Any]) -> str | None:
        """Returns the name of the room that the robot is in; `None`: in none, there is no world, or no robot."""
        if self.plan.world_dir is None or self.world is None:
            return None
        try:
            x, y = (float(each) for each in self.position(rule)[:2])
        except RequirementError:
            return None
        return next((room.name for room in self.world.floorplan.rooms if contains(room.polygon, x, y)), None)

    def orientation(self, rule: Rule[Any]) -> Sequence[float]:
        """Returns the robot's present orientation (quaternion, w first), as an array that follows at each `refresh`."""
        self.refresh()
        return self._now.xquat[self._robot(rule)]

    def can_tilt(self, rule: Rule[Any]) -> bool:
        """Whether a joint lets the body of the rule's robot tilt; hinges around the vertical do not."""
        body = self._robot(rule)
        while body:
            first = self.model.body_jntadr[body]
            for joint in range(first, first + self.model.body_jntnum[body]):
                kind = int(self.model.jnt_type[joint])
                if kind in (int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)):
                    return True
                if kind == int(mujoco.mjtJoint.mjJNT_HINGE) and abs(self.data.xaxis[joint][2]) < _UPRIGHT_AXIS:
                    return True
            body = int(self.model.body_parentid[body])
        return False

    def floor(self, rule: Rule[Any]) -> MapFloor | None:
        """Returns the free floor of the world, from its map; `None`: there is no world."""
        return floor_of(self.plan, rule)

    def can_rise(self, rule: Rule[Any]) -> bool:
        """Whether a joint lets the body of a rule's robot change its height; upright hinges and level slides do not."""
        body = self._robot(rule)
        while body:
            first = self.model.body_jntadr[body]
            for joint in range(first, first + self.model.body_jntnum[body]):
                up = abs(self.data.xaxis[joint][2])
                is_slide = int(self.model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_SLIDE)
                if _is_free(self.model, joint) or (up > _LEVEL_AXIS if is_slide else up < _UPRIGHT_AXIS):
                    return True
            body = int(self.model.body_parentid[body])
        return False

    def expect_end(self, rule: Rule[Any]) -> None:
        """Does nothing: a simulation always contains the end of the run."""

    def messages(self, rule: Rule[Any], topic: str) -> Iterator[tuple[float, Any]]:  # noqa: ARG002 - see `Scene`
        """Raises `NotMeasuredError`: messages on topics are read after the run, and rules on them judged then."""
        raise NotMeasuredError(NOT_READ)

    def pose_pairs(self, rule: Rule[Any], estimate: str, truth: str) -> Iterator[PosePair]:  # noqa: ARG002 - as above
        """Raises `NotMeasuredError`: poses on topics are read after the run, so a rule on them cannot be judged yet."""
        raise NotMeasuredError(NOT_READ)

    def contacts(self, rule: Rule[Any]) -> Callable[[], Mapping[str, float]]:
        """Returns a function that reads the contact force (N) of each object that touches the rule's robot, by name."""
        body = self._robot(rule)
        if body not in self._contacts:
            robot = robot_geoms(self.model, body)
            self._contacts[body] = ContactForces(self.model, self.data, robot, self.names, is_stale=self.is_stale)
        self._obstacles(rule, robot_geoms(self.model, body))
        return self._contacts[body].read

    def clearance(self, rule: Rule[Any]) -> Callable[[float], tuple[float, str] | None]:
        """Returns a function that measures the smallest distance in metres from the rule's robot to other objects.

        The function gets a distance, and returns the distance and the object's name; `None` if nothing is nearer than
        that.
        """
        model, body = self.model, self._robot(rule)
        own = robot_geoms(model, body)
        part = own if getattr(rule.asked, "body", None) is None else bodies_below(model, body)[model.geom_bodyid]
        return ClearanceMeter(model, self.data, part, self._obstacles(rule, own), self.names).measure

    def function(self, rule: Rule[Any], attribute: str) -> Callable[..., Any]:
        """Imports and returns a predicate function from the application's bundle or an installed package.

        Raises:
            RequirementError: The function does not exist.
        """
        return load_judging_function(self.plan, rule, attribute)

    def _obstacles(self, rule: Rule[Any], robot: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Returns a mask of the geoms that count as obstacles, shape `(ngeom,)`: not of the robot, floor, or ignored.

        A requirement that could never be violated (no collision shapes, no such object) becomes an error.

        Args:
            rule: The rule.
            robot: Mask of the robot's geoms.
        """
        others, ignore = getattr(rule.asked, "others", None), getattr(rule.asked, "ignore", None)
        if not can_touch(self.model, robot):
            rule.fail("the robot has no shape that collides with anything else, so it goes through everything")
        elif others is not None:
            there = sorted({name for name, own in zip(self.names, robot.tolist(), strict=True) if not own})
            if unknown := [other for other in others if not any(is_meant(name, [other], None) for name in there)]:
                rule.fail(f"nothing is named like {unknown[0]!r}{_near(unknown[0], there)}")
        meant = np.array([is_meant(name, others, ignore) for name in self.names], dtype=np.bool_)
        obstacles = meant & ~robot & ~floor_geoms(self.model, self.data)
        if rule.error is None and not obstacles.any():
            ignored = "" if ignore is None else " that is not ignored"
            rule.fail(f"beside the robot and the floor there is nothing{ignored}, so it could not be missed")
        return obstacles

    def _robot(self, rule: Rule[Any]) -> int:
        """Returns the robot's body: the one the rule names, else the environment's `robot_body`, else the actuated one.

        Raises:
            RequirementError: The model has no such body, or none that can be taken for a robot.
        """
        named = getattr(rule.asked, "body", None)
        if named is None and (named := getattr(self.environment, "robot_body", None)) is None:
            return self._acting_body(rule)
        number = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, named)
        if number < 0:
            there = [name for name in map(self._body_name, range(1, self.model.nbody)) if name]
            raise rule.cannot(f"the model has no body {named!r}{_near(named, there)}")
        return number

    @cached_property
    def _now(self) -> mujoco.MjData:
        """Copy of the positions, with the poses of all bodies.

        `mj_step` leaves poses in `data` that are a physics step older than its positions, from which environments read
        where the robot is: at a door, requirements and environment would see it in two rooms. The run's own `data`
        stays as it is.
        """
        copy = mujoco.MjData(self.model)
        self._update(copy)
        return copy

    def _update(self, copy: mujoco.MjData) -> None:
        copy.qpos[:] = self.data.qpos
        if self.model.nmocap:
            copy.mocap_pos[:], copy.mocap_quat[:] = self.data.mocap_pos, self.data.mocap_quat
        mujoco.mj_kinematics(self.model, copy)

    @cached_property
    def _contacts(self) -> dict[int, ContactForces]:
        return {}

    def _acting_body(self, rule: Rule[Any]) -> int:
        if (body := acting_body(self.model)) is not None:
            return body
        raise rule.cannot("no body has actuators; name the robot's with `body`, or as the environment's `robot_body`")

    def _body_name(self, body: int) -> str:
        return self.model.body(body).name


def _is_free(model: mujoco.MjModel, joint: int) -> bool:
    return model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE


def _near(name: str, there: list[str]) -> str:
    shown = ", ".join(there[:_MAX_SHOWN]) + (f" and {len(there) - _MAX_SHOWN} more" if len(there) > _MAX_SHOWN else "")
    return nearest(name, there) or f"; there are {shown or 'none'}"
