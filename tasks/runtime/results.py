"""What a run reports, and how `result.json` is written."""

from typing import Any, Protocol, runtime_checkable

from pydantic import Field

from ...schemas.base import Model
from ...schemas.simulation_run import Collision, Requirement, RoomVisit, Verdict


class EnvironmentReport(Model):
    """What an environment knows about its run; times, seed and versions are added by the runtime."""

    verdict: Verdict = Field(default="NONE", description="PASS, FAIL, or NONE when nothing is judged.")
    summary: str = Field(default="", description="One sentence for a person.")
    requirements: list[Requirement] = Field(default=[], description="What the verdict depends on.")
    metrics: dict[str, float] = Field(default={}, description="Numbers by name with unit.")
    rooms: list[RoomVisit] = Field(default=[], description="Rooms, in the world's order.")
    collisions: list[Collision] = Field(default=[], description="At most 200, in order.")
    path: list[tuple[float, float, float]] = Field(
        default=[], description="(simulated time in s, x, y) of the robot, at most 600 points."
    )
    extra: dict[str, Any] = Field(default={}, description="Anything else worth keeping, as plain JSON values.")


@runtime_checkable
class ReportingEnvironment(Protocol):
    """An environment that judges its run: `run_result` is called once, after the last step."""

    def run_result(self) -> EnvironmentReport | dict[str, Any]:
        """Returns the report, as a model or as a dict with the model's members."""
        ...
