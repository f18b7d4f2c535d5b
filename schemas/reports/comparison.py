"""Comparison of two runs, as `robomaker compare -o json` prints it."""

from datetime import datetime
from typing import Any, Literal

from pydantic import Field

from ..runs.requirement_kinds.kind import Requirement
from ..wire.base import Model, optional
from ..wire.common import counted
from .changes import CellName, ChangedInput, Losses, MetricChange, RequirementChange
from .live_comparison import Answer
from .run_record import CaseOutcome, SourceCommit

TOO_FEW_PAIRS = "too few pairs to tell"
"""Words for "no difference shown" where the interval of the difference includes one that matters."""
USUAL_DIFFERENCE = 0.1
"""Difference of pass rates that matters where none is asked for, a share from 0 to 1."""


class ComparedRun(Model):
    """Identity of one of the two runs of a comparison: its id, specification and time."""

    run_id: str = Field(description="Id of the run.")
    name: str = Field(description="Name of the run's specification.")
    started_at: datetime = Field(description="Begin of the run, UTC.")
    jobs: int = Field(description="Number of jobs in the run.")
    parameters: dict[str, Any] = Field(default={}, description="Values of its specification's parameters.")
    source: SourceCommit | None = optional("Commit of its specification; absent: none known.")


class PairedJob(Model):
    """A simulation job that both runs of a comparison have, with its outcome in each."""

    cell: CellName = Field(description="Name of the job.")
    before: CaseOutcome = Field(description="Outcome in the first run.")
    after: CaseOutcome = Field(description="Outcome in the second run.")
    before_job: str = Field(description="Id of the job in the first run.")
    after_job: str = Field(description="Id of the job in the second run.")
    reason: str = Field(default="", description="Reason why the job did not pass, from the run in which it did not.")
    newly_missed: list[str] = Field(default=[], description="Requirements that it met before, and misses after.")


RequirementTurn = Literal["better", "worse", "unchanged", "not comparable"]
"""Change of one requirement of a job from one run to another."""


class RequirementBeside(Model):
    """A requirement of two paired jobs, with its outcome in each and what changed."""

    name: str = Field(description="The requirement.")
    before: Requirement | None = optional("Its outcome in the first job; absent: that job's result has none.")
    after: Requirement | None = optional("Its outcome in the second job; absent: that job's result has none.")
    turn: RequirementTurn = Field(description="Whether the second job meets it better than the first.")
    why: str = Field(default="", description="Change of the margin, or the reason why nothing can be said, as text.")


Test = Literal["exact McNemar", "sign flip of worlds"]


MarginOutcome = Literal["shown", "not shown"]


class MarginTest(Model):
    """Test of whether the pass rate fell by less than a requested margin."""

    margin: float = Field(description="The fall of the pass rate that would matter, a share from 0 to 1.")
    outcome: MarginOutcome = Field(description="Whether a fall by less than that is shown.")
    test: Literal["Tango's score", "interval between worlds"] = Field(
        description="The test that decides, one-sided at half of alpha: where whole worlds are flipped, the lower end "
        "of the interval has to be above the margin."
    )
    p_value: float | None = optional("One-sided p-value of Tango's test.")


class RateChange(Model):
    """Pass rates of two runs over the trials that were judged in both, with a test of the difference.

    A job without trials counts as one trial.
    """

    pairs: int = Field(description="Number of judged pairs.")
    worlds: int = Field(description="Number of worlds of the pairs; jobs without a world count as one.")
    before: float = Field(description="Share of the pairs that passed in the first run.")
    after: float = Field(description="Share of the pairs that passed in the second run.")
    difference: float = Field(description="`after - before`.")
    low: float = Field(
        description="Lower end of the difference's interval: by Newcombe's method 10, or where whole worlds are "
        "flipped by the spread between worlds."
    )
    high: float = Field(description="Upper end of the confidence interval.")
    test: Test = Field(
        description="The test that decides. Trials of one world are alike: where six worlds or more have several, "
        "whole worlds are flipped."
    )
    p_value: float = Field(description="Two-sided p-value of the deciding test.")
    margin: MarginTest | None = optional("Present where a margin is asked for.")

    def leaves_open(self, difference: float = USUAL_DIFFERENCE) -> bool:
        """Returns whether the interval includes differences larger than one that matters, of either sign.

        Args:
            difference: The difference that matters, a share from 0 to 1.
        """
        return max(-self.low, self.high) > difference


class NeededPairs(Model):
    """Number of trial pairs needed to answer a question about pass rates, by the power of the deciding test."""

    difference: float = Field(
        description="Difference of the pass rates that is to be shown, positive; with a margin, the fall that is to be "
        "excluded."
    )
    basis: Literal["asked for", "as found", "10 points", "margin"] = Field(
        description="Source of that difference: an option, what the pairs showed, what is taken where they showed "
        "none, or the margin that was asked for, where nothing changed in truth."
    )
    discordant: float = Field(description="Share of pairs that differ, as expected from those there are.")
    power: float = Field(description="Probability with which it would be shown.")
    pairs: int = Field(description="Pairs needed in all.")
    more: int = Field(description="How many more than there are.")
    worlds: int | None = optional("Worlds needed in all, where whole worlds are flipped, with as many trials as now.")
    assumed: list[str] = Field(default=[], description="Assumptions behind the number, in words.")


class PlannedPairs(NeededPairs):
    """Number of pairs that the next two runs of a specification need to answer a question, and the number they have."""

    test: Test | Literal["Tango's score", "interval between worlds", "e-process"] = Field(
        description="The test that will decide."
    )
    median: int | None = optional(
        "Pairs after which half of the runs beside an earlier one are decided; absent: it is no such run."
    )
    planned: int | None = optional("Pairs of trials that two runs of the specification have; absent: a run tells.")
    smallest: float | None = optional(
        "Smallest difference, or margin, that the planned pairs answer with the same power; absent: none, or not known."
    )
    wall_time_s: float | None = optional("Wall-clock time of one run with so many trials; absent: not probed.")
    cost: float | None = optional("Cost of one such run; absent: not probed, or no price is given.")


class AxisPairs(Model):
    """Number of pairs in which the first value of a step's axis will be compared with each other one."""

    step: str = Field(description="The step.")
    axis: str = Field(description="The axis.")
    pairs: int = Field(description="Pairs of trials that differ in the axis alone; where whole worlds decide, worlds.")
    least: int = Field(description="Fewest that can show a difference, if all of them differ the same way.")
    of_worlds: bool = Field(description="Whether whole worlds decide.")


class Comparison(Losses):
    """Comparison of two runs of a specification, job by job."""

    schema_version: Literal[1] = Field(default=1, description="Version of this document's form.")
    before: ComparedRun = Field(description="The first run.")
    after: ComparedRun = Field(description="The second run.")
    answer: Answer = Field(description="Whether the second run is better or worse by its verdicts.")
    exit_code: int = Field(description="Exit code of the command line, `ANSWER_EXIT_CODES[answer]`.")
    why: str = Field(description="Reason of the answer, as text.")
    alpha: float = Field(description="Error probability of the test, and of the intervals of all metrics together.")
    changed: list[ChangedInput] = Field(
        default=[],
        description="Inputs that differ: the specification's commit, its parameters, packages, applications, requests.",
    )
    pairs: int = Field(description="Jobs that both runs have.")
    only_before: int = Field(description="Jobs that only the first run has.")
    only_after: int = Field(description="Jobs that only the second run has.")
    unjudged: int = Field(
        description="Pairs of trials of which one has no verdict: it broke, was canceled or was not judged."
    )
    other_requirements: int = Field(description="Pairs that were judged by different requirements; they do not count.")
    other_requests: int = Field(description="Pairs whose requests differ in more than seed, tags and ARNs.")
    trials: int = Field(description="Trials that both runs have, of these jobs; a job without trials is one.")
    identical: int = Field(
        default=0, description="Judged pairs of trials that went through the same states in both runs, bit by bit."
    )
    trials_only_before: int = Field(description="Trials that only the first run has.")
    trials_only_after: int = Field(description="Trials that only the second run has.")
    troubles: list[str] = Field(default=[], description="Tables of results that cannot be read, and what mends them.")
    requirements: list[RequirementChange] = Field(
        default=[], description="Requirements that trials newly miss, the most frequent first, or newly meet."
    )
    newly_failing: list[PairedJob] = Field(description="Jobs that passed before, and failed or broke after.")
    newly_passing: list[PairedJob] = Field(description="Jobs that failed or broke before, and passed after.")
    still_failing: list[PairedJob] = Field(description="Jobs that failed or broke in both runs.")
    rate: RateChange | None = optional(
        "Pass rates; absent when no pair was judged in both, or the second run was looked at while it ran."
    )
    e_values: dict[str, float] = Field(
        default={}, description="Evidence by answer, of a second run that was carried out with `--against` the first."
    )
    needed: NeededPairs | None = optional("Present when no difference was shown.")
    metrics: list[MetricChange] = Field(description="Metrics, those that changed first.")
    margins: list[MetricChange] = Field(
        default=[], description="Margins of requirements, those that moved first; an interval holds for all of them."
    )

    @property
    def is_open(self) -> bool:
        """Whether no difference is shown only since the pairs are too few: they leave open one that matters."""
        if self.answer != "no difference shown" or self.rate is None or self.is_unchanged:
            return False
        asked = self.needed is not None and self.needed.basis in ("asked for", "margin")
        return self.rate.leaves_open(self.needed.difference if self.needed and asked else USUAL_DIFFERENCE)

    @property
    def is_unchanged(self) -> bool:
        """Whether each pair was judged alike and went through the same states, so that nothing changed."""
        is_else = self.newly_failing or self.newly_passing or self.unjudged or self.other_requirements
        return self.rate is not None and self.identical == self.rate.pairs and not is_else

    @property
    def answer_in_words(self) -> str:
        """The answer as it is told: `too few pairs to tell` where no difference is shown, and a large one is open."""
        if self.answer == "no difference shown" and self.is_unchanged:
            return "nothing changed"
        return TOO_FEW_PAIRS if self.is_open else self.answer

    @property
    def turned_in_words(self) -> str:
        """Jobs that turned, which are facts although they do not show that pass rates differ; empty: there are none.

        An example: `3 of 6 jobs newly fail, and none newly passes`.
        """
        failing, passing = len(self.newly_failing), len(self.newly_passing)
        if self.answer != "no difference shown" or not failing + passing:
            return ""
        jobs = counted(self.pairs, "job")
        if not failing:
            return f"{passing} of {jobs} newly {'passes' if passing == 1 else 'pass'}, and none newly fails"
        others = f"{passing or 'none'} newly {'pass' if passing > 1 else 'passes'}"
        return f"{failing} of {jobs} newly {'fails' if failing == 1 else 'fail'}, and {others}"

    @property
    def order_in_words(self) -> str:
        """Note that the runs were named in reverse, the newer one first; empty: they were not."""
        if self.before.started_at <= self.after.started_at:
            return ""
        return f"A, {self.before.run_id}, is the newer run: what changed since is told backwards"

    def told_of(self, before: str, after: str) -> str:
        """Says how often the second run passes beside the first one, without the answer and a full stop.

        Args:
            before: Name of the first run in the sentence.
            after: Name of the second run.
        """
        if self.answer == "not comparable":
            return f"{after} with {before}"
        if self.answer == "not worse":
            margin = self.rate and self.rate.margin
            fall = f" by {100 * margin.margin:.3g} points or more" if margin else " by as much as asked"
            return f"the pass rate of {after} did not fall{fall} below that of {before}"
        if self.answer != "no difference shown":
            often = "more" if self.answer == "better" else "less"
            return f"{after} passes {often} often than {before}, by more than chance"
        if self.is_unchanged:
            pairs = "the only pair" if self.identical == 1 else f"each of {self.identical} pairs"
            return f"{pairs} of {before} and {after} went through the same states, bit by bit"
        if self.rate is None:
            return f"it is open whether {after} passes more or less often than {before}"
        if self.rate.difference:
            often = "more" if self.rate.difference > 0 else "less"
            return f"{after} passes {often} often than {before}, but chance alone may do that"
        points = 100 * max(-self.rate.low, self.rate.high)
        open_ = f", and a difference of {points:.3g} points is not excluded" if self.is_open else ""
        return f"{after} passes as often as {before}{open_}"
