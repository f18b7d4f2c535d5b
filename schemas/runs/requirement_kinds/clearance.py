"""Requirement that the robot keeps a distance from objects."""

import math
from typing import Literal

from pydantic import Field

from .kind import Look, Metres, Numbers, Rule, Scene, Seconds, ThingsRequirement


class ClearanceRequirement(ThingsRequirement):
    """Pass criterion: the robot keeps a minimum distance from everything but the floor."""

    violated_when = "its surface comes nearer than `min_m` to anything"
    more_members = "`others`, `ignore`: what counts, by name, `*` for any text"

    kind: Literal["clearance"] = Field(description="`clearance`.")
    min_m: Metres = Field(description="Smallest distance between the robot's surface and another, in metres.")
    period_s: Seconds = Field(default=0.1, description="Simulated seconds from one check to the next.")


class ClearanceRule(Rule[ClearanceRequirement]):
    """Measures the smallest clearance of the robot, and judges the clearance requirement."""

    nearest_m = math.inf
    """Smallest distance so far, in metres."""
    _other = ""

    def bind(self, scene: Scene) -> Look:
        """Connects the rule to a simulation's distance meter; returns the check that records nearer distances."""
        measure = scene.clearance(self)

        def look(time_s: float) -> None:
            # Only what is nearer than anything before changes the score, and asking for that alone is faster.
            if (found := measure(self.nearest_m)) is not None:
                self.update(time_s, *found)

        return look

    def update(self, time_s: float, distance_m: float, other: str) -> None:
        """Records the current smallest distance in metres and the nearest object; one below `min_m` is a violation."""
        if distance_m < self.nearest_m:
            self.nearest_m, self._other = distance_m, other
        if distance_m < self.asked.min_m:
            self.violate(time_s, other)

    def add_metrics(self, metrics: dict[str, float]) -> None:
        """Adds the smallest distance to the run's metrics, if there was anything near."""
        if self._other:
            nearest_m = metrics.get("min_clearance_m", math.inf)
            metrics["min_clearance_m"] = min(nearest_m, round(self.nearest_m, 6))

    def _unjudgeable(self) -> str | None:
        if self.violated_s is None and self.blind is not None and self.asked.min_m < self.blind.below_m:
            return f"{self.blind.why}, so a clearance of {self.asked.min_m:g} m could not be missed"
        return None

    def _numbers(self) -> Numbers:
        value = self.nearest_m if math.isfinite(self.nearest_m) else None
        return Numbers(value, self.asked.min_m, "m", at_least=True)

    def _detail(self) -> str:
        if not self._other:
            return "there was nothing to come near to"
        return f"{self.nearest_m:.3f} m from {self._other} at least, {self.asked.min_m:g} m asked for{self._until()}"
