"""Localization: the robot has to know where it is."""

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

from ...wire.base import ShapeName, optional
from .kind import DottedName, Look, Metres, Numbers, RobotRequirement, Rule, Scene, Seconds, yaw_rad

Angle = Annotated[float, ShapeName("Angle"), Field(gt=0, le=180, allow_inf_nan=False)]
Delay = Annotated[float, ShapeName("Delay"), Field(ge=0, allow_inf_nan=False)]
Pose = tuple[float, float, float | None]
"""x and y in m, and yaw in rad where it is known."""

_RIGHT = "x and y in m, x, y and the yaw in rad, or None as long as it does not know would be right"


class LocalizationRequirement(RobotRequirement):
    """The robot has to know where it is."""

    violated_when = (
        "the estimate of a function of the application, `attribute`, is farther than `max_m` from the body's true "
        "place, or missing"
    )
    more_members = "`max_deg`: largest error of its yaw; `from_s` (0): when it has to know"

    kind: Literal["localization"] = Field(description="`localization`.")
    attribute: DottedName = Field(
        description="Dotted path of the function in the simulation or robot application, `my_nav.rules.estimate`: "
        "`(environment, time_s)` gives x and y in metres, or x, y and the yaw in radians, or `None`."
    )
    max_m: Metres = Field(description="Largest distance between the estimated and the true place, in metres.")
    max_deg: Angle | None = optional("Largest error of the estimated yaw, in degrees; absent: it is not judged.")
    from_s: Delay = Field(default=0.0, description="Simulated time from which on the robot has to know where it is.")
    period_s: Seconds = Field(default=0.1, description="Simulated seconds from one check to the next.")

    @classmethod
    def packages(cls, requirement: Mapping[str, Any]) -> Iterator[str]:
        """The function's package."""
        yield str(requirement.get("attribute", "")).partition(".")[0]


class LocalizationRule(Rule[LocalizationRequirement]):
    """Largest error of the estimated place and yaw."""

    def __init__(self, asked: LocalizationRequirement) -> None:
        super().__init__(asked)
        self.worst_m = self.worst_deg = 0.0
        self._checks = self._missing = 0

    def bind(self, scene: Scene) -> Look:
        """Asks the function, and measures where the body is."""
        asked, environment = self.asked, scene.environment
        function = scene.function(self, asked.attribute)
        position, orientation = scene.position(self), scene.orientation(self)

        def look(time_s: float) -> None:
            if time_s < asked.from_s or math.isnan(position[0]):
                return
            try:
                answer = function(environment, time_s)
                pose = pose_of(answer)
            except (Exception, SystemExit) as error:
                self.fail(f"{asked.attribute} raised {type(error).__name__}: {error}")
                return
            if isinstance(pose, str):
                self.fail(f"{asked.attribute} returned {pose}; {_RIGHT}")
            else:
                self.update(time_s, pose, (position[0], position[1], yaw_rad(orientation)))

        return look

    def update(self, time_s: float, estimate: Pose | None, truth: tuple[float, float, float]) -> None:
        """Takes note of an estimate and the true pose; `None`: the robot does not know."""
        self._checks += 1
        if estimate is None:
            self._missing += 1
            self.violate(time_s)
            return
        if estimate[2] is None and self.asked.max_deg is not None:
            self.fail(f"{self.asked.attribute} gives no yaw, so max_deg cannot be judged")
            return
        away_m = math.dist(estimate[:2], truth[:2])
        turned = 0.0 if estimate[2] is None else math.remainder(estimate[2] - truth[2], math.tau)
        self.worst_m, self.worst_deg = max(self.worst_m, away_m), max(self.worst_deg, abs(math.degrees(turned)))
        if away_m > self.asked.max_m or abs(math.degrees(turned)) > (self.asked.max_deg or math.inf):
            self.violate(time_s)

    def add_metrics(self, metrics: dict[str, float]) -> None:
        """Adds the largest error."""
        if self._checks > self._missing:
            metrics["max_localization_error_m"] = max(
                metrics.get("max_localization_error_m", 0.0), round(self.worst_m, 6)
            )

    def remark(self) -> str | None:
        """Returns a line about an estimate that is the truth itself, such as one that reads the simulation."""
        if self.error is None and self._checks > self._missing and self.worst_m == 0.0:
            return f"{self.asked.name}: the estimate is the true place to the last digit; it may read the simulation"
        return None

    def _unjudgeable(self) -> str | None:
        if not self._checks:
            return f"the run ended at {self._end_s:.2f} s, before from_s, {self.asked.from_s:g} s"
        return None

    def _numbers(self) -> Numbers:
        asked = self.asked
        if self._missing:
            return Numbers(float(self._missing), 0.0, "missing estimates")
        # The one of the two that is nearer to its limit, or farther beyond it.
        if asked.max_deg is not None and self.worst_deg / asked.max_deg > self.worst_m / asked.max_m:
            return Numbers(self.worst_deg, asked.max_deg, "deg")
        return Numbers(self.worst_m, asked.max_m, "m")

    def _detail(self) -> str:
        asked = self.asked
        missing = f"no estimate in {self._missing} of {self._checks} checks; " if self._missing else ""
        yaw = "" if asked.max_deg is None else f"; its yaw {self.worst_deg:.1f} deg, {asked.max_deg:g} deg allowed"
        away = f"{self.worst_m:.3f} m off at most, {asked.max_m:g} m allowed"
        return f"{missing}{away}{yaw}{self._until()}"


def pose_of(answer: Any) -> Pose | str | None:
    """Makes a pose of what a function returned; what is none is returned in words."""
    if answer is None:
        return None
    try:
        values = [float(each) for each in answer]
    except (TypeError, ValueError):
        values = []
    if len(values) in (2, 3) and all(map(math.isfinite, values)):
        return values[0], values[1], values[2] if len(values) == 3 else None
    return str(answer)[:80]
