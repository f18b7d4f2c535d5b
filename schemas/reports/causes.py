"""Groups of the failures of a run, and what each goes with: the part of a report that says why."""

import shlex
from typing import Any, Literal

from pydantic import Field

from ..wire.base import Model, optional
from ..wire.common import counted

NO_REQUIREMENT = "verdict"
"""Stands for the requirement of a trial that failed without missing one: by the verdict of its environment."""

NOT_LOOKED_FOR = "no cause was looked for"
"""Reason why nothing is claimed of a group where nothing may be: there it is told of the run, and not of each group."""

_MOST_LISTED = 5
"""Kinds of things, or requirements, that are listed by name with their numbers of failures."""

_LARGE_EFFECT = 0.2
"""Change of the share of failures above which an effect is large: about there a reader would look for a cause."""

ClaimKind = Literal["axis", "pair", "triple", "world", "worlds"]


class Claim(Model):
    """A region of axes, a world, or worlds of a kind, in which failures gather by more than chance."""

    kind: ClaimKind = Field(description="Kind of what is claimed.")
    axes: list[str] = Field(default=[], description="Names of the axes; empty for worlds.")
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
    def counts(self) -> str:
        """Failures and trials in the region and outside: `9 of 10, elsewhere 3 of 30`."""
        return f"{self.failed_inside} of {self.trials_inside}, elsewhere {self.failed_outside} of {self.trials_outside}"

    @property
    def numbers(self) -> str:
        """Counts, lift and interval, to follow the region's name in a sentence.

        An example: `9 of 10, elsewhere 3 of 30: 9.0 times as often (95 %: 3.1 to 26.4), in all jobs`.
        """
        if not self.failed_outside:
            return f"{self._inside()} failed; {self._outside}"
        return f"{self.counts}: {self._outside}"

    def sentence(self, noun: str, verb: str) -> str:
        """Tells it in one sentence: `with slip = 0.6, all 12 jobs failed; elsewhere none of 30 did, in such worlds`.

        Args:
            noun: Noun of the trials: `job` or `trial`.
            verb: Verb of the failures: `failed` or `missed polite, in Kitchen`.
        """
        where = "in" if self.kind in ("world", "worlds") else "with"
        told = f"{where} {self.region}, {self._inside(noun)} {verb}; "
        if self.failed_outside:
            told += f"elsewhere {self.failed_outside} of {self.trials_outside} did: "
        return told + self._outside

    def _inside(self, noun: str = "") -> str:
        """Failures and trials in the region: `9 of 10 trials`, or `all 10 trials`."""
        trials = counted(self.trials_inside, noun) if noun else str(self.trials_inside)
        return f"all {trials}" if self.failed_inside == self.trials_inside else f"{self.failed_inside} of {trials}"

    @property
    def _outside(self) -> str:
        """Lift with its interval; of a region outside which nothing failed it has no size, so that it is not told."""
        also = f"; {' and '.join(self.alike)} has nearly the same trials" if self.alike else ""
        if self.failed_otherwise:
            also += f"; {self.failed_otherwise} that failed otherwise are compared, too, as nearly none passed"
        lift = f"{self.lift:.1f} times as often (95 %: {self.low:.1f} to {self.high:.1f})"
        if not self.failed_outside:
            lift = f"elsewhere none of {self.trials_outside} did"
        return f"{lift}, in {self.scope}{also}"


class NeededUnits(Model):
    """Number of seeds, points or worlds with which a cause would be told."""

    what: Literal["seeds", "points", "worlds"] = Field(description="Member that makes too few trials.")
    now: int = Field(description="How many of them there are.")
    needed: int = Field(description="How many would do.")

    @classmethod
    def of(cls, what: str, now: int, needed: int) -> "NeededUnits":
        """Makes it from the singular `seed`, `point` or `world`."""
        return cls.model_validate({"what": f"{what}s", "now": now, "needed": needed})


class FailureGroup(Model):
    """Failures that are alike: same requirement, room, thing, phase and, where one is claimed, region of the axes."""

    requirement: str = Field(description="Requirement that was missed first; empty: all failures of the run.")
    room: str | None = optional("Room that the robot was in then; absent: they differ, or it is not known.")
    other: str | None = optional("Kind of thing that it touched or was too near to; absent: they differ.")
    phase: str | None = optional("Last goal reached before, such as `after kitchen`; absent: they differ.")
    failed: int = Field(description="Number of trials that failed so.")
    copies: int = Field(
        default=0,
        description="Further failures that are copies of others and do not count, where the run has one group only.",
    )
    breakdown: dict[str, dict[str, int]] = Field(
        default={},
        description="Numbers of failures by requirement missed first, room, kind of thing touched, and phase, each "
        "where they differ.",
    )
    claims: list[Claim] = Field(default=[], description="Causes that are claimed, the strongest first.")
    job: str = Field(description="Job of an example, in the first claim's region where there is one.")
    trial: int | None = optional("Number of the example's trial; absent: the job has no trials.")
    of_trials: bool = Field(
        default=False, description="Whether jobs of the run have trials, beside which a job without any counts as one."
    )
    clip: str | None = optional("Address of the example's outputs, with its recording and video; absent: none is kept.")
    command: str = Field(description="Command that runs the example again.")
    refused: str = Field(
        default="", description="Why nothing could be claimed of it, and what would do; empty: it could."
    )
    needed: NeededUnits | None = optional("Seeds, points or worlds that would do; absent: it names no number of them.")

    shared: str = Field(
        default="", description="Part of it that has the cause claimed of all failures; empty: it has its own, or none."
    )

    @property
    def name(self) -> str:
        """The group as a part of a sentence: `polite, in Kitchen, at chair, after to-kitchen`."""
        parts = [
            self.requirement or "all failures",
            self.room and f"in {self.room}",
            self.other and f"at {self.other}",
            self.phase,
        ]
        return ", ".join(part for part in parts if part)

    @property
    def nothing(self) -> str:
        """Sentence for a group without a claim (a region of the axes, or a world, that explains its failures).

        It is empty where no cause was looked for.
        """
        if self.refused == NOT_LOOKED_FOR:
            return self.shared
        return self.shared or self.refused or "no axis and no world explains it"

    @property
    def details(self) -> str:
        """Numbers of its failures: `missed first: gentle (14), to-bed (5); touched or too near: chair (9)`."""
        return "; ".join(f"{what}: {_listed(counts)}" for what, counts in self.breakdown.items())

    @property
    def noun(self) -> str:
        """Noun of its failures: `job` or `trial`."""
        return "job" if self.trial is None and not self.of_trials else "trial"

    @property
    def size(self) -> str:
        """The group with the number of its failures: `polite, in Kitchen: 12 trials missed it first`.

        Trials that missed another requirement before are in that one's group.
        """
        count = counted(self.failed, self.noun)
        how = {"": " failed", NO_REQUIREMENT: " failed by it"}.get(self.requirement, " missed it first")
        return f"{self.name}: {count}{how}{_copies(self.copies)}"

    @property
    def in_words(self) -> str:
        """The group in one line, with its strongest claim: the region of an axis where it fails most.

        It reads `polite, in Kitchen: 12 trials missed it first; REGION: NUMBERS`, or ends with the reason why no region
        explains it.
        """
        return self.told(self.nothing)

    def told(self, reason: str) -> str:
        """Returns the group in one line.

        Args:
            reason: Why nothing is claimed of it, as it is told; empty: it is not.
        """
        said = f"{self.claims[0].region}: {self.claims[0].numbers}" if self.claims else reason
        return "; ".join(filter(None, (self.size, said, self._further, self.details)))

    @property
    def cause(self) -> str:
        """Sentence about the strongest claim: `with SPEED = fast, 45 of 60 jobs failed; …`; empty without a claim.

        Where trials that missed the requirement after another are counted, too, the group's room, thing and phase are
        not said.
        """
        if not self.claims:
            return ""
        claim = self.claims[0]
        missed = self.requirement if claim.failed_otherwise else self.name
        verb = {"": "failed", NO_REQUIREMENT: f"failed by {missed}"}.get(self.requirement, f"missed {missed}")
        return "; ".join(filter(None, (claim.sentence(self.noun, verb), self._further)))

    @property
    def _further(self) -> str:
        """Further claims in short: `also worlds of large flat (11 of 24, elsewhere 0 of 24)`."""
        return ", ".join(f"also {each.region} ({each.counts})" for each in self.claims[1:])


def _copies(count: int) -> str:
    """Remark on failures that are copies of others: ` (3 more are copies, not counted)`; empty if there are none."""
    return f" ({count} more {'is a copy' if count == 1 else 'are copies'}, not counted)" if count else ""


def _listed(counts: dict[str, int]) -> str:
    """Returns the largest counts in words, the largest first: `chair (12), table (5) and 2 others`."""
    ordered = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    words = ", ".join(f"{name} ({count})" for name, count in ordered[:_MOST_LISTED])
    left = len(ordered) - _MOST_LISTED
    return words + (f" and {counted(left, 'other')}" if left > 0 else "")


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
    too_few: bool = Field(
        default=False, description="Whether there is no interval as failures, passes or trials with its values are few."
    )
    claim: str = Field(
        default="", description="Cause of failures with this axis that is claimed of the run; empty: none, or a margin."
    )
    is_tested: bool = Field(
        default=True, description="Whether a cause with this axis was tested: mostly, there were enough failures."
    )

    @property
    def is_shown(self) -> bool:
        """Whether a dependence is shown: failures have a claimed cause with the axis, a margin's interval is not at 0.

        Failures have one answer, that of the claims, which correct for all axes, their pairs and worlds together.
        """
        return self._leaves_out_0 if self.on else bool(self.claim)

    @property
    def _leaves_out_0(self) -> bool:
        return not self.refused and (self.low > 0 or self.high < 0)

    @property
    def is_open(self) -> bool:
        """Whether a large effect on failures is neither shown nor ruled out."""
        return (
            not self.on
            and not self.claim
            and (self.too_few if self.refused else max(-self.low, self.high) > _LARGE_EFFECT)
        )

    @property
    def outcome(self) -> str:
        """Name of the outcome: `failures` or `margin of polite`."""
        return f"margin of {self.on}" if self.on else "failures"

    @property
    def in_words(self) -> str:
        """The change with its interval: `failures +12 points (+3 to +21) from 0.8 to 1.3`; or why there is none."""
        if self.claim:
            return f"{self.claim}; {self._change}"
        if self.on or not self._leaves_out_0:
            return self._change
        if not self.is_tested:
            return f"{self._change}, which is no claim, as none with this axis was tested; Why says the reason"
        return f"{self._change}, which is no claim: all axes, their pairs and worlds together leave it to chance"

    @property
    def _change(self) -> str:
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
        """Says what it changes: `changes failures, margin of polite`, `changes nothing` or `no effect shown`.

        Where large effects on failures are open it is `too few to tell`: an axis that may do much is not harmless.
        """
        if self.idle:
            return "changes nothing: trials that differ in it alone went through the same states"
        shown = [each.outcome for each in self.effects if each.is_shown]
        if shown:
            return f"changes {', '.join(shown)}"
        return "too few to tell" if any(each.is_open for each in self.effects) else "no effect shown"

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
    copies: int = Field(
        default=0, description="Number of further failures, which are copies of others: they are in no group."
    )
    overall: FailureGroup | None = optional(
        "All failures together, with what they have in common; absent: they missed one requirement, whose group it is."
    )
    groups: list[FailureGroup] = Field(
        default=[], description="Groups, the largest first; a failure is in one of them."
    )
    lifts: list[TestedLift] = Field(default=[], description="All axes that were tested, alone, in pairs and by three.")
    sensitivities: list[Sensitivity] = Field(default=[], description="Changes of margins along axes.")
    margin_plots: list[MarginPlot] = Field(default=[], description="Margins over axes, at most six.")
    cell_plots: list[CellPlot] = Field(default=[], description="Failure rates over claimed axes, at most six.")
    again: str = Field(default="", description="Command that runs the specification again; empty: not known.")
    parameters: dict[str, Any] = Field(default={}, description="Values of the specification's parameters.")
    refused: list[str] = Field(default=[], description="Sentences about what cannot be told, with what would do.")

    @property
    def leading(self) -> FailureGroup | None:
        """Group that is told first: all failures if a cause of all is claimed or none of any; None: a group has one."""
        overall = self.overall
        is_told = overall is not None and (overall.claims or not any(group.claims for group in self.groups))
        return overall if is_told else None

    @property
    def size(self) -> str:
        """Number of failures, of all that passed or failed: `52 of 120 trials failed`."""
        noun = next((group.noun for group in self.groups), "trial")
        return f"{self.failed} of {counted(self.trials, noun)} failed{_copies(self.copies)}"

    @property
    def answer(self) -> str:
        """Number of failures and the headline: `52 of 120 trials failed: with SPEED = fast, 45 of 60 …`."""
        return ": ".join(filter(None, (self.size, self.headline)))

    @property
    def headline(self) -> str:
        """The answer in one sentence: the cause that most failures share, or why none is shown.

        It is empty if there are no failures, or no cause was looked for.
        """
        claimed = [group for group in self.groups if group.claims]
        if (leading := self.leading or next(iter(claimed or self.groups), None)) is None:
            return ""
        if not leading.cause and not leading.nothing:
            return ""
        told = leading.cause or f"no cause is shown: {leading.nothing}"
        if not leading.cause and leading.needed is not None and self.again:
            told += f"; then {self.again_with(leading.needed)}"
        others = 0 if leading is self.overall else len(claimed) - 1
        if others > 0:
            told += f"; {counted(others, 'other group')} of failures {'has' if others == 1 else 'have'} a cause, too"
        return told

    def again_with(self, needed: NeededUnits) -> str:
        """Returns the command that runs it again, with more seeds, points or worlds where a parameter sets them."""
        if self.parameters.get(needed.what) != needed.now:
            return self.again
        command = shlex.split(self.again)
        own = f"{needed.what}={needed.now}"
        if own in command:
            command[command.index(own)] = f"{needed.what}={needed.needed}"
        else:
            command += ["--set", f"{needed.what}={needed.needed}"]
        return shlex.join(command)

    def reason_of(self, group: FailureGroup) -> str:
        """Returns why nothing is claimed of a group; empty where that is said of all failures.

        Args:
            group: A group without claims.
        """
        leading = self.leading
        is_said = leading is not None and not leading.claims and group is not leading
        return "" if is_said else group.nothing
