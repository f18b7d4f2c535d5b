"""Requirement kind that switches off one of the environment's own requirements for a job."""

from typing import Literal

from pydantic import Field, field_validator

from ...wire.request_problems import nearest
from .kind import Look, Numbers, Requirement, RequirementKind, Rule, Scene

NOT_THERE = "the environment has no requirement of this name to switch off"

ROOMS_VISITED, NO_HARD_COLLISION, UPRIGHT = IN_ROOMS = ("rooms_visited", "no_hard_collision", "upright")
"""Names of the requirements of `indoor-navigation`, all of which every job there has."""


class OffRequirement(RequirementKind):
    """Switches off the environment's requirement of the same name."""

    violated_when = "never: the environment's own requirement of this `name` does not count; it has to have one"

    kind: Literal["off"] = Field(description="`off`.")

    def unknown_in_rooms(self) -> str | None:
        """Explains that `indoor-navigation` has no requirement of this name; `None` if it has."""
        if self.name in IN_ROOMS:
            return None
        hint = nearest(self.name, IN_ROOMS) or f"; there are {', '.join(IN_ROOMS)}"
        return f"is {self.name!r}; indoor-navigation has no requirement of this name to switch off{hint}"

    @field_validator("stop")
    @classmethod
    def _ends_nothing(cls, stop: bool) -> bool:
        if stop:
            raise ValueError("is true; what is off ends no run: leave it out")
        return stop


class OffRule(Rule[OffRequirement]):
    """Judges nothing, but is an error if the environment has no requirement of that name."""

    def __init__(self, asked: OffRequirement) -> None:
        super().__init__(asked)
        self.is_there = False
        """Whether the environment's `requirements()` have one of this name; its report may still have one."""

    def bind(self, scene: Scene) -> Look:  # noqa: ARG002 - as of other rules
        """Returns a check that does nothing, as this rule measures nothing."""
        return lambda _time_s: None

    def judged(self, end_s: float, ended_by: str) -> Requirement:  # noqa: ARG002 - as of other rules
        """Returns the entry that replaces the environment's requirement; an error as long as none was found."""
        name, error = self.asked.name, self.error or (None if self.is_there else NOT_THERE)
        if error is not None:
            return Requirement(
                name=name, kind="off", satisfied=False, detail=f"could not be judged: {error}", error=error
            )
        return Requirement(name=name, kind="off", satisfied=True, detail=self._detail(), counts=False)

    def _numbers(self) -> Numbers:
        return Numbers()

    def _detail(self) -> str:
        return "the environment's own, switched off by the job"
