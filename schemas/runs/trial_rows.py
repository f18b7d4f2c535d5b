"""Results of a job's trials: a row for each, and a summary.

The rows are stored as `trials.parquet` in the job's outputs, the summary in `extra.trials` of its `result.json`. A
recorded trial has an output folder of its own, like a job: `trials/000012`.
"""

from collections import Counter
from pathlib import PurePosixPath
from typing import Literal

from pydantic import Field, ValidationError

from ..wire.base import Model, optional
from .axes import AxisSetting
from .axis_kinds.kind import Value
from .plan import ENVIRONMENT_VERDICT, Judged, JudgedCounts, Requirement, RunPlan, RunResult, Verdict
from .provenance import StateDigestSummary
from .trials import Trial

TRIALS_FILE = "trials.parquet"
TRIALS_FOLDER = "trials"
SUMMARY_NAME = "trials"
"""Name of the trials summary in a result's `extra`."""
MAX_FAILING = 100
"""Maximum number of trials that a summary names as not passed."""
MAX_CELLS = 200
"""Maximum number of cells of a grid, and of parts of an axis, that a summary counts."""


class TrialRow(Model):
    """Results of one finished trial (one episode of a simulation job), as a row of the trials table."""

    trial: int = Field(ge=0, description="Number of the trial.")
    seed: int = Field(ge=0, description="Seed of the trial.")
    axes: dict[str, Value] = Field(default={}, description="Axis values of the trial, by name.")
    verdict: Verdict = Field(description="PASS, FAIL, ERROR (something broke), or NONE when nothing was judged.")
    reason: str = Field(default="", description="Why the verdict is FAIL or ERROR, in words.")
    failure_code: str | None = optional(
        "Failure code of a trial that broke by an application's exception; absent otherwise."
    )
    ended_by: str | None = optional("As in `result.json`; absent: an exception did.")
    sim_time_s: float = Field(default=0.0, description="Simulated time at the end.")
    wall_time_s: float = Field(default=0.0, description="Wall-clock time spent stepping.")
    steps: int = Field(default=0, description="Steps of the environment.")
    requirements: list[Requirement] = Field(default=[], description="Requirements that the trial was judged by.")
    metrics: dict[str, float] = Field(default={}, description="Numbers by name with unit.")
    notes: list[str] = Field(default=[], description="Lines beside the verdict.")
    state_digest: str | None = optional("Digest of all its states; absent: it has none.")
    model_sha256: str | None = optional("SHA-256 of its compiled model, as in `provenance.json`.")
    looks: int = Field(default=0, description="How many states the digest is of.")
    digest_until_s: float = Field(default=0.0, description="Simulated time of the last of them.")

    @property
    def passed(self) -> bool:
        """Whether the trial needs no attention: it passed, or it had no requirements."""
        return self.verdict in ("PASS", "NONE")

    @property
    def digest(self) -> StateDigestSummary | None:
        """Summary of the hash chain over the trial's simulation states; `None` if the trial has none."""
        if self.state_digest is None:
            return None
        return StateDigestSummary(looks=self.looks, until_s=self.digest_until_s, value=self.state_digest)

    def result(self) -> RunResult:
        """Returns the content of a trial's `result.json`, as far as the row of the table contains it."""
        return RunResult(
            verdict=self.verdict,
            notes=self.notes,
            requirements=self.requirements,
            metrics=self.metrics,
            sim_time_s=self.sim_time_s,
            wall_time_s=self.wall_time_s,
            real_time_factor=self.sim_time_s / self.wall_time_s if self.wall_time_s > 0 else 0.0,
            ended_by=self.ended_by or "",
            seed=self.seed,
            state_digest=self.state_digest,
        )


class FailingTrial(Model):
    """A trial (one episode of a simulation job) that did not pass, with its seed, its axes and the reason."""

    trial: int = Field(description="Number of the trial.")
    seed: int = Field(description="Seed of the trial.")
    axes: dict[str, Value] = Field(default={}, description="Axis values of the trial, by name.")
    verdict: Literal["FAIL", "ERROR"] = Field(description="Verdict: FAIL or ERROR.")
    reason: str = Field(default="", description="Reason of the verdict, as text.")
    recorded: bool = Field(default=False, description="Whether the trial has a folder with a recording.")


class TrialCounts(Model):
    """Numbers of a job's trials by outcome: passed, failed, errored, ...."""

    axes: dict[str, Value] = Field(default={}, description="Cell of the trials; empty: all cells.")
    passed: int = Field(default=0, description="Number of trials with verdict PASS.")
    failed: int = Field(default=0, description="Number of trials with verdict FAIL.")
    errors: int = Field(default=0, description="Number of trials with verdict ERROR.")
    unjudged: int = Field(default=0, description="Number of trials with verdict NONE.")
    copies: int = Field(
        default=0,
        description="Number of trials with verdict PASS or FAIL that went through the same states as an earlier one "
        "and were judged alike.",
    )

    @property
    def total(self) -> int:
        """Number of all trials of a job."""
        return self.passed + self.failed + self.errors + self.unjudged


class AxisCounts(TrialCounts):
    """Numbers of a job's trials by outcome, of those with one value of an axis or with one part of its range."""

    axis: str = Field(description="Name of the axis.")
    part: str = Field(description="Value of the axis, or part of its range, as text.")


class TrialsSummary(Model):
    """Summary of a simulation job's trials: counts, pass rate and the first failing trials."""

    planned: int = Field(description="Number of trials of the job.")
    counts: TrialCounts = Field(description="Number of finished trials by verdict.")
    cells: list[TrialCounts] = Field(
        default=[], description="Numbers of trials by cell of a grid, the first 200 cells; empty without axes."
    )
    axes: list[AxisCounts] = Field(
        default=[],
        description="Numbers of trials by axis and part of it, the first 200 parts of each axis; empty without axes.",
    )
    failing: list[FailingTrial] = Field(default=[], description="First 100 trials that did not pass.")
    recorded: list[int] = Field(default=[], description="Numbers of the trials that have an output folder.")
    stopped_in: int | None = optional("Number of the trial in which the job was stopped; absent: all trials ran.")

    @classmethod
    def of(cls, result: RunResult | None) -> "TrialsSummary | None":
        """Reads the trials summary from a job's result; `None` for a job without trials."""
        found = result.extra.get(SUMMARY_NAME) if result is not None else None
        if found is None:
            return None
        try:
            return cls.model_validate(found)
        except ValidationError:  # an application's own remark of this name
            return None


def judged_of(result: RunResult) -> Judged:
    """Counts the requirements of a run by how they were judged, or where it has trials, these."""
    if (summary := TrialsSummary.of(result)) is not None:
        counts = summary.counts
        return Judged(trials=JudgedCounts(passed=counts.passed, failed=counts.failed, errors=counts.errors))
    found = Counter(_how_judged(each) for each in result.requirements if each.counts)
    return Judged(requirements=JudgedCounts(**found))


def _how_judged(requirement: Requirement) -> str:
    if requirement.error is not None:
        return "errors"
    return "passed" if requirement.satisfied else "failed"


def trial_folder(number: int) -> str:
    """Returns the folder name of a recorded trial's outputs, relative to the job's outputs."""
    return str(PurePosixPath(TRIALS_FOLDER, f"{number:06d}"))


def plan_of_trial(plan: RunPlan, trial: Trial) -> RunPlan:
    """Makes the run plan of a single trial from its job's plan, with the trial's seed and the values of its axes.

    Args:
        plan: Plan of the job.
        trial: One of the job's trials.
    """
    changes: dict[str, object] = {"seed": trial.seed, "trials": None, "trial": trial.number}
    axes = (plan.trials.axes if plan.trials else None) or {}
    changes["axes"] = {
        name: AxisSetting(kind=axes[name].kind, value=value)
        for name, value in trial.axes.items()
        if not isinstance(value, str)
    }
    if trial.variables:
        changes["environment"] = {**plan.environment, **trial.variables}
        for name in ("simulation_application", "robot_application"):
            application = getattr(plan, name)
            if application is not None:
                variables = {**application.environment_variables, **trial.variables}
                changes[name] = application.model_copy(update={"environment_variables": variables})
    return plan.model_copy(update=changes)


def fails_besides(result: RunResult | None) -> bool:
    """Returns whether a job failed for more than requirements that it missed.

    The environment may have a verdict of its own, or trials may have broken, be missing, or have no verdict.

    Args:
        result: The job's result; None: it has none.
    """
    trials = TrialsSummary.of(result)
    was_judged = trials is None or trials.planned == trials.counts.passed + trials.counts.failed
    return result is not None and result.verdict == "FAIL" and (ENVIRONMENT_VERDICT in result.extra or not was_judged)
