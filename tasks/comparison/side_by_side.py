"""Two runs, or two cells of an axis, side by side: which jobs to look at first, and how each requirement changed."""

import json
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...schemas.reports.comparison import RequirementBeside, RequirementTurn
from ...schemas.reports.run_record import JobRecord
from ...schemas.runs.axes import value_text
from ...schemas.runs.axis_kinds.kind import Value
from ...schemas.runs.requirement_kinds.kind import Requirement
from ...schemas.specs.batch_splitting import step_of
from ...schemas.wire.common import counted
from ..reporting import Outcome, outcomes
from .compared_runs import HEALTH, JUDGED, TRIALS, outcome_of
from .pairing import CellPlace, Pair, Pairing, place_beside

Asked = Mapping[str, Mapping[str, Any]]
"""Requirements of a job's request by name, as the request has them."""

_YES_OR_NO = "predicate"
"""Kind of requirements whose margins say no more than whether they are met."""
_NOT_RUN = (Outcome.CANCELED, Outcome.UNFINISHED)
_MET = re.compile(r"met in (\d+) of (\d+) trials?$")
"""The detail of a requirement of a job with trials: `met in 4 of 8 trials`."""
_FAILED = re.compile(r"(\d+|none) of (\d+) trials? (?:did not pass|failed)\b")
"""The detail of all its trials: `4 of 8 trials did not pass: trials 1, 2, 5, 7`, `none of 8 trials failed`."""


@dataclass(frozen=True)
class StepAxis:
    """An axis of a step, with its values in the order of the step's jobs."""

    step: str
    name: str
    values: tuple[Value, ...]
    titles: tuple[str, ...]
    """The values in words, as the results of axes have them; of worlds the names that they have in the run."""


def axes_of(jobs: Sequence[JobRecord]) -> list[StepAxis]:
    """Returns the axes of a run's steps that have two values or more.

    Args:
        jobs: All jobs of the run.
    """
    values: dict[tuple[str, str], dict[Value, str]] = {}
    for job in jobs:
        for name, value in job.axes.items():
            title = (_is_world(job, name) and job.world_title) or value_text(value)
            values.setdefault((step_of(job.step or ""), name), {}).setdefault(value, title)
    return [
        StepAxis(step, name, tuple(found), tuple(found.values()))
        for (step, name), found in values.items()
        if len(found) > 1
    ]


def pair_cells(jobs: Sequence[JobRecord], axis: StepAxis, baseline: Value, other: Value) -> Pairing:
    """Matches the jobs of two values of an axis that differ in nothing else.

    Where no two of them drove in the same world, the axis varies the world: then they are matched by all but their
    worlds, as in the results of axes, which a page of them has to say.

    Args:
        jobs: All jobs of the run.
        axis: The axis.
        baseline: The value whose jobs come first in the pairs.
        other: The value whose jobs come second.
    """
    here = [job for job in jobs if step_of(job.step or "") == axis.step]
    first, second = ([job for job in here if job.axes.get(axis.name) == value] for value in (baseline, other))
    found = _paired(first, second, axis.name, with_world=True)
    return found if found.pairs else _paired(first, second, axis.name, with_world=False)


def by_change(pairs: Sequence[Pair]) -> list[Pair]:
    """Sorts pairs: newly failing ones first, then other changed verdicts, then changed requirements, then the rest.

    Pairs of which a side was not run to its end come last.
    """
    return sorted(pairs, key=_rank)


def has_changed(pair: Pair) -> bool:
    """Returns whether the two jobs of a pair ended differently: passed, failed, broke, or had no verdict."""
    before, after = pair.outcomes
    return before is not after and was_run(pair)


def was_run(pair: Pair) -> bool:
    """Returns whether both jobs of a pair came to an end of their own; a run that stops early leaves some out."""
    return not any(outcome in _NOT_RUN for outcome in pair.outcomes)


def requirements_beside(pair: Pair, asked: tuple[Asked, Asked] | None = None) -> list[RequirementBeside]:
    """Compares two jobs requirement by requirement.

    Args:
        pair: The two jobs.
        asked: What both requests ask for, if it is known: a requirement that is asked for otherwise is not comparable.
            Without it, requirements of the same kind and limit are taken for the same.

    Returns:
        One entry for each requirement of either job, in the order of the first job and then of the second; those that
        count in neither come last.
    """
    before, after = ({item.name: item for item in job.requirements} for job in (pair.before, pair.after))
    names = dict.fromkeys([*before, *after])
    sides = {name: [item for item in (before.get(name), after.get(name)) if item is not None] for name in names}
    last = sorted(names, key=lambda name: all(_is_aside(item, pair) for item in sides[name]))
    return [_compared(name, before.get(name), after.get(name), pair, asked) for name in last]


def _has_trials(pair: Pair) -> bool:
    return any(item.name == TRIALS for job in (pair.before, pair.after) for item in job.requirements)


def _is_aside(item: Requirement, pair: Pair) -> bool:
    return item.is_aside(of_trials=_has_trials(pair))


def _is_world(job: JobRecord, axis: str) -> bool:
    return job.inputs is not None and job.inputs.world is not None and job.axes.get(axis) == job.inputs.world


def _paired(first: Sequence[JobRecord], second: Sequence[JobRecord], axis: str, *, with_world: bool) -> Pairing:
    waiting, arriving = (_by_place(jobs, axis, with_world=with_world) for jobs in (first, second))
    places = waiting.keys() & arriving.keys()
    if not with_world:  # of jobs of one place in several worlds nothing says which ones are a pair
        places = {each for each in places if _has_one_world(waiting[each]) and _has_one_world(arriving[each])}
    partners = {id(new): old for each in places for old, new in zip(waiting[each], arriving[each], strict=False)}
    pairs = [Pair(partners[id(job)], job) for job in second if id(job) in partners]
    paired = {id(pair.before) for pair in pairs}
    alone = [job for job in second if id(job) not in partners]
    return Pairing(pairs, [job for job in first if id(job) not in paired], alone)


def _by_place(jobs: Sequence[JobRecord], axis: str, *, with_world: bool) -> dict[CellPlace, list[JobRecord]]:
    found: dict[CellPlace, list[JobRecord]] = defaultdict(list)
    for job in jobs:
        found[place_beside(job, axis, with_world=with_world)].append(job)
    return found


def _has_one_world(jobs: Sequence[JobRecord]) -> bool:
    return len({job.inputs.world for job in jobs if job.inputs}) == 1


def _rank(pair: Pair) -> int:
    before, after = pair.outcomes
    if not was_run(pair):
        return 4
    if before is not after:
        return 0 if after.is_failure and not before.is_failure else 1
    met, now = (
        {item.name: (item.satisfied, _count_of(item)) for item in job.requirements if not _is_aside(item, pair)}
        for job in (pair.before, pair.after)
    )
    return 2 if met != now else 3


def _compared(
    name: str, before: Requirement | None, after: Requirement | None, pair: Pair, asked: tuple[Asked, Asked] | None
) -> RequirementBeside:
    if (aside := _turn_aside(before, after, pair)) is not None:
        return RequirementBeside(name=name, before=before, after=after, turn=aside[0], why=aside[1])
    turn, why = _turn(before, after, pair)
    if before is not None and after is not None and not _asks_for_the_same(before, after, pair, asked):
        turn, why = "not comparable", "the two jobs are asked for something else"
    return RequirementBeside(name=name, before=before, after=after, turn=turn, why=why)


def _turn_aside(
    before: Requirement | None, after: Requirement | None, pair: Pair
) -> tuple[RequirementTurn, str] | None:
    """Returns that a requirement does not count in a job, so that it is neither better nor worse; `None`: it counts.

    The environment's own do not count in a run that ended with its goals reached.
    """
    aside = [item is not None and _is_aside(item, pair) for item in (before, after)]
    if not any(aside):
        return None
    there = [is_aside for is_aside, item in zip(aside, (before, after), strict=True) if item is not None]
    if all(there):
        return "unchanged", "it does not count"
    return "not comparable", f"it does not count in {'A' if aside[0] else 'B'}"


def _turn(before: Requirement | None, after: Requirement | None, pair: Pair) -> tuple[RequirementTurn, str]:
    """Returns how a requirement changed between the two jobs of a pair, and why in words, as far as the results say."""
    if before is None or after is None:
        return _turn_of_one(before, after, pair)
    for letter, item in (("A", before), ("B", after)):
        if item.error is not None:
            return "not comparable", f"it broke in {letter}"
    if _has_trials(pair):
        return _turn_of_trials(before, after)
    if before.satisfied != after.satisfied:
        return ("better", "newly met") if after.satisfied else ("worse", "newly missed")
    return _turn_of_margin(before, after)


def _turn_of_one(before: Requirement | None, after: Requirement | None, pair: Pair) -> tuple[RequirementTurn, str]:
    """Returns how a requirement changed that only one of the jobs has in its result, and why in words."""
    letter, job = ("A", pair.before) if before is None else ("B", pair.after)
    item = before or after
    outcome = outcome_of(job)
    if outcome not in JUDGED:
        words = {Outcome.BROKEN: "broke", Outcome.CANCELED: "was not run", Outcome.UNFINISHED: "has not ended"}
        return "not comparable", f"{letter} {words.get(outcome, 'has no verdict')}"
    if item is not None and item.kind == HEALTH and item.error is None:  # results have it only where it was missed
        return ("worse", "newly missed") if before is None else ("better", "no longer missed")
    return "not comparable", f"it is not asked of {letter}"


def _turn_of_trials(before: Requirement, after: Requirement) -> tuple[RequirementTurn, str]:
    """Returns in how many more or fewer trials a requirement is met; their smallest margin decides nothing."""
    met, now, verb = _count_of(before), _count_of(after), "failed" if before.name == TRIALS else "met"
    if met is None or now is None:
        if before.satisfied == after.satisfied:
            return "unchanged", "" if after.satisfied else "still missed"
        return ("better", "newly met") if after.satisfied else ("worse", "newly missed")
    if met[1] != now[1]:
        return "not comparable", f"{counted(met[1], 'trial')} in A, {now[1]} in B"
    change = now[0] - met[0]
    if not change:
        return "unchanged", ""
    trials = f"{abs(change)} {'more' if change > 0 else 'fewer'} {'trial' if abs(change) == 1 else 'trials'}"
    return ("better" if (change > 0) == (verb == "met") else "worse"), f"{verb} in {trials}"


def _count_of(item: Requirement) -> tuple[int, int] | None:
    """Returns in how many trials a requirement was met, or of all of them how many failed, and the number of trials.

    Returns None for a job without trials, and for one whose text says no numbers.
    """
    found = (_FAILED if item.name == TRIALS else _MET).search(item.detail)
    return None if found is None else (0 if found[1] == "none" else int(found[1]), int(found[2]))


def _turn_of_margin(before: Requirement, after: Requirement) -> tuple[RequirementTurn, str]:
    """Returns how the margin changed of a requirement that both jobs meet, or both miss."""
    still = "" if after.satisfied else "still missed"
    if before.margin is None or after.margin is None or after.kind == _YES_OR_NO:
        return "unchanged", still
    if before.unit != after.unit:  # a goal that was reached has seconds left, another one lacks metres
        return "not comparable", f"margins in {before.unit or 'no unit'} and in {after.unit or 'no unit'}"
    if outcomes.compact(before.margin) == outcomes.compact(after.margin):  # what is shown as the same is the same
        return "unchanged", still
    change = outcomes.compact(after.margin - before.margin)
    words = f"margin {'+' if after.margin > before.margin else ''}{change} {after.unit or ''}".rstrip()
    turn: RequirementTurn = "better" if after.margin > before.margin else "worse"
    return turn, f"{still}, {words}" if still else words


def _asks_for_the_same(before: Requirement, after: Requirement, pair: Pair, asked: tuple[Asked, Asked] | None) -> bool:
    if pair.asks_for_the_same:
        return True
    if asked is not None and before.name in asked[0] and before.name in asked[1]:
        ours, theirs = (json.dumps(each[before.name], sort_keys=True, default=str) for each in asked)
        return ours == theirs
    if before.kind is None and after.kind is None:  # the environment's own, whose limits may depend on the run
        return True
    return before.kind == after.kind and (before.limit == after.limit or before.limit is None or after.limit is None)
