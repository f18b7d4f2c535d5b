"""Time limits: the run has to be over in time."""

from typing import Literal

from pydantic import Field

from ..programs import RunStop
from .kind import ROUNDING_S, Look, Numbers, RequirementKind, Rule, Scene, Seconds


class TimeLimitRequirement(RequirementKind):
    """The run has to be over in time."""

    violated_when = "the run is not over at `limit_s`"

    kind: Literal["time_limit"] = Field(description="`time_limit`.")
    limit_s: Seconds = Field(description="Simulated time at which the run has to be over.")


class TimeLimitRule(Rule[TimeLimitRequirement]):
    """Score of a time limit: the run ended in time, or not."""

    def bind(self, scene: Scene) -> Look:
        """Looks at the time; a limit that an environment never comes to, since it ends its runs before, is an error."""
        environment, limit_s = scene.environment, self.asked.limit_s
        own_s = getattr(environment, "time_limit_s", None)
        if own_s is None and not hasattr(environment, "run_result"):
            own_s = getattr(environment, "_time_limit", None)  # dm_control's environments keep theirs there
        if isinstance(own_s, int | float) and own_s <= limit_s:
            self.fail(f"the environment ends its runs at {own_s:g} s, so a limit of {limit_s:g} s is never over")
        return self.update

    def update(self, time_s: float) -> None:
        """Takes note of the time."""
        if time_s > self.asked.limit_s + ROUNDING_S:
            self.violate(time_s)

    @property
    def first_look_s(self) -> float:
        """The limit: nothing can happen before, and that it is over is to be seen at once."""
        return self.asked.limit_s

    @property
    def planned_s(self) -> float:
        """The limit."""
        return self.asked.limit_s

    def _unjudgeable(self) -> str | None:
        self.update(self._end_s)
        if self.violated_s is None and self._ended_by == RunStop.DURATION_LIMIT:
            limit_s = self.asked.limit_s
            return f"it was not over when the job's duration limit ended it, at {self._end_s:.2f} of {limit_s:g} s"
        return None

    def _numbers(self) -> Numbers:
        return Numbers(self._end_s, self.asked.limit_s, "s")

    def _detail(self) -> str:
        return f"ended at {self._end_s:.2f} s by {self._ended_by}, {self.asked.limit_s:g} s allowed"
