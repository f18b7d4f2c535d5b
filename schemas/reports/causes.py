"""Groups of the failures of a run, and what each goes with: the part of a report that says why."""

from typing import Literal

from pydantic import Field

from ..wire.base import Model, optional

NO_REQUIREMENT = "verdict"
"""Stands for the requirement of a trial that failed without missing one: by the verdict of its environment."""

ClaimKind = Literal["axis", "pair", "triple", "world"]


class Claim(Model):
    """A region of an axis, of two or three together, or a world, in which failures gather by more than chance."""

    kind: ClaimKind = Field(description="Kind of what is claimed.")
    axes: list[str] = Field(default=[], description="Names of the axes; empty for a world.")
    region: str = Field(description="Region in words, such as `noise ≥ 0.021 and SPEED = fast`.")
    failed_inside: int = Field(description="Failures of the group in the region.")
    trials_inside: int = Field(description="Trials in the region that passed or belong to the group.")
    failed_outside: int = Field(description="Failures of the group outside.")
    trials_outside: int = Field(description="Trials outside that passed or belong to the group.")
    lift: float = Field(description="Failure rate inside divided by that outside, within the same jobs.")
    low: float = Field(description="Lower end of the lift's 95 % interval.")
    high: float = Field(description="Upper end of it.")
    p_value: float = Field(description="P-value, corrected by Holm for all that was tested in the run.")
    scope: Literal["such worlds", "these worlds only"] = Field(
        description="Worlds that it holds for: with fewer than six, the run's own only."
    )
    alike: list[str] = Field(
        default=[], description="Regions of other axes with nearly the same trials, which may be the cause as well."
    )
    failed_otherwise: int = Field(
        default=0,
        description="Counted trials that missed another requirement first: those that met this one count as passed "
        "where nearly no trial passed; 0 where enough did.",
    )

    @property
    def numbers(self) -> str:
        """Counts, lift and interval, to follow the region's name in a sentence.

        An example: `9 of 10, elsewhere 3 of 30: 9.0 times as often (95 %: 3.1 to 26.4), in all jobs`.
        """
        also = f"; {' and '.join(self.alike)} has nearly the same trials" if self.alike else ""
        if self.failed_otherwise:
            also += f"; {self.failed_otherwise} that failed otherwise are compared, too, as nearly none passed"
        return (
            f"{self.failed_inside} of {self.trials_inside}, elsewhere {self.failed_outside} of {self.trials_outside}: "
            f"{self.lift:.1f} times as often (95 %: {self.low:.1f} to {self.high:.1f}), in {self.scope}{also}"
        )


class FailureGroup(Model):
    """Failures that are alike: same requirement, room, thing, phase and, where one is claimed, region of the axes."""

    requirement: str = Field(description="Requirement that was missed first.")
    room: str | None = optional("Room that the robot was in then; absent: they differ, or it is not known.")
    other: str | None = optional("Kind of thing that it touched or was too near to; absent: they differ.")
    phase: str | None = optional("Last goal reached before, such as `after kitchen`; absent: they differ.")
    failed: int = Field(description="Number of trials that failed so.")
    claims: list[Claim] = Field(default=[], description="Causes that are claimed, the strongest first.")
    job: str = Field(description="Job of an example, in the first claim's region where there is one.")
    trial: int | None = optional("Number of the example's trial; absent: the job has no trials.")
    clip: str | None = optional("Address of the example's outputs, with its recording and video; absent: none is kept.")
    command: str = Field(description="Command that runs the example again.")
    refused: str = Field(
        default="", description="Why nothing could be claimed of it, and what would do; empty: it could."
    )

    @property
    def name(self) -> str:
        """The group as a part of a sentence: `polite, in Kitchen, at chair, after to-kitchen`."""
        parts = [self.requirement, self.room and f"in {self.room}", self.other and f"at {self.other}", self.phase]
        return ", ".join(part for part in parts if part)

    @property
    def nothing(self) -> str:
        """Sentence for a group without a claim (a region of the axes, or a world, that explains its failures)."""
        return self.refused or "no axis and no world explains it"

    @property
    def in_words(self) -> str:
        """The group in one line, with its strongest claim: the region of an axis where it fails most.

        It reads `polite, in Kitchen: 12 trials missed it first; REGION: NUMBERS`, or ends with the reason why no region
        explains it. Trials that missed another requirement before are in that one's group.
        """
        count = f"{self.failed} {'trial' if self.failed == 1 else 'trials'}"
        count += " failed by it" if self.requirement == NO_REQUIREMENT else " missed it first"
        said = f"{self.claims[0].region}: {self.claims[0].numbers}" if self.claims else self.nothing
        return f"{self.name}: {count}; {said}"


class TestedLift(Model):
    """Lift of the best region of an axis, or of two or three together, in a group, claimed or not."""

    group: str = Field(description="Group of failures.")
    axes: list[str] = Field(description="Names of the axes.")
    region: str = Field(description="Region with most failures beyond those expected.")
    lift: float = Field(description="Failure rate inside divided by that outside, within the same jobs.")
    low: float = Field(description="Lower end of its 95 % interval.")
    high: float = Field(description="Upper end of it.")
    p_value: float = Field(description="P-value, corrected by Holm for all that was tested in the run.")


class Sensitivity(Model):
    """Change of a requirement's margin along an axis of numbers."""

    requirement: str = Field(description="The requirement.")
    axis: str = Field(description="The axis.")
    unit: str | None = optional("Unit of the margin.")
    start: float = Field(description="Value of the axis that a tenth of the trials are below.")
    end: float = Field(description="Value of the axis that a tenth of the trials are above.")
    change: float = Field(description="Change of the mean margin from `start` to `end`, along a straight line.")
    low: float = Field(description="Lower end of its interval; all intervals of a run hold together with 95 %.")
    high: float = Field(description="Upper end of it.")

    @property
    def is_shown(self) -> bool:
        """Whether the change of the margin is shown: its interval does not contain 0."""
        return self.low > 0 or self.high < 0


class Effect(Model):
    """Dependence of one outcome, the share of failures or a margin, on an axis; or the reason why it is not known."""

    on: str = Field(description="Requirement whose margin it is; empty: the share of trials that fail.")
    unit: str | None = optional("Unit of the margin.")
    value: str = Field(default="", description="Value of an axis of texts, against all others; empty: of numbers.")
    start: float = Field(default=0.0, description="Value of the axis that a tenth of the trials are below.")
    end: float = Field(default=0.0, description="Value of the axis that a tenth of the trials are above.")
    change: float = Field(default=0.0, description="Change from `start` to `end`, along a straight line.")
    low: float = Field(default=0.0, description="Lower end of its interval; all of a run hold together with 95 %.")
    high: float = Field(default=0.0, description="Upper end of it.")
    refused: str = Field(default="", description="Why there is no interval; empty: there is one.")

    @property
    def is_shown(self) -> bool:
        """Whether a dependence is shown: there is an interval, and it does not contain 0."""
        return not self.refused and (self.low > 0 or self.high < 0)

    @property
    def outcome(self) -> str:
        """Name of the outcome: `failures` or `margin of polite`."""
        return f"margin of {self.on}" if self.on else "failures"

    @property
    def in_words(self) -> str:
        """The change with its interval: `failures +12 points (+3 to +21) from 0.8 to 1.3`; or why there is none."""
        if self.refused:
            return f"{self.outcome}: {self.refused}"
        unit = (f" {self.unit}" if self.unit else "") if self.on else " points"
        scale = 1 if self.on else 100
        change, low, high = (f"{scale * each:+.3g}" for each in (self.change, self.low, self.high))
        where = f"with {self.value}" if self.value else f"from {self.start:.4g} to {self.end:.4g}"
        return f"{self.outcome} {change}{unit} ({low} to {high}) {where}"


class AxisEffects(Model):
    """Effects of one axis of a run on failures and on margins of requirements."""

    axis: str = Field(description="The axis.")
    idle: bool = Field(
        default=False, description="Whether trials that differ in it alone went through the same states."
    )
    effects: list[Effect] = Field(default=[], description="Failures first, then margins by requirement.")

    @property
    def answer(self) -> str:
        """Says what it changes: `changes failures, margin of polite`, `changes nothing` or `no effect shown`."""
        if self.idle:
            return "changes nothing: trials that differ in it alone went through the same states"
        shown = [each.outcome for each in self.effects if each.is_shown]
        return f"changes {', '.join(shown)}" if shown else "no effect shown"

    @property
    def told(self) -> list[str]:
        """The shown effects in words; where there are none, all of them, whose intervals say how large they may be."""
        return [each.in_words for each in self.effects if each.is_shown] or [each.in_words for each in self.effects]


class MarginPlot(Model):
    """Margins by which trials met or missed a requirement, by the value of an axis, for a drawing."""

    requirement: str = Field(description="The requirement.")
    axis: str = Field(description="The axis.")
    unit: str | None = optional("Unit of the margin.")
    points: list[tuple[float, float]] = Field(description="Value of the axis and margin, of at most 200 trials.")
    parts: list[tuple[float, float, float, float, float]] = Field(
        description="Parts of the axis: least and largest value, and the margins below which 10, 50 and 90 % lie."
    )


class PlotCell(Model):
    """Failure rate of a group of failures in a part of an axis, or of two axes, with its interval."""

    part: str = Field(description="Part of the first axis, in words.")
    other_part: str = Field(default="", description="Part of the second axis; empty: there is none.")
    failed: int = Field(description="Failures of the group.")
    trials: int = Field(description="Trials that passed or belong to the group.")
    rate: float = Field(description="Failures of a trial.")
    low: float = Field(description="Lower end of the rate's 95 % interval, between worlds where there are six or more.")
    high: float = Field(description="Upper end of it.")


class CellPlot(Model):
    """Failure rates of a group over an axis, or over two, for a drawing."""

    group: str = Field(description="Group of failures, with the region of a third axis that the trials are in.")
    axes: list[str] = Field(description="One axis, or two.")
    cells: list[PlotCell] = Field(description="Its cells, those of the first axis' first part first.")


class Why(Model):
    """Failures of a run in groups, with what they go with."""

    trials: int = Field(description="Number of trials that passed or failed; others say nothing of the robot.")
    failed: int = Field(description="Number of trials that failed.")
    groups: list[FailureGroup] = Field(
        default=[], description="Groups, the largest first; a failure is in one of them."
    )
    lifts: list[TestedLift] = Field(default=[], description="All axes that were tested, alone, in pairs and by three.")
    sensitivities: list[Sensitivity] = Field(default=[], description="Changes of margins along axes.")
    margin_plots: list[MarginPlot] = Field(default=[], description="Margins over axes, at most six.")
    cell_plots: list[CellPlot] = Field(default=[], description="Failure rates over claimed axes, at most six.")
    refused: list[str] = Field(default=[], description="Sentences about what cannot be told, with what would do.")
