"""Requirement that the run ends within a simulated time."""

from typing import Literal

from pydantic import Field

from ..programs import RunStop
from .kind import ROUNDING_S, Look, Numbers, RequirementKind, Rule, Scene, Seconds


class TimeLimitRequirement(RequirementKind):
    """Pass criterion: the run ends within a simulated time."""

    violated_when = "the run is not over at `limit_s`"

    kind: Literal["time_limit"] = Field(description="`time_limit`.")
    limit_s: Seconds = Field(description="Simulated time at which the run has to be over.")


class TimeLimitRule(Rule[TimeLimitRequirement]):
    """Judges the time limit requirement: whether the run ended in time."""

    def bind(self, scene: Scene) -> Look:
        """Connects the time limit to a simulation's time.

        If the environment ends its runs before that limit, the requirement cannot be judged.
        """
        environment, limit_s = scene.environment, self.asked.limit_s
        scene.expect_end(self)
        own_s = getattr(environment, "time_limit_s", None)
        if own_s is None and not hasattr(environment, "run_result"):
            own_s = getattr(environment, "_time_limit", None)  # dm_control's environments keep theirs there
        if isinstance(own_s, int | float) and own_s <= limit_s:
            self.fail(f"the environment ends its runs at {own_s:g} s, so a limit of {limit_s:g} s is never over")
        return self.update

    def update(self, time_s: float) -> None:
        """Records the current simulated time, and whether the limit is exceeded."""
        if time_s > self.asked.limit_s + ROUNDING_S:
            self.violate(time_s)

    @property
    def first_look_s(self) -> float:
        """Time limit in seconds, before which nothing can be violated."""
        return self.asked.limit_s

    @property
    def planned_s(self) -> float:
        """Simulated time limit of the run, in seconds."""
        return self.asked.limit_s

    def margin_until(self, time_s: float) -> tuple[float, str | None] | None:
        """Returns the time that is left and its unit, `s`; negative beyond the limit; `None` after an error."""
        return None if self.error is not None else (self.asked.limit_s - time_s, "s")

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
