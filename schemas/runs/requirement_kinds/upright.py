"""Requirement that the robot does not tilt or fall over."""

import math
from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field

from ...wire.base import ShapeName
from .kind import Look, Numbers, RobotRequirement, Rule, Scene, Seconds

Tilt = Annotated[float, ShapeName("Tilt"), Field(gt=0, le=179, allow_inf_nan=False)]


def tilt_deg(orientation: Sequence[float]) -> float:
    """Returns the angle in degrees between a body's z axis and the vertical.

    Args:
        orientation: Quaternion of the body, w first.
    """
    w, x, y, z = orientation
    return math.degrees(2 * math.atan2(math.hypot(x, y), math.hypot(w, z)))


class UprightRequirement(RobotRequirement):
    """Pass criterion: the robot's body does not tilt beyond an angle."""

    violated_when = "its body's z axis is more than `max_tilt_deg` off the vertical"

    kind: Literal["upright"] = Field(description="`upright`.")
    max_tilt_deg: Tilt = Field(
        description="Largest angle between the z axis of the robot's body and the vertical, in degrees."
    )
    period_s: Seconds = Field(default=0.1, description="Simulated seconds from one check to the next.")


class UprightRule(Rule[UprightRequirement]):
    """Records the largest tilt of the robot's body, and judges the requirement to stay upright."""

    largest_deg: float | None = None
    """Largest tilt so far, in degrees; None: it was not measured."""

    def bind(self, scene: Scene) -> Look:
        """Connects the rule to a simulation; returns the check that measures the body's tilt.

        If no joint lets the body tilt, the requirement cannot be judged.
        """
        orientation = scene.orientation(self)
        if not scene.can_tilt(self):
            self.fail("no joint lets the robot's body tilt, so it could not be missed")
        return lambda time_s: self.update(time_s, tilt_deg(orientation))

    def update(self, time_s: float, tilt: float) -> None:
        """Records the largest tilt so far, in degrees; one above `max_tilt_deg` is a violation, NaN is ignored."""
        if math.isnan(tilt):
            return
        self.largest_deg = tilt if self.largest_deg is None else max(self.largest_deg, tilt)
        if tilt > self.asked.max_tilt_deg:
            self.violate(time_s)

    def add_metrics(self, metrics: dict[str, float]) -> None:
        """Adds the largest tilt to the run's metrics."""
        if self.largest_deg is not None:
            metrics["max_tilt_deg"] = max(metrics.get("max_tilt_deg", 0.0), round(self.largest_deg, 6))

    def _unjudgeable(self) -> str | None:
        return "the robot's tilt was never measured" if self.largest_deg is None else None

    def _numbers(self) -> Numbers:
        return Numbers(self.largest_deg, self.asked.max_tilt_deg, "deg")

    def _detail(self) -> str:
        allowed = f"at most {self.asked.max_tilt_deg:g} deg is allowed"
        return f"tilted by {self.largest_deg or 0:.1f} deg; {allowed}{self._until()}"
