"""A report in numbers: what `robomaker report -o json` prints, and JUnit files are made from."""

from datetime import datetime
from pathlib import Path
from typing import Literal

from pydantic import Field

from ..runs.machine_waits import Scarce
from ..runs.plan import Requirement
from ..runs.programs import ToolEnds
from ..wire.base import Model, optional
from .changes import SinceLastRun
from .forecast import ForecastCheck
from .states import CaseOutcome as CaseOutcome
from .states import RunState


class Share(Model):
    """How many of some things went well, with what that says about all such things."""

    name: str = Field(description="Thing that was counted: a requirement, a world, a room; empty for all jobs.")
    passed: int = Field(description="Went well.")
    failed: int = Field(description="Went badly.")
    errors: int = Field(default=0, description="Could not be judged, since something broke; not part of the rate.")
    rate: float | None = optional("passed / (passed + failed); absent when that is 0 / 0.")
    low: float | None = optional("Lower end of the 95 % Wilson score interval of the rate.")
    high: float | None = optional("Upper end of it.")
    worst_margin: float | None = optional(
        "Smallest margin that was left, of a requirement; negative when it was missed."
    )
    unit: str | None = optional("Unit of the margin.")
    worst_job: str | None = optional("Job with the smallest margin.")


class JobCase(Model):
    """One simulation job, or a request that became none."""

    name: str = Field(description="Job id, or `request 3`.")
    test: str = Field(
        description="Name of the job in every run of the specification, unique in its step: world or number of the "
        "request, and application."
    )
    arn: str | None = optional("The job's ARN.")
    outcome: CaseOutcome = Field(description="Outcome of the job: FAIL is `failed`, ERROR is `broken`.")
    reason: str = Field(default="", description="Why it failed or broke; first line short.")
    failure_code: str | None = optional("The service's failure code.")
    time_s: float = Field(description="Wall-clock time.")
    waited_s: dict[Scarce, float] = Field(
        default={},
        description="How long it waited for its machine before, in seconds, by what that had too little of; waits of "
        "less than a second, and those for jobs of its own batch, are left out.",
    )
    sim_time_s: float | None = optional("Simulated time.")
    seed: int | None = optional("Seed of the run.")
    world: str | None = optional("World it drove in.")
    output: str | None = optional("Address of its outputs.")
    requirements: list[Requirement] = Field(default=[], description="Requirements that it was judged by.")
    remarks: list[str] = Field(default=[], description="Requested outputs that could not be produced, such as a video.")
    tools: list[ToolEnds] = Field(default=[], description="Tools that ended while it ran, and were started again.")
    metrics: dict[str, float] = Field(default={}, description="Numbers by name with unit.")
    trials: Share | None = optional("How many of its trials passed; absent: it has none.")
    reused_from: str | None = optional("The run, else the job, whose results it has taken over; absent: it was run.")
    earlier: str | None = optional("Label and verdict or status of the job that was run again, in a rerun.")


class StepSuite(Model):
    """The jobs of one step of the pipeline."""

    name: str = Field(description="The step.")
    operation: str = Field(description="The operation it called.")
    status: str = Field(description="Status of the resource it made.")
    error: str = Field(default="", description="Why the step itself failed; empty when it did not.")
    time_s: float = Field(description="Wall-clock time.")
    jobs: list[JobCase] = Field(description="Failures first, then in request order.")


class ReportSummary(Model):
    """One run of a specification, in numbers."""

    schema_version: Literal[1] = Field(default=1, description="Version of this document's form.")
    name: str = Field(description="Name of the specification.")
    run_id: str = Field(description="Id of the run.")
    state: RunState = Field(description="How it ended as a whole.")
    started_at: datetime = Field(description="Start, UTC.")
    time_s: float = Field(description="Wall-clock time.")
    counts: dict[CaseOutcome, int] = Field(description="Jobs by outcome.")
    trials: int = Field(description="How many trials they had; a job without trials is one.")
    success: Share = Field(description="All trials that were judged.")
    success_with_errors: Share = Field(description="The same if what broke counted as failed.")
    requirements: list[Share] = Field(description="Judgements by requirement, the worst first.")
    worlds: list[Share] = Field(description="Trials by world, the worst first.")
    rooms: list[Share] = Field(description="Visits by name of the room, the worst first.")
    steps: list[StepSuite] = Field(description="Steps that made jobs or failed, in order.")
    since_last: SinceLastRun | None = optional(
        "Changes since the last run of the specification; absent: it was not looked up."
    )
    rerun_of: str = Field(default="", description="Run that it is a rerun of, and which of its jobs, in words.")
    forecast: ForecastCheck | None = optional(
        "How it compares to its forecast; absent: there was none, or not all of it was run."
    )
    report_path: Path | None = optional("The HTML report.")
    junit_path: Path | None = optional("The JUnit file.")
