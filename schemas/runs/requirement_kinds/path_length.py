"""Requirement that the robot reaches a goal without long detours."""

import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import Field

from ...wire.base import ShapeName
from ...worlds.world import Point
from .goal import GoalRule, check_goal, goal_named
from .kind import Look, Numbers, RequirementKind, RequirementName, RobotRequirement, Rule, Scene, Seconds, Share

Radius = Annotated[float, ShapeName("Radius"), Field(ge=0, le=10, allow_inf_nan=False)]


class PathLengthRequirement(RobotRequirement):
    """Pass criterion: the robot reaches a goal on a path that is not much longer than the shortest one."""

    violated_when = (
        "it does not reach `goal`, or the shortest way there is less than `min_ratio` of the way that it took"
    )
    more_members = "`radius_m` (0): radius of the robot for the shortest way"

    kind: Literal["path_length"] = Field(description="`path_length`.")
    goal: RequirementName = Field(description="Name of a goal further up; its `after` says where the way begins.")
    min_ratio: Share = Field(
        description="Least success weighted by path length: the length of the shortest way over that of the way "
        "taken, and 0 where the goal was not reached."
    )
    radius_m: Radius = Field(
        default=0.0,
        description="Radius of a disc in metres for which the shortest way is found; 0, the shortest of all.",
    )
    period_s: Seconds = Field(default=0.1, description="Simulated seconds from one check to the next.")

    def check_after(self, before: Sequence[RequirementKind]) -> None:
        """Checks that the goal is listed above this requirement.

        Raises ValueError if it is not.
        """
        check_goal(self, "goal", before)


class PathLengthRule(Rule[PathLengthRequirement]):
    """Measures the driven path to a goal and the shortest path, and judges the path length requirement."""

    driven_m = 0.0
    """Length in metres of the path driven since the goal became due."""
    shortest_m: float | None = None
    """Length in metres of the shortest path; None: the path has not begun, or no path exists."""
    _last: tuple[float, ...] | None = None
    _reached = False
    _goal: GoalRule | None = None

    def follow(self, before: Sequence[Rule[Any]]) -> None:
        """Finds the rule of the goal whose path is judged, among the rules before this one."""
        self._goal = goal_named(self.asked.goal, before)

    def bind(self, scene: Scene) -> Look:
        """Connects the rule to a simulation; returns the check that sums up the path.

        At the path's start it also measures the shortest path to the goal.
        """
        position, floor = scene.position(self), scene.floor(self)
        goal = self._goal.asked if self._goal is not None else None
        polygon = None if goal is None or goal.room is None else self.polygon(goal.room, scene)

        def shortest(start: Point) -> float | None:
            assert goal is not None  # checked with the request
            target = polygon or [(goal.x or 0.0, goal.y or 0.0)]
            within_m = 0.0 if polygon else goal.within_m
            if floor is not None:
                way_m = floor.shortest_m(start, target, self.asked.radius_m)
            else:
                way_m = math.dist(start, target[0])  # without a map a straight line; rooms need a world
            return None if way_m is None else max(0.0, way_m - within_m)

        def look(time_s: float) -> None:
            here = tuple(map(float, position))
            if math.isnan(here[0]) or self._goal is None or not self._goal.is_due:
                return
            if self._last is None:
                self.begin(shortest((here[0], here[1])))
            self.update(time_s, here)

        return look

    def begin(self, shortest_m: float | None) -> None:
        """Sets the length in metres of the shortest path from the robot's start to the goal; `None`: no path exists.

        Without a path, or with one of length 0, the requirement cannot be judged.
        """
        self.shortest_m = shortest_m
        if shortest_m is None:
            self.fail(f"the map has no way to {self.asked.goal} for a radius of {self.asked.radius_m:g} m")
        elif shortest_m == 0.0:
            self.fail(f"the way begins where {self.asked.goal} is reached already, so it could not be missed")

    def update(self, time_s: float, here: tuple[float, ...]) -> None:  # noqa: ARG002 - as of other rules
        """Adds the distance to a position (x, y, z in metres) to the driven length, until the goal is reached."""
        if self._last is not None and not self._reached:
            self.driven_m += math.dist(here[:2], self._last[:2])
        self._last = here
        self._reached = self._goal is not None and bool(self._goal.is_reached)

    @property
    def ratio(self) -> float:
        """Success weighted by path length, 0 to 1; 0 if the goal was not reached."""
        if self._goal is None or not self._goal.is_reached or not self.shortest_m:
            return 0.0
        return self.shortest_m / max(self.driven_m, self.shortest_m)

    def add_metrics(self, metrics: dict[str, float]) -> None:
        """Adds success weighted by path length; of several ways the worst, and the sum of their lengths."""
        if self.error is None:
            metrics["success_weighted_by_path_length"] = min(
                metrics.get("success_weighted_by_path_length", 1.0), round(self.ratio, 6)
            )
            metrics["way_to_goals_m"] = metrics.get("way_to_goals_m", 0.0) + round(self.driven_m, 6)

    def _unjudgeable(self) -> str | None:
        if self.ratio < self.asked.min_ratio:
            self.violate(self._end_s)
        return None

    def _numbers(self) -> Numbers:
        return Numbers(self.ratio, self.asked.min_ratio, None, at_least=True)

    def _detail(self) -> str:
        asked = f"{self.asked.min_ratio:g} asked for"
        if self._goal is None or not self._goal.is_reached:
            return f"0, since {self.asked.goal} was not reached; {asked}"
        ways = f"the shortest way is {self.shortest_m or 0:.2f} m, it took {self.driven_m:.2f} m"
        return f"{self.ratio:.3f} of success weighted by path length, {asked}: {ways}"
