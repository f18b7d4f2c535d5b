"""Counts a job's trials by verdict, cell and axis, and decides the job's verdict.

The code is pure, and its memory use does not grow with the number of trials.
"""

import hashlib
import math
import textwrap
from collections import Counter
from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import TypeVar

from ....schemas.runs.axis_kinds.kind import Value
from ....schemas.runs.plan import Requirement, RunResult, Verdict
from ....schemas.runs.requirement_kinds.kind import COUNTS_IN_NO_TRIAL
from ....schemas.runs.trial_rows import (
    MAX_CELLS,
    MAX_FAILING,
    SUMMARY_NAME,
    AxisCounts,
    FailingTrial,
    TrialCounts,
    TrialRow,
    TrialsSummary,
)
from ....schemas.runs.trials import OF_ALL_TRIALS, Trials
from ....schemas.trial_copies import copy_key
from ....schemas.wire.common import counted
from ..episode.verdicts import Parts, TrialParts, decide_verdict
from .axis_parts import AxisEffect, AxisParts, Part

MAX_NAMES = 200
"""Maximum number of different metrics, and of different requirements, that are counted; the first ones are."""
_NAMED = 10
_MOST_MISSED = 3
"""Number of the requirements that a job's reason names, those that most trials missed."""
_MAX_NOTES = 5
_REASON_CHARACTERS = 300
_MAX_KEYS = 200_000
"""Number of trials, of all parts of axes together, whose later copies are recognised."""
OFF_BY_JOB = "switched off by the job; "
_COUNTED: dict[Verdict, str] = {"PASS": "passed", "FAIL": "failed", "ERROR": "errors", "NONE": "unjudged"}

Cell = tuple[tuple[str, Value], ...]
_Key = TypeVar("_Key")


class Tally:
    """Accumulates trials' results to the job's summary and result.

    Args:
        trials: The job's trials.
    """

    def __init__(self, trials: Trials) -> None:
        self._trials = trials
        self._counts: dict[str, int] = {}
        self._cells: dict[Cell, dict[str, int]] = {}
        self._keys: set[int] = set()
        self._parts = {name: AxisParts(axis) for name, axis in (trials.axes or {}).items()}
        self._axes: dict[str, dict[Part, dict[str, int]]] = {name: {} for name in self._parts}
        self._failing: list[FailingTrial] = []
        self._requirements: dict[str, _RequirementCount] = {}
        self._means: dict[str, _Mean] = {}
        self._notes: dict[str, list[int]] = {}
        """Notes of trials, and the numbers of the first trials that have each."""
        self._noted: Counter[str] = Counter()
        self._effects = {name: AxisEffect(name) for name in self._parts}
        self._digest = hashlib.sha256()
        self._has_digests = False
        self._first_digest: str | None = None
        self._differ = False
        self._sim_time_s = self._wall_time_s = 0.0
        self._steps = 0
        self.rows = 0
        """Number of counted trials."""
        self.unanswered = ""
        """Message about code that did not answer when the job was stopped in a trial; empty: none."""

    def take(self, row: TrialRow) -> None:
        """Adds one trial's results to the job's counts, means, notes and digest; trials come in order of their numbers.

        Names of requirements and metrics beyond a limit are left out.
        """
        self.rows += 1
        counted = _COUNTED[row.verdict]
        self._counts[counted] = self._counts.get(counted, 0) + 1
        self._counts["copies"] = self._counts.get("copies", 0) + self._is_copy(row)
        self._count_cell(row, counted)
        if row.verdict in ("FAIL", "ERROR") and len(self._failing) < MAX_FAILING:
            self._failing.append(_failing(row, row.verdict))
        for requirement in row.requirements:
            if requirement.name in self._requirements or len(self._requirements) < MAX_NAMES:
                self._requirements.setdefault(requirement.name, _RequirementCount()).take(requirement, row.trial)
        for name, value in row.metrics.items():
            if name in self._means or len(self._means) < MAX_NAMES:
                self._means.setdefault(name, _Mean()).take(value)
        for effect in self._effects.values():
            effect.take(row)
        self._digest.update((row.state_digest or "").encode() + b"\n")
        self._has_digests |= row.state_digest is not None
        if self.rows == 1:
            self._first_digest = row.state_digest
        self._differ |= row.state_digest != self._first_digest
        self._take_notes(row)
        self._sim_time_s += row.sim_time_s
        self._wall_time_s += row.wall_time_s
        self._steps += row.steps

    def _take_notes(self, row: TrialRow) -> None:
        for note in dict.fromkeys(row.notes):
            if note in self._notes or len(self._notes) < _MAX_NOTES:
                self._noted[note] += 1
                if self._noted[note] <= _NAMED:
                    self._notes.setdefault(note, []).append(row.trial)

    def _count_cell(self, row: TrialRow, counted: str) -> None:
        """Counts a trial in its cell, if cells repeat, and in the part of each axis to which its value belongs."""
        if self._axes and self._trials.design == "grid":
            cell = tuple(row.axes.items())
            _count(self._cells, cell, counted, is_copy=self._is_copy(row, cell))
        for name, counts in self._axes.items():
            part = self._parts[name].part(row.axes.get(name))
            _count(counts, part, counted, is_copy=self._is_copy(row, name, part))

    def _is_copy(self, row: TrialRow, *among: Hashable) -> bool:
        """Returns whether an earlier trial, among those of the same cell or part of an axis, is the same.

        It is if it has the same states and verdict. So that memory stays bounded, only the first trials are remembered.
        """
        if row.verdict not in ("PASS", "FAIL") or (key := copy_key(row.state_digest, row.verdict, among)) is None:
            return False
        if key in self._keys:
            return True
        if len(self._keys) < _MAX_KEYS:
            self._keys.add(key)
        return False

    @property
    def sim_time_s(self) -> float:
        """Simulated time of all trials, in seconds."""
        return self._sim_time_s

    @property
    def first_failing(self) -> list[int]:
        """Numbers of the first trials that failed or ended with an error, at most as many as are kept."""
        return [each.trial for each in self._failing]

    @property
    def is_whole(self) -> bool:
        """Whether the results of all trials of the job were added."""
        return self.rows >= self._trials.count

    def summary(self, recorded: list[int]) -> TrialsSummary:
        """Returns the summary of the job's trials for its result: counts by verdict, cell and axis.

        Args:
            recorded: Numbers of the trials that have an output folder.
        """
        return TrialsSummary(
            planned=self._trials.count,
            counts=_counts(self._counts),
            cells=[_counts(counts, dict(cell)) for cell, counts in self._cells.items()],
            axes=[
                AxisCounts.model_validate({"axis": name, "part": part, **parts[place, part]})
                for name, parts in self._axes.items()
                for place, part in sorted(parts)
            ],
            failing=[
                each.model_copy(update={"recorded": True}) if each.trial in recorded else each for each in self._failing
            ],
            recorded=recorded,
            stopped_in=None if self.is_whole else self.rows,
        )

    def result(self, ended_by: str, seed: int, versions: dict[str, str], recorded: list[int]) -> RunResult:
        """Returns the job's result: FAIL if any trial failed, else ERROR if any broke or is missing.

        Args:
            ended_by: `environment` once all trials ran, else the cause of the run's end.
            seed: The job's seed.
            versions: Versions of the packages that the numbers depend on.
            recorded: Numbers of the trials that have an output folder.
        """
        summary = self.summary(recorded)
        own = Requirement(
            name=OF_ALL_TRIALS,
            satisfied=self._verdict in ("PASS", "NONE"),
            detail=self._in_words,
            error=self._in_words if self._verdict == "ERROR" else None,
            value=float(summary.counts.failed + summary.counts.errors),
            limit=0.0,
        )
        result = RunResult(
            verdict=self._verdict,
            notes=self._remarks,
            summary=f"{self._in_words[0].upper()}{self._in_words[1:]}.",
            requirements=[own, *(count.requirement(name) for name, count in self._requirements.items())],
            metrics=self._metrics(summary.counts),
            sim_time_s=self._sim_time_s,
            wall_time_s=self._wall_time_s,
            real_time_factor=self._sim_time_s / self._wall_time_s if self._wall_time_s > 0 else 0.0,
            ended_by=ended_by,
            seed=seed,
            versions=versions,
            state_digest=self._digest.hexdigest() if self._has_digests else None,
            extra={SUMMARY_NAME: summary.model_dump(mode="json", exclude_defaults=True)},
        )
        return result.unjudged() if ended_by == "canceled" else result

    @property
    def _verdict(self) -> Verdict:
        counts = {name: self._counts.get(name, 0) for name in _COUNTED.values()}
        return decide_verdict(Parts(trials=TrialParts(planned=self._trials.count, **counts)))

    @property
    def _remarks(self) -> list[str]:
        """Returns the notes that are shown with the verdict."""
        off = [name for name, count in self._requirements.items() if count.kind == "off"]
        notes = [f"{self._trials_in_words(trials, self._noted[note])}: {note}" for note, trials in self._notes.items()]
        own = [f"switched off by the job: {', '.join(off)}", *notes] if off else notes
        is_one = self.rows > 1 and self._first_digest is not None and not self._differ
        same = f"all {self.rows} trials went through the same states: they count as one trial"
        return [same, *own] if is_one else [*filter(None, (each.note for each in self._effects.values())), *own]

    def _trials_in_words(self, first: list[int], count: int) -> str:
        if 1 < count == self.rows:
            return f"all {count} trials"
        more = f" and {count - len(first)} more" if count > len(first) else ""
        return f"trial{'s' if count > 1 else ''} {', '.join(map(str, first))}{more}"

    @property
    def _in_words(self) -> str:
        """Text that says how many trials did not pass, which, and why.

        `2 of 9 trials did not pass: trials 4, 7; missed: soft in 2`. Trials are not listed where all of them did not
        pass. It also says if trials have no verdict or the job was stopped.
        """
        bad = self._counts.get("failed", 0) + self._counts.get("errors", 0)
        trials = counted(self.rows, "trial")
        text = f"{bad} of {trials} did not pass" if bad else f"none of {trials} failed"
        if bad:
            more = bad - _NAMED
            named = ", ".join(str(number) for number in self.first_failing[:_NAMED])
            listed = f": trial{'s' if bad > 1 else ''} {named}{f' and {more} more' if more > 0 else ''}"
            text += f"{listed if bad < self.rows else ''}{self._why}"
        if (unjudged := self._counts.get("unjudged", 0)) and unjudged < self.rows:
            text += f"; {unjudged} of {self.rows} have no verdict"
        if not self.is_whole:
            stopped = f"stopped in trial {self.rows} of {self._trials.count}"
            text = f"{text}; {stopped}" if self.rows else stopped
            text += f": {self.unanswered}" if self.unanswered else ""
        return text

    @property
    def _why(self) -> str:
        """Says what was missed most often, as `; missed: gentle in 8, to-bed in 3`, and why the first trial broke.

        Where more broke, their number comes first: `; 2 broke, first trial 3: RuntimeError: the rope broke`.
        """
        missed = {name: count.missed for name, count in self._requirements.items() if count.missed}
        worst = sorted(missed, key=lambda name: -missed[name])
        told = ", ".join(f"{name} in {missed[name]}" for name in worst[:_MOST_MISSED])
        others = len(worst) - _MOST_MISSED
        text = f"; missed: {told}{f' and {others} more' if others > 0 else ''}" if told else ""
        broke = next((each for each in self._failing if each.verdict == "ERROR"), None)
        reason = next(iter(broke.reason.strip().splitlines()), "") if broke else ""
        if broke is None or not reason:
            return text
        errors = self._counts["errors"]
        told = f"trial {broke.trial} broke" if errors == 1 else f"{errors} broke, first trial {broke.trial}"
        return f"{text}; {told}: {textwrap.shorten(reason, _REASON_CHARACTERS, placeholder=' …')}"

    def _metrics(self, counts: TrialCounts) -> dict[str, float]:
        judged = counts.passed + counts.failed
        metrics = {
            "trials": float(self.rows),
            "trials_passed": float(counts.passed),
            "trials_failed": float(counts.failed),
            "trials_errors": float(counts.errors),
            "steps": float(self._steps),
        }
        if judged:
            metrics["pass_rate"] = counts.passed / judged
        return metrics | {f"mean_{name}": mean.value for name, mean in self._means.items() if name != "steps"}


@dataclass
class _Mean:
    """Mean of numbers that are added one by one and not kept."""

    count: int = 0
    value: float = 0.0

    def take(self, value: float) -> None:
        self.count += 1
        self.value += (value - self.value) / self.count


@dataclass
class _RequirementCount:
    """Count of the trials that met one requirement, with the worst of them."""

    trials: int = 0
    counted: int = 0
    met: int = 0
    missed: int = 0
    """Number of the trials in which it counted, was judged, and was not met."""
    kind: str | None = None
    worst: Requirement | None = field(default=None)
    """The requirement with the smallest margin: of those missed, once one is, as another's would seem to be met."""

    def take(self, requirement: Requirement, trial: int) -> None:
        self.trials += 1
        self.counted += requirement.counts
        self.met += requirement.satisfied
        self.missed += requirement.counts and not requirement.satisfied and requirement.error is None
        self.kind = requirement.kind
        if self.worst is None or _badness(requirement) < _badness(self.worst):
            self.worst = requirement.model_copy(update={"trial": trial})

    def requirement(self, name: str) -> Requirement:
        """Returns a requirement's entry in the job's result: in how many trials it was met, and the worst value.

        The entry itself does not count for the verdict.
        """
        told = {"value", "limit", "unit", "margin"}
        if self.worst is not None and self.worst.margin is not None:
            told.add("trial")  # without a margin none is the worst
        worst = {} if self.worst is None else self.worst.model_dump(include=told)
        aside = OFF_BY_JOB if self.kind == "off" else "" if self.counted else COUNTS_IN_NO_TRIAL
        return Requirement(
            name=name,
            kind=self.kind,
            satisfied=self.met == self.trials,
            detail=f"{aside}met in {self.met} of {counted(self.trials, 'trial')}",
            counts=False,
            **worst,
        )


def _badness(requirement: Requirement) -> tuple[bool, float]:
    """Returns the sort key of a requirement: missed ones first, by margin; those without a margin after the others."""
    return requirement.satisfied, math.inf if requirement.margin is None else requirement.margin


def _count(counts: dict[_Key, dict[str, int]], key: _Key, counted: str, *, is_copy: bool) -> None:
    """Increases a count of a key by one, if the key is among the first `MAX_CELLS`; else does nothing."""
    if key in counts or len(counts) < MAX_CELLS:
        of_key = counts.setdefault(key, {})
        of_key[counted] = of_key.get(counted, 0) + 1
        of_key["copies"] = of_key.get("copies", 0) + is_copy


def _counts(counts: dict[str, int], axes: dict[str, Value] | None = None) -> TrialCounts:
    return TrialCounts.model_validate({"axes": axes or {}, **counts})


def _failing(row: TrialRow, verdict: Verdict) -> FailingTrial:
    return FailingTrial(
        trial=row.trial,
        seed=row.seed,
        axes=row.axes,
        verdict="FAIL" if verdict == "FAIL" else "ERROR",
        reason=row.reason if len(row.reason) <= _REASON_CHARACTERS else f"{row.reason[: _REASON_CHARACTERS - 1]}…",
    )
