"""History of a specification's runs (nights), and scheduled runs that did not happen."""

from datetime import datetime
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from ..wire.base import Model, optional
from ..wire.common import counted, passed_of
from .changes import CellName, ChangedInput, FailureStart, SinceLastRun
from .report import Share
from .run_record import CUT_SHORT, CaseOutcome, RunState, SourceCommit
from .run_states import state_in_words


class MissedNight(Model):
    """A scheduled run that did not happen, or that was interrupted and is not finished yet."""

    due_at: datetime = Field(description="Time at which the run was due, UTC.")
    reason: str = Field(description="Reason why the run did not happen, as text.")
    has_begun: bool = Field(default=False, description="Whether it began, and its process died before its end.")

    @property
    def kind(self) -> str:
        """Kind of the missed run: `no night`, or `not finished`."""
        return "not finished" if self.has_begun else "no night"

    def in_words(self) -> str:
        """Describes the missed run: `no night on 27 November (02:00 UTC): no Prefect worker was running`."""
        day = f"{self.due_at.day} {self.due_at:%B}"
        return f"no night on {day} ({self.due_at:%H:%M} UTC): {self.reason}"


class NightSchedule(Model):
    """Schedule of nightly runs that one Prefect deployment makes in this data home."""

    deployment: str = Field(description="Id of the deployment in Prefect.")
    name: str = Field(description="Name of the specification.")
    checked_until: datetime = Field(description="Nights that were due until then are judged, UTC.")
    expected: list[datetime] = Field(default=[], description="When the next nights are due, as Prefect said last, UTC.")
    paused_since: datetime | None = optional("When its schedules were last known to be active, UTC; absent: they are.")
    missed: list[MissedNight] = Field(default=[], description="Nights that did not happen, the oldest first.")


class Night(Model):
    """One run in the history of its specification: id, time, state and counts."""

    run_id: str = Field(description="Id of the run.")
    started_at: datetime = Field(description="Start, UTC.")
    state: RunState = Field(description="State of the finished run.")
    jobs: int = Field(description="Number of jobs in the run.")
    jobs_judged: int = Field(default=0, description="How many of them passed or failed.")
    jobs_passed: int = Field(default=0, description="How many of them passed.")
    trials: int = Field(description="How many trials they had; a job without trials is one.")
    success: Share = Field(
        description="Its trials; those that broke are not judged. A run that stopped early has no interval, since its "
        "trials have ended it; one that was canceled or ran out of time has no rate, as those that ended first are no "
        "sample of all."
    )
    refusal: str = Field(default="", description="Reason why it was refused before its first step; empty: it was not.")
    step_error: str = Field(
        default="",
        description="Step at which it broke, with its error, where no job tells why; empty: there is none.",
    )
    known: int = Field(default=0, description="How many of its jobs failed as its specification knows.")
    taken_over: int = Field(
        default=0,
        description="How many of its jobs took over results that count for an earlier run. They count for no job, "
        "world or requirement again; a run that took over all of them has no rate.",
    )
    against: str = Field(
        default="",
        description="Answer of a run that was carried out beside an earlier one, in words; empty: it was not.",
    )
    interruptions: int = Field(default=0, description="How many of its processes died before others finished it.")
    parameters: dict[str, Any] = Field(default={}, description="Values of its specification's parameters.")
    source: SourceCommit | None = optional("Commit of its specification; absent: none known.")
    changed: list[ChangedInput] = Field(default=[], description="Inputs that differ from the run before.")
    report_path: Path | None = optional("Its HTML report.")

    @property
    def shown_state(self) -> str:
        """State of the run as pages show it: `passed` if it succeeded and each of its jobs passed."""
        return state_in_words(self.state, {"passed": self.jobs_passed, "others": self.jobs - self.jobs_passed})

    @property
    def passed_in_words(self) -> str:
        """Number of jobs that passed: `3 of 4 jobs passed`, of jobs with trials with `(46 of 50 trials passed)`."""
        told = passed_of(self.jobs_passed, self.jobs, "job")
        if self.trials == self.jobs or self.is_taken_over:
            return told
        return f"{told} ({passed_of(self.success.passed, self.trials, 'trial', self.success.errors)})"

    @property
    def cut_short(self) -> str:
        """End of a run that did not end by itself: `canceled, 9 of 60 jobs judged`; empty: it ended by itself."""
        if self.state not in CUT_SHORT:
            return ""
        return f"{self.state}, {self.jobs_judged} of {counted(self.jobs, 'job')} judged"

    @property
    def is_taken_over(self) -> bool:
        """Whether all its results are those of earlier runs, which have counted already."""
        return 0 < self.jobs == self.taken_over

    @property
    def refused_in_words(self) -> str:
        """Text on the reason why it was refused; empty: it was not."""
        return f"refused before its first step: {self.refusal}" if self.refusal else ""

    @property
    def why_broken(self) -> str:
        """Reason why it broke that no job has: why it was refused, or the step's error; empty: there is none."""
        return self.refused_in_words or self.step_error

    @property
    def jobs_in_words(self) -> str:
        """Numbers of its jobs that took over results, and whose failure is known: `8 of 10 taken over, 1 known`."""
        taken = "taken over" if self.is_taken_over else f"{self.taken_over} of {self.jobs} taken over"
        told = (taken if self.taken_over else "", f"{self.known} known" if self.known else "")
        return ", ".join(filter(None, told))


class CellHistory(Model):
    """Outcomes of one simulation job over the runs of its specification."""

    cell: CellName = Field(description="Name of the job, as in the last run that has it.")
    outcomes: list[CaseOutcome | None] = Field(description="Its outcome in each night; None: that run has no such job.")
    success: Share = Field(description="Number of runs in which the job passed.")
    changes: int = Field(description="How often a result differed from the one before.")
    unsteady: bool = Field(
        description="Whether it passed and failed with the same inputs, or changed its result at least three times."
    )
    same_inputs: bool = Field(
        description="Whether it passed and failed with the same applications, versions, request, trials, data and seed."
    )
    since: FailureStart | None = optional("Since when it fails; absent: it does not.")


class SharesByNight(Model):
    """Pass rates of one requirement or world over the runs of a specification."""

    total: Share = Field(description="All nights together.")
    nights: list[Share | None] = Field(description="Each night; None: it was not judged in that run.")


class History(Model):
    """History of the runs of one specification: runs, jobs, requirements and missed nights."""

    schema_version: Literal[1] = Field(default=1, description="Version of this document's form.")
    name: str = Field(description="Name of the specification.")
    nights: list[Night] = Field(description="Its runs, the oldest first.")
    missed: list[MissedNight] = Field(
        default=[],
        description="Nights that did not happen or are not finished since the first of them, in their order.",
    )
    left_out: int = Field(default=0, description="Older runs that were not looked at.")
    since_last: SinceLastRun = Field(description="Differences of the last run from the one before.")
    cells: list[CellHistory] = Field(description="Its jobs, those that fail or are unsteady first.")
    cells_left_out: int = Field(default=0, description="Jobs that only one earlier run has, which are not listed.")
    worlds: list[SharesByNight] = Field(description="Trials by world, the worst first.")
    requirements: list[SharesByNight] = Field(description="Judgements by requirement, the worst first.")
