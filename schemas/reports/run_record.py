"""Record of one run of a specification (`run.json` in its run folder), and the order by which it can be resumed."""

import shlex
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, Literal, Self
from uuid import UUID

from pydantic import Field

from ..job_owners import JobOwner, NeededEnvironment
from ..known_failures import KnownFailure
from ..runs.axis_kinds.kind import Value
from ..runs.plan import Requirement, Verdict
from ..runs.programs import ApplicationRole
from ..wire.base import Model, optional
from .challenge import Challenge
from .forecast import ForecastCheck
from .live_comparison import Against, AgainstAnswer
from .names import with_id

RunState = Literal["succeeded", "failed", "broken", "canceled", "timed out"]
"""States of a finished run as a whole."""
CUT_SHORT: frozenset[RunState] = frozenset({"canceled", "timed out"})
"""States of runs that did not end by themselves, so that some of their jobs may have no result."""

_WORLDS = (
    "ARNs of the worlds that the specification names by something else, by name, as they were found when the run "
    "began; a process that resumes the run uses these."
)

CaseOutcome = Literal["broken", "failed", "canceled", "unfinished", "no verdict", "passed"]
WITHOUT_GOOD_RESULT: frozenset[CaseOutcome] = frozenset({"broken", "failed", "canceled", "unfinished"})
"""Outcomes of jobs without a good result, which `robomaker rerun --failed` runs again."""


def case_outcome(status: str, verdict: Verdict | None, failure_code: str | None = None) -> CaseOutcome:
    """Classifies a simulation job as passed, failed, broken or canceled.

    The status takes precedence: a verdict counts only if the job ended by itself.
    """
    if status in ("Canceled", "Terminated", "Terminating"):
        return "canceled"
    if status == "NotCreated" and failure_code == "BatchCanceled":
        return "canceled"
    if status in ("Failed", "RunningFailed", "NotCreated") or (failure_code and status != "Completed"):
        return "broken"
    if status != "Completed":
        return "unfinished"
    outcomes: dict[Verdict, CaseOutcome] = {"ERROR": "broken", "FAIL": "failed", "PASS": "passed"}
    return outcomes.get(verdict or "NONE", "no verdict")


"""Outcomes of one job."""


class SourceCommit(Model):
    """Git commit of the folder that a specification was in, and whether that had uncommitted changes."""

    commit: str = Field(description="The commit's full hash.")
    changed: bool = Field(description="Whether files that Git tracks differed from it.")


class UsedApplication(Model):
    """An application with the version and archive hash that a simulation job ran."""

    role: ApplicationRole = Field(description="Robot or simulation application.")
    name: str = Field(description="Its name in the catalog.")
    digest: str = Field(description="SHA-256 of its files, or the id of its container image; empty: not loaded.")


class JobInputs(Model):
    """Inputs that decide a simulation job's result, as far as known; reports compare runs by them.

    They are stored in records, and are less strict than `ReuseInputs`, by which results are reused: two jobs with the
    same name and request are the same job in two runs, even with other robots, versions and output locations.
    """

    seed: int | None = optional("Its seed; absent: it never became a job.")
    seed_given: bool = Field(description="Whether the request named the seed; otherwise it was drawn by chance.")
    world: str | None = optional(
        "Name of the world's content, the same for the same world of every night; its ARN where the world "
        "is deleted and its content not known."
    )
    applications: list[UsedApplication] = Field(
        default=[], description="Its applications; one that was never started is missing."
    )
    requirements_sha256: str | None = optional(
        "SHA-256 of the requirements that its request names; absent: it names none."
    )
    request_sha256: str = Field(
        description="SHA-256 of what its request asks for: applications, launch configurations, data, limits and "
        "requirements, without ARNs, which are others every night."
    )
    trials_and_data_sha256: str | None = optional(
        "SHA-256 of what else decides its result: its trials (seeds and values of axes, not which are recorded) and "
        "the contents of its data; absent: they are not known, or an early release wrote the record."
    )


class StepRecord(Model):
    """Record of one step of a run: its times, status and results."""

    name: str = Field(description="The step's name in the specification.")
    operation: str = Field(description="The operation it called.")
    status: str = Field(
        description="The resource's terminal status, `Completed` for quick operations, `Failed`, or `Skipped` when an "
        "earlier step's failure, a cancellation or the answer of `--against` kept it from starting."
    )
    started_at: datetime | None = optional("Start, UTC; absent when it was skipped.")
    ended_at: datetime | None = optional("End, UTC; absent when it was skipped.")
    arn: str | None = optional("The resource it made.")
    output: dict[str, Any] = Field(
        default={}, description="Response that references see: the operation's own, or a job's final Describe response."
    )
    error: str | None = optional("Reason of the failure as text.")


BEFORE_STEPS = "before the first step"
"""Name of the step in the record of a run that was refused before its first step; a step of a specification has none.

Its error is the reason.
"""


class RerunOf(Model):
    """The earlier run whose jobs, all or some, a rerun repeats."""

    run_id: str = Field(description="The earlier run.")
    selection: str = Field(description="The jobs of it that were run again, in words.")
    jobs_total: int = Field(description="How many jobs and requests that run had.")
    earlier: dict[str, list[str]] = Field(
        description="Label and verdict or status of each job of that run that was run again, by step and in the order "
        "of its requests."
    )
    names: dict[str, list[str]] = Field(
        default={},
        description="Names that jobs had in that run, by label, for known failures: the few jobs of a rerun may be "
        "called otherwise.",
    )


class JobRecord(Model):
    """Short record of one simulation job in a run: status, verdict, metrics and inputs."""

    arn: str | None = optional("The job's ARN; absent when no job came of the request.")
    label: str = Field(description="Job id, or `request 3` when no job came of it.")
    name: str = Field(
        default="",
        description="Name for people, unique in the run: `scout in flat 3`, with parameters where others of the run "
        "have the same; empty: an early release wrote the record.",
    )
    variant: str = Field(
        default="", description="Settings of its request that not all jobs of the run have: `SPEED=2`."
    )
    status: str = Field(description="The job's status; of a request `NotCreated`, or `Pending` if none came of it yet.")
    verdict: Verdict | None = optional("The simulation's verdict; absent when there is none.")
    world: str | None = optional("Id of the world it drove in, or its ARN.")
    world_name: str | None = optional("Name of that world, unique in the run: `flat 3`.")
    rooms_visited: int | None = optional("Rooms the robot was in.")
    rooms_total: int | None = optional("Rooms of the world.")
    duration_s: float | None = optional("Wall-clock time of the run.")
    sim_time_s: float | None = optional(
        "Simulated time of the run, of all trials together; absent: nothing was simulated, or it is not known."
    )
    ended_by: str | None = optional("Cause of the simulation's end, from `result.json`; absent: it has no result.")
    state_digest: str | None = optional(
        "Digest of all states that the simulation went through; absent: it has none, or an early release wrote the "
        "record."
    )
    verdict_reason: str | None = optional("Why the verdict is FAIL: what was found and what was asked for.")
    unnamed_failure: bool = Field(
        default=False,
        description="Whether it failed for more than requirements that it missed: its environment's own verdict, or "
        "trials that broke, are missing or have no verdict.",
    )
    known: str = Field(
        default="", description="Owner, last day and reason of its failure if that is known; else empty."
    )
    remarks: list[str] = Field(
        default=[],
        description="Requested outputs that could not be produced, such as a video; the run continued without them.",
    )
    failure_code: str | None = optional("The service's failure code.")
    failure_reason: str | None = optional("Reason of the failure as text.")
    runs_free: bool = Field(
        default=False,
        description="Whether its robot application is a program, or ROS nodes, that the simulation did not wait for, "
        "so that what it did depends on the machine's clock.",
    )
    metrics: dict[str, float] = Field(default={}, description="Numbers by name with unit, from `result.json`.")
    output_uri: str | None = optional("Address of its outputs.")
    step: str | None = optional("The step that made it.")
    test: str | None = optional(
        "Name of the job in every run of the specification, unique in its step: world or number of the "
        "request, and application."
    )
    case_name: str = Field(
        default="",
        description="Name of its test case in JUnit files, the same in every run of the specification, unique in its "
        "step: `scout in flat 3`; empty: an early release wrote the record.",
    )
    requirements: list[Requirement] = Field(
        default=[], description="Requirements that it was judged by, from `result.json`."
    )
    inputs: JobInputs | None = optional("Inputs that decide its result; absent: its job was deleted.")
    axes: dict[str, Value] = Field(
        default={},
        description="Values of its step's axes by name, a world by its content; empty: its step has none.",
    )
    reused_from: str | None = optional("The run, else the job, whose results it has taken over; absent: it was run.")
    earlier: str | None = optional("Label and verdict or status of the job that was run again, in a rerun.")
    carried_out_by: JobOwner | None = optional(
        "The process that carried it out last; absent: none did, or it is not known."
    )

    @property
    def title(self) -> str:
        """Name for people; its id where it has none."""
        return self.name or self.label

    @property
    def title_with_id(self) -> str:
        """Name with the id behind it: `scout in flat 3 (sim-82856b0yq33y)`."""
        return with_id(self.name, self.label)

    def moved(self, before: str, now: str) -> Self:
        """Returns the record with the address of its outputs below another folder, if they were below the one before.

        Args:
            before: Address of the folder, which ends with `/`.
            now: Address of the folder that it became.
        """
        if not before or not (self.output_uri or "").startswith(before):
            return self
        return self.model_copy(update={"output_uri": now + (self.output_uri or "").removeprefix(before)})

    @property
    def world_title(self) -> str | None:
        """Name of its world for people; the world's id where it has none; None: no world."""
        return self.world_name or self.world


class Interruption(Model):
    """An interruption of a run: its process died, and another process finished the run later."""

    lost: JobOwner | None = Field(description="Process that died; absent: unknown.")
    lost_at: datetime = Field(description="Time of the process's last sign of life, UTC.")
    continued_at: datetime = Field(description="Time at which another process resumed the run, UTC.")


class RunRecord(Model):
    """Record of one run of a specification, kept in `run.json` for reports and comparisons."""

    schema_version: Literal[2] = Field(default=2, description="Version of this document's form.")
    run_id: str = Field(description="Id of this run.")
    name: str = Field(description="Name of the specification.")
    spec_path: str = Field(description="The file that was run.")
    parameters: dict[str, Any] = Field(
        default={}, description="Values of the specification's parameters, defaults included."
    )
    worlds: dict[str, str] = Field(default={}, description=_WORLDS)
    command: list[str] = Field(default=[], description="The command that runs it again.")
    state: RunState = Field(description="State of the finished run.")
    exit_code: int = Field(
        description="Exit code of the command line, `EXIT_CODES[state]`; of a run with `against` that succeeded or "
        "failed, that of its answer."
    )
    started_at: datetime = Field(description="Start, UTC.")
    ended_at: datetime = Field(description="End, UTC.")
    steps: list[StepRecord] = Field(description="Steps, in the order they ran.")
    jobs: list[JobRecord] = Field(default=[], description="Simulation jobs, in request order.")
    versions: dict[str, str] = Field(default={}, description="Versions of the main packages it ran with.")
    source: SourceCommit | None = optional("Git commit of the folder of the specification; absent: it was in none.")
    known: list[KnownFailure] = Field(
        default=[], description="Known failures of the specification, which do not make the run red."
    )
    known_notes: list[str] = Field(
        default=[],
        description="Sentences on known failures: those that did not occur, are about no job or whose day is over, and "
        "jobs that count as failed although some of what they missed is known.",
    )
    report_path: Path | None = optional("The HTML report; absent when it could not be written.")
    rerun_of: RerunOf | None = optional("Run that it has run again; absent: it is no rerun.")
    forecast: ForecastCheck | None = optional(
        "How it compares to its forecast; absent: there was none, or not all of it was run."
    )
    probe: bool = Field(
        default=False,
        description="Whether it was cut down, to forecast the whole run or to challenge its requirements.",
    )
    challenge: Challenge | None = optional("Sabotages of its robots that were caught; absent: it is no challenge.")
    reuse: bool = Field(default=False, description="Whether it could take over worlds and results of earlier runs.")
    against: AgainstAnswer | None = optional(
        "Answer of a run that was carried out beside an earlier one; absent: it was not."
    )
    flow_run: UUID | None = optional("Prefect's flow run that wrote this record; absent: none did, or it is not known.")
    interruptions: list[Interruption] = Field(
        default=[], description="When its processes died, so that others finished it; mostly none did."
    )
    run_dir: Path = Field(description="Folder of this run: this record, the specification, the report.")

    @classmethod
    def stored_in(cls, folder: Path, content: bytes) -> Self:
        """Reads a record from a file in a run's folder, whose paths it gets: the home may have been copied or moved.

        Args:
            folder: Folder that the file is in now; what is written for the run goes there.
            content: Content of the file.

        Raises:
            ValidationError: It is not a record.
        """
        record, here = cls.model_validate_json(content), folder.absolute()
        if record.run_dir == here:
            return record
        report = record.report_path and here / record.report_path.name
        jobs = record.jobs
        if here.parent.name == "runs" and (here.parents[1] / "objects").is_dir():  # else the folder was copied alone
            jobs = [job.moved(_objects_of(record.run_dir), _objects_of(here)) for job in record.jobs]
        return record.model_copy(update={"run_dir": here, "report_path": report, "jobs": jobs})

    @property
    def refusal(self) -> str | None:
        """Reason why the run was refused before its first step; `None`: it was not."""
        return next((step.error for step in self.steps if step.name == BEFORE_STEPS), None)

    @property
    def refused_in_words(self) -> str:
        """Sentence without full stop on the reason why the run was refused; empty: it was not."""
        return f"refused before its first step: {self.refusal}" if self.refusal is not None else ""

    @property
    def ended_before_jobs(self) -> bool:
        """Whether it ended before it had any jobs, so that nothing of it can be compared with other runs."""
        return not self.jobs and self.state not in ("succeeded", "failed")

    @property
    def step_error(self) -> str:
        """Step at which the run broke, with its error on one line, where no job tells why; empty: there is none."""
        outcomes = (case_outcome(job.status, job.verdict, job.failure_code) for job in self.jobs if not job.known)
        if self.state != "broken" or self.refusal is not None or "broken" in outcomes:
            return ""
        told = ((step.name, step.error.partition("\nLast lines of ")[0]) for step in self.steps if step.error)
        return next((f"step {name}: {' '.join(error.split())}" for name, error in told), "")

    @property
    def whole_again(self) -> str:
        """Command that runs all of it again."""
        return shlex.join(self.command or ["robomaker", "run", self.spec_path])

    @property
    def again(self) -> str:
        """Command that runs it again: the jobs without a good result if it has any, else the jobs, else all of it."""
        if not self.jobs:  # `robomaker rerun` finds nothing to run again
            return self.whole_again
        # Known failures leave the state as it is, and what broke may be a step without jobs.
        outcomes = {case_outcome(job.status, job.verdict, job.failure_code) for job in self.jobs}
        return f"robomaker rerun {self.run_id}{' --failed' if outcomes & WITHOUT_GOOD_RESULT else ''}"


def _objects_of(run: Path) -> str:
    """Returns the address of the home's own object store, of the folder of a run in it; empty: it is in no home."""
    return f"{(run.parents[1] / 'objects').as_uri()}/" if run.is_absolute() and len(run.parents) > 1 else ""


def interrupted_briefly(count: int) -> str:
    """Returns text such as `interrupted once`; empty for a run that was never interrupted."""
    times = {1: "once", 2: "twice"}.get(count, f"{count} times")
    return f"interrupted {times}" if count else ""


def interrupted_in_words(interruptions: Sequence[Interruption]) -> str:
    """Describes when a run's process died and when another resumed the run; empty if that never happened.

    An example: `interrupted once: OWNER died at about 2026-11-27 02:10:00, and another process took the run up at
    02:15:00 UTC`.
    """
    each = [
        f"{item.lost or 'its process'} died at about {item.lost_at:%Y-%m-%d %H:%M:%S}, and another process took the "
        f"run up at {item.continued_at:%H:%M:%S} UTC"
        for item in interruptions
    ]
    return f"{interrupted_briefly(len(interruptions))}: {'; '.join(each)}" if interruptions else ""


def new_run_id(name: str, at: datetime) -> str:
    """Makes the id of a run from its specification's name and its start time."""
    return f"{name}-{at:%Y%m%dT%H%M%S%f}"[:-3]


class Order(Model):
    """Order to run a specification, stored in the run's folder until the run has ended so that it can be resumed."""

    run_id: str = Field(description="Id of the run; its folder exists.")
    text: str = Field(description="The specification, which may hold secrets.")
    filename: str = Field(description="Name of the file in problems.")
    spec_path: str = Field(description="The file that the record names: that of the package, or the one in the folder.")
    command: list[str] = Field(description="The command that runs it again.")
    rerun_of: RerunOf | None = optional("Earlier run that runs again; absent: it is no rerun.")
    key_id: str | None = optional("Id of the visitor's access key; absent: none is asked for.")
    address: str | None = optional("Network address of the visitor, for the audit log.")
    audit_log: Path | None = optional("The server's audit log; absent: there is none.")
    name: str | None = optional("Name of the run; absent: that of the specification.")
    parameters: dict[str, Any] = Field(default={}, description="Values of the specification's parameters, all of them.")
    seed: int | None = optional("Seed in place of those of the specification; absent: none.")
    worlds: dict[str, str] = Field(default={}, description=_WORLDS)
    reuse: bool = Field(default=False, description="Whether it may take over worlds and results of earlier runs.")
    against: Against | None = optional("The earlier run beside which it is carried out; absent: none.")
    decided: AgainstAnswer | None = optional("Answer for which its jobs are cancelled; absent: none yet.")
    started_at: datetime | None = optional("When it began, UTC; absent: when its process begins.")
    source: SourceCommit | None = optional("Git commit of the specification's folder; absent: it was in none.")
    owner: JobOwner | None = optional("The process that carries it out, or did last.")
    needed: NeededEnvironment | None = optional(
        "The environment in which it was ordered; absent: any process may finish it."
    )
    flow_run: str | None = optional("Id of the flow run of its process; absent: not known.")
    deployment: str | None = optional("Id of the Prefect deployment that it is a run of; absent: of none.")
    interruptions: list[Interruption] = Field(default=[], description="When its processes died, the first one first.")
