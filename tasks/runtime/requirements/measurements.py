"""Connects requirements to a simulation: what each of them measures, and how."""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.requirements import BodyName, JobRequirement, PredicateRequirement
from ....schemas.wire.errors import LaunchError
from ....schemas.wire.request_problems import nearest
from ....schemas.worlds.world import Point, World, contains
from ..episode.loading import LoadError, load_factory
from ..episode.physics import (
    ClearanceMeter,
    ContactForces,
    acting_roots,
    bodies_below,
    can_touch,
    floor_geoms,
    geom_names,
    raw_physics,
    robot_geoms,
)
from .rules import ClearanceRule, CollisionRule, GoalRule, PredicateRule, Rule, TimeLimitRule, is_meant

Look = Callable[[float], None]
"""Measures at a simulated time and tells the rule."""

_MAX_SHOWN = 12


class RequirementError(LaunchError):
    """A requirement cannot be checked; the fault is the request's, not an application's."""


@dataclass(frozen=True)
class Scene:
    """The scene that requirements are measured in: one model and its data."""

    environment: Any
    model: mujoco.MjModel
    data: mujoco.MjData
    world: World | None
    plan: RunPlan

    @classmethod
    def of(cls, environment: Any, world: World | None, plan: RunPlan) -> "Scene":
        """The scene that an environment's physics shows."""
        return cls(environment, *raw_physics(environment.physics), world, plan)

    @cached_property
    def names(self) -> list[str]:
        """Names of the geoms."""
        return geom_names(self.model, [piece.id for piece in self.world.furniture] if self.world else [])

    @cached_property
    def is_stale(self) -> bool:
        """Whether contacts have no forces between two steps; see `ContactForces`."""
        return bool(getattr(self.environment.physics, "legacy_step", False))

    def robot(self, requirement: JobRequirement, body: BodyName | None) -> int:
        """The robot's body: the one that is named, else the environment's `robot_body`, else the one that acts.

        Raises:
            RequirementError: The model has no such body, or none that can be taken for a robot.
        """
        named = body if body is not None else getattr(self.environment, "robot_body", None)
        if named is None:
            return self._acting_body(requirement)
        number = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, named)
        if number < 0:
            there = [name for name in map(self._body_name, range(1, self.model.nbody)) if name]
            raise cannot(requirement, f"the model has no body {named!r}{_near(named, there)}")
        return number

    def contacts(self, body: int) -> ContactForces:
        """Contact forces on the robot, shared by all requirements about it."""
        if body not in self._contacts:
            robot = robot_geoms(self.model, body)
            self._contacts[body] = ContactForces(self.model, self.data, robot, self.names, is_stale=self.is_stale)
        return self._contacts[body]

    @cached_property
    def _contacts(self) -> dict[int, ContactForces]:
        return {}

    def _acting_body(self, requirement: JobRequirement) -> int:
        """The first free body with actuators, else the first body with any, else the only free one."""
        roots = list(dict.fromkeys(acting_roots(self.model)))
        free = [int(self.model.jnt_bodyid[joint]) for joint in range(self.model.njnt) if _is_free(self.model, joint)]
        for choice in ([root for root in free if root in roots], roots, free if len(free) == 1 else []):
            if choice:
                return choice[0]
        raise cannot(
            requirement, "no body has actuators; name the robot's with `body`, or as the environment's `robot_body`"
        )

    def _body_name(self, body: int) -> str:
        return self.model.body(body).name


def make_rules(requirements: Sequence[JobRequirement]) -> list[Rule]:
    """Starts the score of each requirement."""
    rules: list[Rule] = []
    goals: dict[str, GoalRule] = {}
    for requirement in requirements:
        match requirement.kind:
            case "goal":
                before = goals.get(requirement.after) if requirement.after else None
                rules.append(goal := GoalRule(requirement, before))
                goals[requirement.name] = goal
            case "no_collision":
                rules.append(CollisionRule(requirement))
            case "time_limit":
                rules.append(TimeLimitRule(requirement))
            case "clearance":
                rules.append(ClearanceRule(requirement))
            case "predicate":
                rules.append(PredicateRule(requirement))
    return rules


def bind(rule: Rule, scene: Scene) -> Look:
    """Ties a rule to a scene.

    Raises:
        RequirementError: It cannot be judged there: no such body, room, function.
    """
    match rule:
        case GoalRule():
            return _goal(rule, scene)
        case CollisionRule():
            body = scene.robot(rule.requirement, rule.asked.body)
            contacts = scene.contacts(body)
            _check_touchable(rule, scene, robot_geoms(scene.model, body))
            return lambda time_s: rule.update(time_s, contacts.read())
        case ClearanceRule():
            return _clearance(rule, scene)
        case PredicateRule():
            return _predicate(rule, scene)
        case TimeLimitRule():
            _check_before_the_end(rule, scene.environment)
            return rule.update
    raise AssertionError(f"no way to measure {type(rule).__name__}")


def _goal(rule: GoalRule, scene: Scene) -> Look:
    goal = rule.goal
    body = scene.robot(goal, goal.body)
    position = scene.data.xpos[body]
    if goal.room is None:
        x, y = goal.x or 0.0, goal.y or 0.0
        return lambda time_s: rule.update(time_s, math.hypot(position[0] - x, position[1] - y))
    polygon = _polygon(rule, scene)

    def look(time_s: float) -> None:
        is_inside = contains(polygon, float(position[0]), float(position[1]))
        rule.update(time_s, 0.0 if is_inside else math.inf)

    return look


def _polygon(rule: GoalRule, scene: Scene) -> Sequence[Point]:
    if scene.world is None:
        raise cannot(rule.goal, f"it asks for the room {rule.goal.room!r}, but there is no world")
    rooms = {room.name: room.polygon for room in scene.world.floorplan.rooms}
    if rule.goal.room not in rooms:
        raise cannot(rule.goal, f"the world has no room {rule.goal.room!r}{_near(rule.goal.room or '', list(rooms))}")
    return rooms[rule.goal.room]


def _clearance(rule: ClearanceRule, scene: Scene) -> Look:
    asked, model = rule.asked, scene.model
    body = scene.robot(asked, asked.body)
    own = robot_geoms(model, body)
    part = own if asked.body is None else bodies_below(model, body)[model.geom_bodyid]
    _check_touchable(rule, scene, own)
    meter = ClearanceMeter(model, scene.data, part, _obstacles(rule, scene, own), scene.names)

    def look(time_s: float) -> None:
        # Only what is nearer than anything before changes the score, and asking for that alone is faster.
        if (found := meter.measure(rule.nearest_m)) is not None:
            rule.update(time_s, *found)

    return look


def _check_touchable(rule: CollisionRule | ClearanceRule, scene: Scene, robot: NDArray[np.bool_]) -> None:
    """Makes a requirement an error that nothing could miss: a robot without collision shapes, no such thing.

    Args:
        rule: The rule.
        scene: Where it is judged.
        robot: Which geoms are the robot's.
    """
    if not can_touch(scene.model, robot):
        rule.fail("the robot has no shape that collides with anything else, so it goes through everything")
    elif (others := rule.asked.others) is not None:
        there = sorted({name for name, own in zip(scene.names, robot.tolist(), strict=True) if not own})
        if unknown := [other for other in others if not any(is_meant(name, [other], None) for name in there)]:
            rule.fail(f"nothing is named like {unknown[0]!r}{_near(unknown[0], there)}")
    if rule.error is None and not _obstacles(rule, scene, robot).any():
        ignored = "" if rule.asked.ignore is None else " that is not ignored"
        rule.fail(f"beside the robot and the floor there is nothing{ignored}, so it could not be missed")


def _check_before_the_end(rule: TimeLimitRule, environment: Any) -> None:
    """Makes a limit an error that an environment never comes to, since it ends its runs before."""
    own_s = getattr(environment, "time_limit_s", None)
    if own_s is None and not hasattr(environment, "run_result"):
        own_s = getattr(environment, "_time_limit", None)  # dm_control's environments keep theirs there
    if isinstance(own_s, int | float) and own_s <= rule.asked.limit_s:
        rule.fail(f"the environment ends its runs at {own_s:g} s, so a limit of {rule.asked.limit_s:g} s is never over")


def _obstacles(rule: CollisionRule | ClearanceRule, scene: Scene, robot: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Returns which geoms count as obstacles, shape `(ngeom,)`: neither the robot's, nor floor, nor ignored."""
    asked = rule.asked
    meant = np.array([is_meant(name, asked.others, asked.ignore) for name in scene.names], dtype=np.bool_)
    return meant & ~robot & ~floor_geoms(scene.model, scene.data)


def _predicate(rule: PredicateRule, scene: Scene) -> Look:
    asked = rule.asked
    function = _load(asked, scene.plan)

    def look(time_s: float) -> None:
        try:
            answer = function(scene.environment, time_s)
        except (Exception, SystemExit) as error:
            rule.fail(f"{asked.attribute} raised {type(error).__name__}: {error}")
            return
        holds, reason = answer if isinstance(answer, tuple) and len(answer) == 2 else (answer, "")
        if isinstance(holds, bool | np.bool_) and isinstance(reason, str):
            rule.update(time_s, bool(holds), reason)
        else:
            rule.fail(f"{asked.attribute} returned {str(answer)[:80]}; a bool, or a bool and a text, would be right")

    return look


def _load(asked: PredicateRequirement, plan: RunPlan) -> Callable[..., Any]:
    """Imports the function from the bundle that has its package, else from what is installed."""
    package = asked.attribute.partition(".")[0]
    applications = (plan.simulation_application, plan.robot_application)
    paths = [each.path for each in applications if each is not None and each.path is not None]
    path = next((path for path in paths if _has(path, package)), None)
    try:
        return load_factory(asked.attribute, path)
    except LoadError as error:
        raise cannot(asked, str(error)) from error


def _has(path: Path, package: str) -> bool:
    return (path / package).is_dir() or (path / f"{package}.py").is_file()


def cannot(requirement: JobRequirement, why: str) -> RequirementError:
    """The error for a requirement that cannot be judged here."""
    return RequirementError(f"requirement {requirement.name} ({requirement.kind}): {why}")


def _is_free(model: mujoco.MjModel, joint: int) -> bool:
    return model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE


def _near(name: str, there: list[str]) -> str:
    shown = ", ".join(there[:_MAX_SHOWN]) + (f" and {len(there) - _MAX_SHOWN} more" if len(there) > _MAX_SHOWN else "")
    return nearest(name, there) or f"; there are {shown or 'none'}"
