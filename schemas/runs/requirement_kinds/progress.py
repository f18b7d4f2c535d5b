"""Requirement that the robot does not get stuck."""

import math
from collections.abc import Sequence
from typing import Any, Literal

from pydantic import Field

from ...wire.base import optional
from ...worlds.world import Point
from ..programs import RunStop
from .goal import GoalRule, check_goal, goal_named
from .kind import (
    ROUNDING_S,
    Look,
    Metres,
    Numbers,
    RequirementKind,
    RequirementName,
    RobotRequirement,
    Rule,
    Scene,
    Seconds,
)


class ProgressRequirement(RobotRequirement):
    """Pass criterion: the robot does not stay near one place for longer than a limit."""

    violated_when = "it gets no farther than `within_m` (0.1) from a place for longer than `max_stuck_s`"
    more_members = "`until`: name of a goal above; nothing is asked for once that is reached"

    kind: Literal["progress"] = Field(description="`progress`.")
    max_stuck_s: Seconds = Field(description="Longest simulated time for which it may stay near one place.")
    within_m: Metres = Field(default=0.1, description="How near to a place it is stuck there, in metres.")
    until: RequirementName | None = optional(
        "Name of the goal further up at which it may rest: once that is reached, nothing is asked for."
    )
    period_s: Seconds = Field(default=0.1, description="Simulated seconds from one check to the next.")

    def check_after(self, before: Sequence[RequirementKind]) -> None:
        """Checks that the goal until which it counts is listed above this requirement.

        Raises ValueError if it is not.
        """
        check_goal(self, "until", before)


class ProgressRule(Rule[ProgressRequirement]):
    """Records the longest time near one place, and judges the progress requirement."""

    longest_s: float | None = None
    """Longest time near one place so far, in seconds; None: it was not measured."""
    _place: Point = (math.inf, math.inf)
    _since_s = 0.0
    _longest_at: Point = (math.inf, math.inf)
    _goal: GoalRule | None = None

    def follow(self, before: Sequence[Rule[Any]]) -> None:
        """Finds the rule of the goal after which this progress requirement no longer applies."""
        self._goal = goal_named(self.asked.until, before)

    def bind(self, scene: Scene) -> Look:
        """Connects the rule to a simulation; returns the check that measures how long the body stays near one place."""
        position = scene.position(self)
        return lambda time_s: self.update(time_s, (float(position[0]), float(position[1])))

    def update(self, time_s: float, here: Point) -> None:
        """Updates the longest time without progress by a position, x and y in metres."""
        if math.isnan(here[0]) or (self._goal is not None and self._goal.is_reached):
            return
        if math.dist(here, self._place) > self.asked.within_m:
            self._place, self._since_s = here, time_s
        stuck_s = time_s - self._since_s
        if self.longest_s is None or stuck_s > self.longest_s:
            self.longest_s, self._longest_at = stuck_s, self._place
        if stuck_s > self.asked.max_stuck_s + ROUNDING_S:
            self.violate(time_s)

    def add_metrics(self, metrics: dict[str, float]) -> None:
        """Adds the longest time near one place to the run's metrics."""
        if self.longest_s is not None:
            metrics["longest_stuck_s"] = max(metrics.get("longest_stuck_s", 0.0), round(self.longest_s, 6))

    @property
    def _is_short(self) -> bool:
        return self.violated_s is None and self._end_s <= self.asked.max_stuck_s

    def _unjudgeable(self) -> str | None:
        if self.longest_s is None:
            return "the robot's position was never measured"
        # A run that its own end made short has met it; one that was cut might have been stuck for longer.
        if self._is_short and self._ended_by == RunStop.DURATION_LIMIT:
            cut = f"the job's duration limit ended it at {self._end_s:.2f} s"
            return f"{cut}, before it could be stuck for {self.asked.max_stuck_s:g} s"
        return None

    def remark(self) -> str | None:
        """Returns a note about a run that was too short to detect a stuck robot; `None` for any other."""
        if self.error is None and self._is_short:
            took = f"the run took {self._end_s:.2f} s"
            return f"{self.asked.name}: {took}, so the robot could not be stuck for {self.asked.max_stuck_s:g} s"
        return None

    def _numbers(self) -> Numbers:
        return Numbers(self.longest_s, self.asked.max_stuck_s, "s")

    def _detail(self) -> str:
        where = f"within {self.asked.within_m:g} m of ({self._longest_at[0]:.2f}, {self._longest_at[1]:.2f})"
        stayed = f"stayed for {self.longest_s or 0:.2f} s {where}"
        return f"{stayed}; at most {self.asked.max_stuck_s:g} s is allowed{self._until()}"
