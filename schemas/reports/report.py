"""Content of a run's report, and its figures, which `robomaker report -o json` prints."""

from datetime import datetime
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from ..job_owners import JobOwner
from ..runs.axis_kinds.kind import Value
from ..runs.plan import Requirement, RunResult
from ..runs.programs import Scarce, ToolEnds
from ..trial_copies import copies_not_counted
from ..wire.base import Model, optional
from .causes import AxisEffects, Why
from .challenge import Challenge
from .changes import SinceLastRun
from .comparison import TOO_FEW_PAIRS, RateChange
from .forecast import ForecastCheck
from .live_comparison import Answer
from .run_record import CaseOutcome as CaseOutcome
from .run_record import JobInputs
from .run_record import RunState as RunState


class ReportedFile(Model):
    """An output file that a report links to, with its name and URL."""

    name: str = Field(description="Path below the job's output prefix.")
    uri: str = Field(description="Address of the file: `file:///…` or `s3://…`.")
    size_bytes: int = Field(description="Size.")


class ReportedStep(Model):
    """A step of a specification in a run's report, with its status and duration."""

    name: str = Field(description="The step's name in the specification.")
    operation: str = Field(description="The operation it called.")
    status: str = Field(description="Resource status, or `Completed` for quick operations.")
    duration_s: float = Field(description="Wall-clock time.")
    detail: str = Field(default="", description="ARN it made, or the error.")


class ReportedWorld(Model):
    """A generated world in a run's report."""

    arn: str = Field(description="The world's ARN.")
    label: str = Field(description="Its id: `generation-…/world-3`.")
    name: str = Field(default="", description="Name for people, unique in the report: `flat 3`; empty: it has none.")
    world_json: Path = Field(description="`world.json` on this machine.")
    floorplan_svg: str = Field(description="Content of `floorplan.svg`.")
    preview_png: bytes = Field(description="Content of `preview.png`; empty if there is none.")

    @property
    def title(self) -> str:
        """Name for people; its id where it has none."""
        return self.name or self.label


class ReportedJob(Model):
    """A simulation job in a run's report, or a request of a batch for which no job was created."""

    label: str = Field(description="Job id, or `request 3` when no job came of it.")
    name: str = Field(default="", description="Name for people, unique in the run: `scout in flat 3`; empty: none.")
    variant: str = Field(
        default="", description="Settings of its request that not all jobs of the run have: `SPEED=2`."
    )
    step: str | None = optional("The step that made it.")
    request: dict[str, Any] = Field(default={}, description="The request that it was made from.", exclude=True)
    arn: str | None = optional("The job's ARN.")
    status: str = Field(description="The job's status, or `NotCreated`.")
    failure_code: str | None = optional("The service's failure code.")
    failure_reason: str | None = optional("Reason of the failure as text.")
    log_tail: str = Field(
        default="", description="Last lines of its log, where `failure_reason` does not already end with them."
    )
    world_arn: str | None = optional("World it drove in.")
    world_name: str | None = optional("Name of that world, unique in the run: `flat 3`.")
    application: str | None = optional("Name of its robot application, else of its simulation application.")
    seed: int | None = optional("Seed that it was given; absent when it never became a job.")
    result: RunResult | None = optional("Content of `result.json`, if there is one.")
    drawn_trial: int | None = optional("Number of the recorded trial whose path is drawn; absent: the job's own is.")
    drawn_result: RunResult | None = optional("Content of that trial's `result.json`.")
    poster_png: bytes = Field(default=b"", description="A frame of the video; empty if there is none.")
    files: list[ReportedFile] = Field(default=[], description="Published outputs.")
    removed_files: int = Field(default=0, description="How many more were published and have been removed since.")
    duration_s: float | None = optional("Wall-clock time of the job's run, in seconds.")
    waited_s: dict[Scarce, float] = Field(
        default={},
        description="How long it waited for its machine before, in seconds, by what that had too little of.",
    )
    video_s: float | None = optional("Wall-clock seconds for rendering videos of the failure.")
    upload_s: float | None = optional("Wall-clock seconds for storing the outputs.")
    inputs: JobInputs | None = optional("Inputs that decide its result; absent: not known.")
    known: str = Field(
        default="", description="Owner, last day and reason of its failure if that is known; else empty."
    )
    axes: dict[str, Value] = Field(
        default={},
        description="Values of its step's axes by name, a world by its content; empty: its step has none.",
    )
    reused_from: str | None = optional("The run, else the job, whose results it has taken over; absent: it was run.")
    carried_out_by: JobOwner | None = optional(
        "The process that carried it out last; absent: none has begun, or it is not known."
    )
    earlier: str | None = optional("Label and verdict or status of the job that was run again, in a rerun.")

    @property
    def title(self) -> str:
        """Name for people; its id where it has none."""
        return self.name or self.label


class Share(Model):
    """A pass rate: number of successes of a total, with its confidence interval."""

    name: str = Field(description="Thing that was counted: a requirement, a world, a room; empty for all jobs.")
    passed: int = Field(description="Number of successes.")
    failed: int = Field(description="Number of failures.")
    errors: int = Field(
        default=0, description="Number that could not be judged because of an error; not part of the rate."
    )
    copies: int = Field(
        default=0,
        description="Number of those that went through the same states as another one; the interval is as wide as that "
        "of the others.",
    )
    rate: float | None = optional("passed / (passed + failed); absent when that is 0 / 0.")
    low: float | None = optional("Lower end of the 95 % Wilson score interval of the rate.")
    high: float | None = optional("Upper end of that interval.")
    worst_margin: float | None = optional(
        "Smallest margin that was left, of a requirement; negative when it was missed."
    )
    unit: str | None = optional("Unit of the margin.")
    worst_job: str | None = optional("Job with the smallest margin.")

    @property
    def remark(self) -> str:
        """Remark on copies among the trials: `2 copies not counted`; empty: there are none."""
        return copies_not_counted(self.copies)

    @property
    def copies_briefly(self) -> str:
        """Number of copies, where what they are is said once for all rates: `2 copies`; empty: there are none."""
        return self.remark.removesuffix(" not counted")


class ArmComparison(Model):
    """Comparison of two values of a step's axis within one run, by pairs of trials that differ in nothing else."""

    baseline: str = Field(description="The first value of the axis, with which others are compared.")
    value: str = Field(description="The other value.")
    answer: Answer = Field(description="Whether trials with the other value pass more often, or less.")
    why: str = Field(description="The answer's reason in words.")
    pairs: int = Field(
        description="Pairs of trials of the same world, seed and values of all other axes; of an axis that varies the "
        "world, of the same seed and values."
    )
    unpaired: int = Field(description="Trials of the two values that have no partner.")
    unjudged: int = Field(description="Pairs of which a side has no verdict: it broke, was canceled or not judged.")
    other_requirements: int = Field(description="Pairs that were judged by different requirements; they do not count.")
    repeated: int = Field(
        default=0, description="Pairs that went through the same states as another pair, with which they count."
    )
    of_two_worlds: int = Field(
        default=0, description="Pairs whose sides drove in different worlds, as the axis varies the world."
    )
    adjusted_p_value: float | None = optional(
        "p-value of the test by Holm's method, for all comparisons of the run together, of an axis that varies the "
        "world for those of this axis; absent: nothing was judged."
    )
    same_states: bool = Field(default=False, description="Whether each pair went through the same states.")
    rate: RateChange | None = optional("Both pass rates with the test; `before` is the baseline.")

    @property
    def result(self) -> str:
        """Says of the other value how trials with it end: `passes more often`, or `too few pairs to tell`."""
        if self.is_open:
            return TOO_FEW_PAIRS
        return {"better": "passes more often", "worse": "passes less often"}.get(self.answer, self.answer)

    @property
    def is_open(self) -> bool:
        """Whether no difference is shown only since the pairs are too few: they leave open one that matters."""
        if self.answer != "no difference shown" or self.rate is None or self.same_states:
            return False
        return self.rate.leaves_open()


class AxisResult(Model):
    """Results of a step's jobs by the values of one of its axes."""

    step: str = Field(description="The step.")
    axis: str = Field(description="The axis.")
    shares: list[Share] = Field(description="Pass rates by value, or by fifths of many numbers.")
    comparisons: list[ArmComparison] = Field(description="The first value against each other one, in pairs.")
    note: str = Field(default="", description="Why there are no comparisons, or what they do not say.")


class Report(Model):
    """Full report of one run of a specification: steps, worlds and simulation jobs."""

    name: str = Field(description="Name of the specification.")
    run_id: str = Field(description="Id of this run of it.")
    state: RunState = Field(description="State of the finished run.")
    started_at: datetime = Field(description="Start, UTC.")
    ended_at: datetime = Field(description="End, UTC.")
    steps: list[ReportedStep] = Field(description="Steps, in the order they ran.")
    worlds: list[ReportedWorld] = Field(description="Worlds made or driven in.")
    jobs: list[ReportedJob] = Field(description="Simulation jobs, in request order.")
    command: str = Field(description="The command that runs it again.")
    refusal: str = Field(
        default="", description="Reason why the run was refused before its first step; empty: it was not."
    )
    against: str = Field(
        default="",
        description="Answer of a run that was carried out beside an earlier one, in words; empty: it was not.",
    )
    stopped_early: bool = Field(default=False, description="Whether that answer ended it before all jobs were made.")
    interrupted: str = Field(default="", description="When its processes died, in words; empty: none did.")
    known_notes: list[str] = Field(
        default=[],
        description="Sentences on known failures: those that did not occur, are about no job or whose day is over, and "
        "jobs that count as failed although some of what they missed is known.",
    )
    parameters: dict[str, Any] = Field(default={}, description="Values of the specification's parameters.")
    rerun_of: str = Field(default="", description="Run that it is a rerun of, and which of its jobs, in words.")
    forecast: ForecastCheck | None = optional(
        "How it compares to its forecast; absent: there was none, or not all of it was run."
    )
    where: str = Field(default="", description="Machine it ran on and where its outputs are, in words.")
    versions: dict[str, str] = Field(default={}, description="Versions of the main packages.")
    since_last: SinceLastRun | None = optional(
        "Changes since the last run of the specification; absent: it was not looked up."
    )
    challenge: Challenge | None = optional("Sabotages of its robots that were caught; absent: it is no challenge.")
    why: Why | None = optional("Groups of failures with what they go with; absent: no trial failed, or none was asked.")
    axes: list[AxisResult] = Field(default=[], description="Results by the axes of its steps.")
    effects: list[AxisEffects] = Field(
        default=[], description="Whether failures and margins depend on each axis, of steps or of trials."
    )


class JobCase(Model):
    """A simulation job as a test case of a report, or a request for which no job was created."""

    name: str = Field(description="Job id, or `request 3`.")
    title: str = Field(default="", description="Name for people, unique in the run: `scout in flat 3`; empty: none.")
    test: str = Field(
        description="Name of the job in every run of the specification, unique in its step: world or number of the "
        "request, and application."
    )
    case_name: str = Field(
        description="Name of its test case in JUnit files, the same in every run of the specification, unique in its "
        "step: `scout in flat 3`."
    )
    arn: str | None = optional("The job's ARN.")
    outcome: CaseOutcome = Field(description="Outcome of the job: FAIL is `failed`, ERROR is `broken`.")
    reason: str = Field(default="", description="Why it failed or broke; first line short.")
    known: str = Field(
        default="", description="Owner, last day and reason of its failure if that is known; else empty."
    )
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
    """The simulation jobs of one step, as a test suite of a report."""

    name: str = Field(description="The step.")
    operation: str = Field(description="The operation it called.")
    status: str = Field(description="Status of the resource it made.")
    error: str = Field(default="", description="Why the step itself failed; empty when it did not.")
    time_s: float = Field(description="Wall-clock time.")
    jobs: list[JobCase] = Field(description="Failures first, then in request order.")


class ReportSummary(Model):
    """Summary of one run of a specification in numbers: verdicts, pass rates and times."""

    schema_version: Literal[1] = Field(default=1, description="Version of this document's form.")
    name: str = Field(description="Name of the specification.")
    run_id: str = Field(description="Id of the run.")
    state: RunState = Field(description="State of the finished run.")
    started_at: datetime = Field(description="Start, UTC.")
    time_s: float = Field(description="Wall-clock time.")
    counts: dict[CaseOutcome, int] = Field(description="Number of jobs by outcome.")
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
    parameters: dict[str, Any] = Field(default={}, description="Values of the specification's parameters.")
    rerun_of: str = Field(default="", description="Run that it is a rerun of, and which of its jobs, in words.")
    against: str = Field(default="", description="Answer of a run that was carried out beside an earlier one.")
    stopped_early: bool = Field(default=False, description="Whether that answer ended it before all jobs were made.")
    forecast: ForecastCheck | None = optional(
        "How it compares to its forecast; absent: there was none, or not all of it was run."
    )
    challenge: Challenge | None = optional("Sabotages of its robots that were caught; absent: it is no challenge.")
    axes: list[AxisResult] = Field(default=[], description="Results by the axes of its steps.")
    effects: list[AxisEffects] = Field(
        default=[], description="Whether failures and margins depend on each axis, of steps or of trials."
    )
    why: Why | None = optional("Groups of failures with what they go with; absent: no trial failed, or none was asked.")
    console_url: str = Field(
        default="", description="Address of the console as other machines reach it; empty: none is known."
    )
    report_path: Path | None = optional("The HTML report.")
    junit_path: Path | None = optional("The JUnit file.")
