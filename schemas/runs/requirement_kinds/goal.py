"""Requirement that the robot reaches a room or a point."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal, Self

from pydantic import Field, model_validator

from ...wire.base import optional
from ...wire.json_values import is_mapping
from ...worlds.world import contains
from .kind import (
    ROUNDING_S,
    STOP_OR_REACHED,
    Coordinate,
    Look,
    Metres,
    Numbers,
    RequirementKind,
    RequirementName,
    RobotRequirement,
    RoomName,
    Rule,
    Scene,
    Seconds,
)

_WITHIN_M = 0.5
_MAKES_SENSE = ("after", "by_s", "body")
"""Members with which a goal at the robot's start makes sense: it is a place to begin at, has a time limit, or is about
another body.
"""


class GoalRequirement(RobotRequirement):
    """Pass criterion: the robot reaches a room of the world, or a point."""

    violated_when = "the robot's body never was in `room`, or within `within_m` (0.5) of `x`, `y`; or not before `by_s`"
    more_members = "`after`: name of a goal above that has to be reached first"
    without_world = "give the goal as x and y"
    margins_compare = False  # seconds where it was reached, metres where it was not
    unit_if_met = "s"

    kind: Literal["goal"] = Field(description="`goal`.")
    room: RoomName | None = optional("Room of the world that the robot's body has to be in.")
    x: Coordinate | None = optional("Point to get to, in metres.")
    y: Coordinate | None = optional("Point to get to, in metres.")
    within_m: Metres = Field(default=_WITHIN_M, description="How near to the point is there, in metres.")
    by_s: Seconds | None = optional("Simulated time at which it has to be there at the latest.")
    after: RequirementName | None = optional(
        "Name of the goal that has to be reached before; only then this one counts."
    )
    period_s: Seconds = Field(default=0.1, description="Simulated seconds from one check to the next.")
    stop: bool = Field(default=False, description=STOP_OR_REACHED)

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        has_point = self.x is not None and self.y is not None
        if (self.x is None) != (self.y is None):
            raise ValueError("a point needs both x and y")
        if has_point == (self.room is not None):
            raise ValueError(f"{'both' if has_point else 'neither'} room and x, y; a goal is one of them")
        return self

    @property
    def asked_room(self) -> str | None:
        """Name of the room to reach; `None` for a point."""
        return self.room

    def check_after(self, before: Sequence[RequirementKind]) -> None:
        """Checks that the goal that has to be reached first is listed above this one.

        Raises ValueError if it is not.
        """
        check_goal(self, "after", before)


def check_goal(requirement: RequirementKind, member: str, before: Sequence[RequirementKind]) -> None:
    """Checks that a member of a requirement, if given, names one of the goals listed above it.

    Raises:
        ValueError: No goal of this name is listed above the requirement.
    """
    name = getattr(requirement, member)
    goals = [each.name for each in before if isinstance(each, GoalRequirement)]
    if name is not None and name not in goals:
        there = f"those before it are {', '.join(goals)}" if goals else "there is none before it"
        raise ValueError(f"{requirement.name}: {member} is {name!r}, no goal further up; {there}")


class GoalRule(Rule[GoalRequirement]):
    """Records whether and when the robot reaches a goal, and judges the goal requirement."""

    is_reached = False

    def __init__(self, asked: GoalRequirement) -> None:
        super().__init__(asked)
        self.reached_s: float | None = None
        """Simulated time at which the goal was reached, late or not; None: not yet."""
        self._began_s: float | None = None
        """Simulated time of the first check, in seconds: recordings may have no pose at 0."""
        self._before: GoalRule | None = None
        """Rule of the goal that has to be reached first."""
        self._nearest_m: float | None = None
        """Smallest distance since the goal counts, in metres; None: it never counted."""

    def follow(self, before: Sequence[Rule[Any]]) -> None:
        """Finds the rule of the goal that has to be reached first."""
        self._before = goal_named(self.asked.after, before)

    def bind(self, scene: Scene) -> Look:
        """Connects the goal's rule to a simulation; returns the check that measures the distance to the goal in metres.

        A goal that is a room of no world is an error.
        """
        goal, position = self.asked, scene.position(self)
        if goal.room is None:
            x, y = goal.x or 0.0, goal.y or 0.0
            return lambda time_s: self.update(time_s, math.hypot(position[0] - x, position[1] - y))
        polygon = self.polygon(goal.room, scene)

        def look(time_s: float) -> None:
            is_inside = contains(polygon, float(position[0]), float(position[1]))
            self.update(time_s, 0.0 if is_inside else math.inf)

        return look

    def update(self, time_s: float, distance_m: float) -> None:
        """Records the distance to the goal in metres; 0 inside a room, infinite outside.

        A goal that is not reached by `by_s` is violated.
        """
        goal = self.asked
        self._began_s = time_s if self._began_s is None else self._began_s
        is_its_turn = self.is_due
        if is_its_turn and math.isfinite(distance_m):
            self._nearest_m = distance_m if self._nearest_m is None else min(self._nearest_m, distance_m)
        if self.reached_s is None and is_its_turn and distance_m <= (goal.within_m if goal.room is None else 0.0):
            self.reached_s, self.is_reached = time_s, True
        latest_s = math.inf if goal.by_s is None else goal.by_s + ROUNDING_S
        if time_s > latest_s and (self.reached_s is None or self.reached_s > latest_s):
            self.violate(latest_s - ROUNDING_S)

    def add_metrics(self, metrics: dict[str, float]) -> None:
        """Adds the numbers of goals and of reached goals to the run's metrics."""
        for name, count in {"goals": 1.0, "goals_reached": float(self.reached_s is not None)}.items():
            metrics[name] = metrics.get(name, 0.0) + count

    @property
    def planned_s(self) -> float:
        """Simulated time in seconds at which the goal has to be reached."""
        return self.asked.by_s or 0.0

    def remark(self) -> str | None:
        """Returns a note about a goal that was reached before the robot moved; `None` for any other."""
        is_ordinary = self._before is None and self.asked.by_s is None
        is_at_start = self.reached_s is not None and self.reached_s == self._began_s
        if is_at_start and is_ordinary and self._end_s:
            return f"{self.asked.name}: reached where the robot starts, before it moved"
        return None

    @property
    def is_due(self) -> bool:
        """Whether the goal can be reached now: the goal that has to be reached before it, if any, is reached."""
        return self._before is None or bool(self._before.is_reached)

    def _numbers(self) -> Numbers:
        if self.reached_s is None and self.asked.room is None:
            return Numbers(self._nearest_m, self.asked.within_m, "m")
        return Numbers(self.reached_s, self.asked.by_s, "s")

    def _detail(self) -> str:
        goal = self.asked
        place = goal.room if goal.room is not None else f"({goal.x:g}, {goal.y:g})"
        asked = "" if goal.by_s is None else f", {goal.by_s:g} s asked for"
        if self.reached_s is not None:
            return f"{place} reached at {self.reached_s:.2f} s{asked}"
        first = self._before is not None and not self._before.is_reached and goal.after
        why = f", {goal.after} comes first and was not reached either" if first else ""
        near = ""
        if goal.room is None and self._nearest_m is not None:
            since = f" after {goal.after}" if goal.after else ""
            near = f", nearest{since} {self._nearest_m:.2f} m, {goal.within_m:g} m asked for"
        return f"{place} not reached in {self._end_s:.2f} s{asked}{near}{why}; ended by {self._ended_by}"


def goal_named(name: str | None, before: Sequence[Rule[Any]]) -> GoalRule | None:
    """Finds the rule of a goal by name among the rules of requirements; `None` if there is none."""
    return next((rule for rule in before if isinstance(rule, GoalRule) and rule.asked.name == name), None)


def goals_at_start(requirements: Sequence[Any], start_room: str | None = None) -> Iterator[tuple[int, str, str]]:
    """Finds goals that are reached before the robot moves.

    Goals that another goal follows are starting places, and goals with `by_s` are intended; both are left out.

    Args:
        requirements: Requirements of a request, as JSON; those that are no goals are ignored.
        start_room: Name of the room at the origin; None: unknown.
    """
    goals = [
        (index, each) for index, each in enumerate(requirements) if is_mapping(each) and each.get("kind") == "goal"
    ]
    begun = {each.get("after") for _, each in goals}
    for index, goal in goals:
        if goal.get("name") in begun or any(goal.get(key) is not None for key in _MAKES_SENSE):
            continue
        if start_room is not None and goal.get("room") == start_room:
            yield index, "room", _in_words(f"the robot starts in {start_room!r}")
        elif _is_near(goal):
            yield index, "x", _in_words("the robot starts at (0, 0)")


def _is_near(goal: Mapping[str, Any]) -> bool:
    place = [goal.get("x"), goal.get("y"), goal.get("within_m") or _WITHIN_M]
    numbers = [each for each in place if isinstance(each, int | float)]
    return len(numbers) == 3 and math.hypot(numbers[0], numbers[1]) <= numbers[2]


def _in_words(start: str) -> str:
    return f"{start}, so the goal cannot be missed; `after` makes it one to come back to, `by_s` one to begin at"
