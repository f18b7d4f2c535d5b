"""Requirement that the robot's pose estimate is correct."""

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from ...wire.base import ShapeName, optional
from .kind import DottedName, Look, Metres, Numbers, RobotRequirement, RosTopic, Rule, Scene, Seconds, yaw_rad

Angle = Annotated[float, ShapeName("Angle"), Field(gt=0, le=180, allow_inf_nan=False)]
Delay = Annotated[float, ShapeName("Delay"), Field(ge=0, allow_inf_nan=False)]
Pose = tuple[float, float, float | None]
"""Estimated pose: x and y in m, and yaw in rad if known."""

_RIGHT = "x and y in m, x, y and the yaw in rad, or None as long as it does not know would be right"


class LocalizationRequirement(RobotRequirement):
    """Pass criterion: the robot's estimated pose stays close to its true pose."""

    violated_when = (
        "the estimated pose is farther than `max_m` from the true one, or missing: that of a function of the "
        "application, `attribute`, from the body; or that on the topic `estimate` from that on the topic `truth`"
    )
    more_members = "`max_deg`: largest error of its yaw; `from_s` (0): when it has to know"

    kind: Literal["localization"] = Field(description="`localization`.")
    attribute: DottedName | None = optional(
        "Dotted path of the function in the simulation or robot application, `my_nav.rules.estimate`: "
        "`(environment, time_s)` gives x and y in metres, or x, y and the yaw in radians, or `None`."
    )
    estimate: RosTopic | None = optional(
        "Recorded topic with the estimated pose, in place of `attribute`: `/amcl_pose`, or `/tf`, from the map to the "
        "robot's base."
    )
    truth: RosTopic | None = optional("Recorded topic with the true pose, for `estimate`.")
    max_m: Metres = Field(description="Largest distance between the estimated and the true place, in metres.")
    max_deg: Angle | None = optional("Largest error of the estimated yaw, in degrees; absent: it is not judged.")
    from_s: Delay = Field(default=0.0, description="Simulated time from which on the robot has to know where it is.")
    period_s: Seconds = Field(default=0.1, description="Simulated seconds from one check to the next.")

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.attribute is None) == (self.estimate is None):
            there = "neither" if self.attribute is None else "both"
            raise ValueError(f"{there} attribute and estimate; the pose is estimated by one of them")
        if (self.estimate is None) != (self.truth is None):
            given, lacks = ("estimate", "truth") if self.truth is None else ("truth", "estimate")
            raise ValueError(
                f"{given} needs {lacks}, the topic with the {'true' if lacks == 'truth' else 'estimated'} pose"
            )
        if self.estimate is not None and self.estimate == self.truth:
            raise ValueError(f"estimate and truth are both {self.truth}, so the error is always 0; name two topics")
        if self.stop and self.by_topics:
            raise ValueError("stop: topics are judged when the run is over; leave out stop")
        if self.body is not None and self.by_topics:
            raise ValueError("body: topics have the pose of the robot; leave out body")
        return self

    @property
    def by_topics(self) -> bool:
        """Whether both the estimated and the true pose come from recorded topics."""
        return self.estimate is not None

    @classmethod
    def packages(cls, requirement: Mapping[str, Any]) -> Iterator[str]:
        """Returns the Python package of the function that returns the estimated pose."""
        if attribute := requirement.get("attribute"):
            yield str(attribute).partition(".")[0]


class LocalizationRule(Rule[LocalizationRequirement]):
    """Records the largest error of the estimated position and yaw, and judges the localization requirement."""

    def __init__(self, asked: LocalizationRequirement) -> None:
        super().__init__(asked)
        self.worst_m = self.worst_deg = 0.0
        self._checks = self._missing = 0

    def bind(self, scene: Scene) -> Look:
        """Connects the rule to a function and the body's pose, or to recorded topics with both poses.

        After an error of the function, or a result that is no pose, the requirement cannot be judged.
        """
        asked, environment = self.asked, scene.environment
        if asked.attribute is None:
            return self._bind_topics(scene)
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

    def _bind_topics(self, scene: Scene) -> Look:
        """Connects the rule to recorded topics; returns the check that compares estimates with true poses.

        Each estimate is compared with the true pose at its time.
        """
        asked = self.asked
        assert asked.estimate is not None
        assert asked.truth is not None
        errors = iter(scene.pose_pairs(self, asked.estimate, asked.truth))
        ahead = next(errors, None)

        def look(time_s: float) -> None:
            nonlocal ahead
            while ahead is not None and ahead.time_s <= time_s and self.error is None:
                if ahead.time_s >= asked.from_s:
                    self.update(ahead.time_s, ahead.estimate, ahead.truth)
                ahead = next(errors, None)

        return look

    def update(self, time_s: float, estimate: Pose | None, truth: tuple[float, float, float]) -> None:
        """Judges an estimated pose by the true pose; an error above the limits is a violation of the requirement.

        Args:
            time_s: Simulated time of both poses.
            estimate: The robot's estimate, in metres and radians; `None`: it has none, which is a violation.
            truth: True x and y in metres, and yaw in radians.
        """
        self._checks += 1
        if estimate is None:
            self._missing += 1
            self.violate(time_s)
            return
        if estimate[2] is None and self.asked.max_deg is not None:
            self.fail(f"{self.asked.attribute or self.asked.estimate} gives no yaw, so max_deg cannot be judged")
            return
        away_m = math.dist(estimate[:2], truth[:2])
        turned = 0.0 if estimate[2] is None else math.remainder(estimate[2] - truth[2], math.tau)
        self.worst_m, self.worst_deg = max(self.worst_m, away_m), max(self.worst_deg, abs(math.degrees(turned)))
        if away_m > self.asked.max_m or abs(math.degrees(turned)) > (self.asked.max_deg or math.inf):
            self.violate(time_s)

    def add_metrics(self, metrics: dict[str, float]) -> None:
        """Adds the largest localization error in metres to the run's metrics, if there was any estimate."""
        if self._checks > self._missing:
            metrics["max_localization_error_m"] = max(
                metrics.get("max_localization_error_m", 0.0), round(self.worst_m, 6)
            )

    def remark(self) -> str | None:
        """Returns a note about estimates that always equal the true pose, as if read from it; else `None`."""
        if self.error is None and self._checks > self._missing and self.worst_m == 0.0:
            return f"{self.asked.name}: the estimate is the true place to the last digit; it may read the simulation"
        return None

    def _unjudgeable(self) -> str | None:
        if self.error is None and self.asked.by_topics and self._checks == self._missing:
            return f"no pose on {self.asked.estimate} came from from_s, {self.asked.from_s:g} s, to the end of the run"
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
        yaw = f"; its yaw {self.worst_deg:.1f} deg; at most {asked.max_deg:g} deg is allowed" if asked.max_deg else ""
        away = f"{self.worst_m:.3f} m off; at most {asked.max_m:g} m is allowed"
        return f"{missing}{away}{yaw}{self._until()}"


def pose_of(answer: Any) -> Pose | str | None:
    """Converts the result of a robot's function to a pose (m, m, rad or `None`); `None` stays `None`.

    Returns a text that describes the result if it is no pose.
    """
    if answer is None:
        return None
    try:
        values = [float(each) for each in answer]
    except (TypeError, ValueError):
        values = []
    if len(values) in (2, 3) and all(map(math.isfinite, values)):
        return values[0], values[1], values[2] if len(values) == 3 else None
    return str(answer)[:80]
