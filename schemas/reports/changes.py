"""Changes from one run of a specification to the next, and the run since which a job fails."""

from datetime import datetime
from typing import Literal

from pydantic import Field

from ..runs.axes import trial_in_words
from ..runs.axis_kinds.kind import Value
from ..wire.base import Model, optional
from .run_record import CaseOutcome


class CellName(Model):
    """Identity of a simulation job across repeated runs of a specification: step, world, robot, variables and seed.

    It is a row in the table of jobs on the history page.
    """

    step: str = Field(default="", description="Step that created the job.")
    name: str = Field(default="", description="Name for people, unique in its run: `scout in flat 3`; empty: none.")
    test: str = Field(description="World or number of the request, and application: `world-1 scout`.")
    world: str | None = optional("Name of the job's world in its run.")
    seed: int | None = optional("Seed of the job, if the request gives one.")
    variant: str = Field(
        default="", description="Settings of its request that not all jobs of its run have: `SPEED=2`."
    )

    @property
    def title(self) -> str:
        """The job's whole name in words: `drive: scout in flat 3, SPEED=2, seed 7`."""
        name, variant = (self.name, "") if self.name else (self.test, self.variant)
        parts = [f"{self.step}: {name}" if self.step else name, variant]
        if self.seed is not None and "seed=" not in "".join(parts):
            parts.append(f"seed {self.seed}")
        return ", ".join(part for part in parts if part)


class ChangedInput(Model):
    """An input of a job that changed between the last run in which the job passed and the failure after it."""

    what: Literal["commit", "parameter", "application", "version", "request", "requirements"] = Field(
        description="Kind of input; `request`: all that is asked for beside requirements."
    )
    name: str = Field(default="", description="Name of the parameter, application or package.")
    before: str | None = optional("Commit, value, digest or version before; absent: unknown.")
    after: str | None = optional("Commit, value, digest or version after; absent: unknown.")


class FailureStart(Model):
    """The run since which a job fails or breaks, with the last run before it in which the job passed."""

    run_id: str = Field(description="Id of the first run in which the job failed or broke.")
    started_at: datetime = Field(description="Start of that run, UTC.")
    nights: int = Field(description="Runs since then in which it failed or broke, that one included.")
    broke: int = Field(default=0, description="Runs among them in which it broke.")
    last_passed_run_id: str | None = optional(
        "Last run before in which it passed; absent: it never did in the runs looked at."
    )
    changed: list[ChangedInput] = Field(default=[], description="Inputs that changed between those two runs.")


class PairedTrial(Model):
    """A trial that two runs have, or a job without trials, by its name and by its number in each run."""

    cell: CellName = Field(description="Name of the job.")
    job: str = Field(description="Id of the job in the second run.")
    trial: int | None = optional("Number of the trial; absent: the job has no trials.")
    axes: dict[str, Value] = Field(
        default={}, description="Values of the trial's own axes by name; empty: it has none, or the job has no trials."
    )
    before_job: str | None = optional("Id of the job in the first run; absent: an earlier release wrote this.")
    before_trial: int | None = optional("Number of the same trial in the first run; absent: the job has no trials.")

    @property
    def title(self) -> str:
        """Name of job and trial: `drive: scout in flat 3, friction 0.4 (trial 17)`."""
        return self.cell.title if self.trial is None else f"{self.cell.title}, {self.trial_title}"

    @property
    def trial_title(self) -> str:
        """Name of the trial alone: `friction 0.4 (trial 17)`; empty for a job without trials."""
        return "" if self.trial is None else trial_in_words(self.trial, self.axes)


class NewlyMissed(PairedTrial):
    """A trial that misses a requirement which it met in the run before."""

    detail: str = Field(default="", description="Measured and required value, as text.")
    certain: bool = Field(
        description="Whether nothing that is recorded differs by chance: same world, same seed, and programs that the "
        "simulation waited for. A program may draw numbers of its own; `robomaker flaky` tells."
    )
    changed: list[ChangedInput] = Field(
        default=[],
        description="Packages and applications of the job that changed since, and its request if that did.",
    )


class RequirementChange(Model):
    """A requirement that some trials of a job newly miss, or newly meet, since the run before."""

    name: str = Field(description="The requirement.")
    pairs: int = Field(description="Trials in which it was judged both times.")
    newly_missed: int = Field(description="How many of them met it before, and miss it now.")
    newly_met: int = Field(description="How many of them missed it before, and meet it now.")
    places: list[NewlyMissed] = Field(
        default=[], description="Those that newly miss it, at most 10, one of each job before a second of any."
    )


class LargestFall(PairedTrial):
    """The pair of trials in which a margin fell most."""

    before: float = Field(description="Margin in the first run.")
    after: float = Field(description="Margin in the second run.")


class MetricChange(Model):
    """Change of one metric, or of a requirement's margin, over the trials that ended in both runs."""

    name: str = Field(description="The metric, with its unit; of a margin, the requirement.")
    unit: str | None = optional("Unit of a margin; absent: it has none, or it is a metric.")
    pairs: int = Field(description="Number of pairs with the metric.")
    before: float = Field(description="Mean in the first run.")
    after: float = Field(description="Mean in the second run.")
    difference: float = Field(description="Mean of `after - before`.")
    low: float | None = optional("Lower end of the confidence interval; absent with fewer than 2 pairs.")
    high: float | None = optional("Upper end of the confidence interval.")
    changed: bool = Field(description="Whether the interval leaves out 0.")
    fell: int = Field(default=0, description="Number of pairs in which it fell, as far as four digits show.")
    rose: int = Field(default=0, description="Number of pairs in which it rose.")
    largest_fall: LargestFall | None = optional(
        "The pair in which a margin fell most; absent: it fell in none, or is a metric."
    )

    @property
    def has_fallen(self) -> bool:
        """Whether the mean fell, by more than rounding, in some pair."""
        return self.fell > 0 and self.difference < 0


class CellChange(Model):
    """A job that fails in the last run, or that stopped failing in it."""

    cell: CellName = Field(description="Name of the job.")
    job: str = Field(description="Id of the job in the last run.")
    outcome: CaseOutcome = Field(description="Outcome of the job in the last run.")
    reason: str = Field(default="", description="Reason why the job does not pass.")
    known: str = Field(
        default="", description="Owner, last day and reason of its failure if that is known; else empty."
    )
    since: FailureStart | None = optional("Run since which the job fails; absent: it passes.")
    newly_missed: list[str] = Field(
        default=[], description="Requirements that it met when it ran last, and misses now: another way of failing."
    )


class Loss(Model):
    """A simulation job that is missing from a run, or is judged by fewer requirements than in an earlier run."""

    cell: CellName = Field(description="Name of the job.")
    job: str = Field(description="Id of the job in the last run that has it.")
    before: CaseOutcome = Field(description="Its outcome when it was last judged, or last ran.")
    before_run_id: str = Field(description="Id of the run with that outcome.")
    requirements: list[str] = Field(default=[], description="Names of requirements that counted then, and not now.")
    trials_before: int | None = optional("Number of counted trials before.")
    trials_now: int | None = optional("Number of counted trials now, if there are fewer.")
    causes: list[str] = Field(
        default=[],
        description="Differences between the two runs that leave the job or the trials out, in words, such as `2 "
        "seeds instead of 20 (parameter seeds)`; empty: not known.",
    )


class Losses(Model):
    """Jobs and requirements that a run lacks against earlier runs: passing with fewer checks is no improvement."""

    gone: list[Loss] = Field(
        default=[], description="Jobs that an earlier run has, and this one lacks without a new job in their place."
    )
    no_longer_judged: list[Loss] = Field(
        default=[], description="Jobs that had a verdict when they were last looked at, and have none now."
    )
    asked_less: list[Loss] = Field(
        default=[], description="Jobs that have a verdict, and of which some requirement is not asked any more."
    )
    fewer_trials: list[Loss] = Field(default=[], description="Jobs that fewer trials were counted of than before.")

    @property
    def has_losses(self) -> bool:
        """Whether this run checks less than earlier runs did.

        A job of an earlier run is missing or has no verdict, or is judged by fewer requirements or fewer trials.
        """
        return bool(self.gone or self.no_longer_judged or self.asked_less or self.fewer_trials)


class MarginTrend(Model):
    """A requirement that is met, and whose smallest margin shrinks steadily from night to night."""

    name: str = Field(description="The requirement.")
    unit: str | None = optional("Unit of the margins; absent: they have none.")
    margins: list[float] = Field(
        description="Smallest margin of each night that the line is fitted through, the last at the end."
    )
    slope: float = Field(description="Change of the margin from night to night by the line, below 0.")
    nights_left: float = Field(description="Nights from the last one until the line reaches 0.")


class SinceLastRun(Losses):
    """Differences of a run from the run before, which a nightly report shows first."""

    previous_run_id: str | None = optional("The run before; absent: this is the first.")
    previous_started_at: datetime | None = optional("Start of that run, UTC.")
    paired: int = Field(default=0, description="Jobs that an earlier run has a result of.")
    unpaired: int = Field(default=0, description="Jobs that no earlier run has a result of.")
    without_result: int = Field(
        default=0, description="Jobs of this run that ended with neither verdict nor error, such as canceled ones."
    )
    other_requirements: int = Field(
        default=0,
        description="Jobs that were judged by other requirements than when they ran last; those in `asked_less` are "
        "not counted again.",
    )
    requirements: list[RequirementChange] = Field(
        default=[], description="Requirements that trials newly miss, the most frequent first, or newly meet."
    )
    margins: list[MetricChange] = Field(
        default=[],
        description="Margins of requirements that fell on average since the run before, by more than chance.",
    )
    shrinking: list[MarginTrend] = Field(
        default=[], description="Requirements that are met with margins that shrink steadily, the soonest miss first."
    )
    newly_failing: list[CellChange] = Field(
        default=[], description="Jobs that passed in their last run, and do not pass now."
    )
    newly_passing: list[CellChange] = Field(
        default=[], description="Jobs that did not pass in their last run, and pass now."
    )
    still_failing: list[CellChange] = Field(
        default=[], description="Jobs that passed neither in their last run nor now."
    )
    first_failing: list[CellChange] = Field(default=[], description="Jobs that fail and have no earlier result.")
