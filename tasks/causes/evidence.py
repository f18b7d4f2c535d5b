"""Evidence about failures, from the table of results: judged trials, their axes, and the way in which each failed."""

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...schemas.reports.causes import NO_REQUIREMENT
from ...schemas.runs.axes import AS_BUILT
from ...schemas.runs.axis_kinds.kind import Value
from ...schemas.trial_copies import are_copies, copy_key
from ...schemas.wire.common import counted
from ..results.table import ResultTable

_NUMBERED = re.compile(r"[\s_.:#-]*\d+$")
"""Number at the end of a thing's name: `chair_3` and `chair_12` are both a chair."""

_SHARE_WITH_PAIRS = 0.5
"""Share of a job's trials that have to differ from another in one axis alone, to tell that it changes nothing."""


class Signature(NamedTuple):
    """The way in which a trial failed: its first missed requirement, and where, by what and when it was missed."""

    requirement: str
    room: str | None = None
    other: str | None = None
    """Kind of the thing that was touched or came too near."""
    phase: str | None = None
    """Last goal that had been reached, or first one that had not: `after to-kitchen`, `before to-kitchen`."""

    @property
    def order(self) -> tuple[str, ...]:
        """Members as texts, empty where they are `None`, by which groups of one size are sorted."""
        return tuple(each or "" for each in self)


@dataclass(frozen=True)
class AxisColumn:
    """Values of one axis, as arrays with one entry for each judged trial."""

    name: str
    codes: NDArray[np.int64]
    """Number of the value among `values`."""
    values: tuple[Value | None, ...]
    """Different values in their order; None: as built."""

    @property
    def is_number(self) -> bool:
        """Whether all values of the axis are numbers."""
        return all(not isinstance(each, str) for each in self.values)

    @property
    def numbers(self) -> NDArray[np.float64]:
        """Values of the trials; NaN where an axis is as built. Only for axes of numbers."""
        known = [math.nan if value is None else float(value) for value in self.values]
        return np.array(known, dtype=np.float64)[self.codes]

    def label(self, code: int) -> str:
        """Returns a value of the axis by its number, as text: a number with four digits, `0.3333`."""
        value = self.values[code]
        return AS_BUILT if value is None else value if isinstance(value, str) else f"{value:.4g}"


@dataclass(frozen=True)
class Evidence:
    """Trials that passed or failed; those that broke, were cancelled or have no verdict say nothing of the robot."""

    rows: NDArray[np.int64]
    """Rows of the table of results."""
    failed: NDArray[np.bool_]
    failed_copies: int
    """Number of failures that are left out, as they are copies of others."""
    jobs: NDArray[np.int64]
    """Number of the trials that a trial is compared with: those of its job; of jobs without trials, and of jobs of a
    step with axes, those of its step in the same world, so that the axes of the step differ among them.
    """
    steps: NDArray[np.int64]
    step_names: tuple[str, ...]
    worlds: NDArray[np.int64]
    world_names: tuple[str, ...]
    seeds: NDArray[np.int64]
    cells: NDArray[np.int64]
    """Number of the combination of values of all axes."""
    axes: tuple[AxisColumn, ...]
    """Axes with two values or more; none of them is the world itself."""
    twins: int
    """Number of further trials that went through the same states, with the same values of all axes or in a job that
    is a copy of another: no evidence.
    """
    idle: tuple[str, ...]
    """Axes that changed nothing in some job, or that only copied jobs have other values of: trials count once."""
    signatures: tuple[Signature | None, ...]
    """Way in which each trial failed; None: it passed."""
    of_jobs: bool
    """Whether all are jobs without trials."""

    def counted(self, count: int) -> str:
        """Returns a number of them in words: `1 job`, `12 trials`."""
        return counted(count, "job" if self.of_jobs else "trial", ",")

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def world_count(self) -> int:
        """Number of different worlds in the judged trials."""
        return len(self.world_names)


def evidence_of(results: ResultTable, states: Sequence[str | None] | None = None) -> Evidence:
    """Reads the judged trials of a table of results, and how those that failed did so.

    Args:
        results: The table.
        states: Digest of all states of each row; None: those of the table; of early releases it has none of
            jobs without trials.
    """
    codes, outcomes = results.codes("outcome")
    wanted = [code for code, outcome in enumerate(outcomes) if outcome in ("passed", "failed")]
    judged = np.flatnonzero(np.isin(codes, wanted))
    state_codes = _state_codes(results.texts("state_digest") if states is None else states)
    kept, idle_in_steps = _without_copied_jobs(results, _distinct(results, judged, state_codes), state_codes)
    rows, idle_in_jobs = _without_idle_axes(results, kept, state_codes)
    all_failed = np.isin(codes, [code for code, outcome in enumerate(outcomes) if outcome == "failed"])
    failed = all_failed[rows]
    worlds, names = _worlds(results, rows)
    steps, step_names = results.codes("step")
    columns = tuple(_axis(name, results.values(name), rows) for name in results.axes if not _is_world(results, name))
    axes = tuple(each for each in columns if len(each.values) > 1)
    return Evidence(
        rows=rows,
        failed=failed,
        failed_copies=int(all_failed.sum() - failed.sum()),
        jobs=_compared(results, rows),
        steps=steps[rows].astype(np.int64),
        step_names=tuple(step_names),
        worlds=worlds,
        world_names=names,
        seeds=_seeds(results, rows),
        cells=key_codes([each.codes for each in axes] or [np.zeros(len(rows), dtype=np.int64)]),
        axes=axes,
        twins=len(judged) - len(kept),
        idle=tuple(dict.fromkeys((*idle_in_steps, *idle_in_jobs))),
        signatures=_signatures(results, rows, failed),
        of_jobs=bool(np.isnan(results.numbers("trial")[rows]).all()),
    )


def _compared(results: ResultTable, rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers the trials that are compared with each other; see `Evidence.jobs`."""
    together = np.isnan(results.numbers("trial")[rows]) | _differ_by_step_axes(results, rows)
    jobs = np.where(together, 0, _plain(results, "job", rows))
    worlds = np.where(together, _worlds(results, rows)[0], 0)
    return key_codes([_plain(results, "step", rows), jobs, worlds])


def _differ_by_step_axes(results: ResultTable, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Returns which trials have others of their step in the same world that differ in an axis of the step.

    An axis of a step has one value in all trials of each of its jobs.
    """
    found = np.zeros(len(rows), dtype=np.bool_)
    steps = _plain(results, "step", rows)
    jobs, places = key_codes([steps, _plain(results, "job", rows)]), key_codes([steps, _worlds(results, rows)[0]])
    for name in results.axes:
        codes = _axis(name, results.values(name), rows).codes
        is_of_trials = np.bincount(steps, weights=varies(jobs, codes)) > 0
        found |= varies(places, codes) & ~is_of_trials[steps]
    return found


def _is_world(results: ResultTable, axis: str) -> bool:
    """Whether an axis of a step is the world: worlds are looked at by themselves."""
    values = results.values(axis)
    if not isinstance(next((value for value in values if value is not None), None), str):
        return False
    pairs = zip(values, results.texts("world"), strict=True)
    return all(value == world for value, world in pairs if value is not None)


def _seeds(results: ResultTable, rows: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.unique(np.nan_to_num(results.numbers("seed")[rows], nan=-1.0), return_inverse=True)[1].astype(np.int64)


def _state_codes(states: Sequence[str | None]) -> NDArray[np.int64]:
    """Numbers the digests; what has none has a number of its own below 0, as it is like no other."""
    numbers: dict[str, int] = {}
    found = [numbers.setdefault(each, len(numbers)) if each else -1 - row for row, each in enumerate(states)]
    return np.array(found, dtype=np.int64)


def _distinct(results: ResultTable, rows: NDArray[np.int64], states: NDArray[np.int64]) -> NDArray[np.int64]:
    """Leaves out trials with the same axes and states as one before: their seed changes nothing.

    Trials are compared with those of their job; jobs without trials with those of their step that were judged alike in
    the same world.
    """
    if not len(rows):
        return rows
    jobs = _plain(results, "job", rows)
    axes = (_axis(name, results.values(name), rows).codes for name in results.axes)
    key = [_plain(results, "step", rows), *axes]
    if (alone := np.isnan(results.numbers("trial")[rows])).any():
        jobs = np.where(alone, 0, jobs)
        key += [
            np.where(alone, _worlds(results, rows)[0], 0),
            np.where(alone, _plain(results, "requirements", rows), 0),
        ]
    return _each_once(rows, states, [*key, jobs])


def _each_once(
    rows: NDArray[np.int64], states: NDArray[np.int64], alike: Sequence[NDArray[np.int64]]
) -> NDArray[np.int64]:
    """Leaves out rows that are copies of others; `alike` has numbers of those rows only, which copies share."""
    known = (state if state >= 0 else None for state in states[rows].tolist())
    keys = [copy_key(*each) for each in zip(known, *(column.tolist() for column in alike), strict=True)]
    return rows[~np.array(are_copies(keys), dtype=bool)]


def _without_copied_jobs(
    results: ResultTable, rows: NDArray[np.int64], states: NDArray[np.int64]
) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """Leaves out jobs whose trials all went through the states of those of another job of their step in the same world.

    Seeds or axes of the step that change nothing make such jobs. Trials are compared by the axes that differ within
    jobs, and by their requirements.

    Returns:
        Rows that are left, and the names of the axes of which they have one value, where the given rows had several.
    """
    rows_in_jobs = rows[~np.isnan(results.numbers("trial")[rows])]
    if not len(rows_in_jobs):
        return rows, ()
    steps = _plain(results, "step", rows_in_jobs)
    jobs = key_codes([steps, _plain(results, "job", rows_in_jobs)])
    axes = (_axis(name, results.values(name), rows_in_jobs).codes for name in results.axes)
    trials = key_codes([
        steps, _worlds(results, rows_in_jobs)[0], _from_0(states[rows_in_jobs]),
        _plain(results, "requirements", rows_in_jobs), *(codes for codes in axes if varies(jobs, codes).any()),
    ])  # fmt: skip
    order = np.argsort(jobs, kind="stable")
    ends = np.flatnonzero(np.diff(jobs[order])) + 1
    found: set[frozenset[int]] = set()
    copied: list[NDArray[np.int64]] = []
    for places in sorted(np.split(order, ends), key=lambda places: int(places[0])):
        own = frozenset(trials[places].tolist())
        if own in found:
            copied.append(rows_in_jobs[places])
        found.add(own)
    if not copied:
        return rows, ()
    left = np.setdiff1d(rows, np.concatenate(copied))
    return left, tuple(
        name
        for name in results.axes
        if not _is_world(results, name)
        and len(_axis(name, results.values(name), left).values) == 1
        and len(_axis(name, results.values(name), rows).values) > 1
    )


def _without_idle_axes(
    results: ResultTable, rows: NDArray[np.int64], states: NDArray[np.int64]
) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """Leaves out trials that differ from one that they are compared with in axes alone that change nothing there.

    They are copies, which would count for as many trials as such an axis has values.

    Returns:
        Rows that are left, and the names of the axes.
    """
    if not len(rows) or not results.axes:
        return rows, ()
    jobs = _compared(results, rows)
    columns = {name: _axis(name, results.values(name), rows).codes for name in results.axes}
    kept = dict(columns)
    idle: list[str] = []
    for name, own in columns.items():
        others = [codes for other, codes in columns.items() if other != name]
        blocks = key_codes([jobs, _seeds(results, rows), *others])
        has_pair = varies(blocks, own)
        is_other = varies(blocks, _from_0(states[rows]))
        is_idle = np.bincount(jobs, weights=has_pair) > _SHARE_WITH_PAIRS * np.bincount(jobs)
        is_idle &= np.bincount(jobs, weights=is_other) == 0
        if is_idle.any():
            idle.append(name)
            kept[name] = np.where(is_idle[jobs], 0, own + 1)
    if not idle:
        return rows, ()
    return _each_once(rows, states, [jobs, *kept.values()]), tuple(idle)


def varies(blocks: NDArray[np.int64], codes: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Returns whether the block of each trial, such as its world, has trials with several numbers."""
    if not len(blocks):
        return np.zeros(0, dtype=np.bool_)
    kinds = np.bincount(np.unique(np.stack([blocks, codes]), axis=1)[0])
    return kinds[blocks] > 1


def _from_0(codes: NDArray[np.int64]) -> NDArray[np.int64]:
    return codes - codes.min(initial=0)


def key_codes(columns: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Numbers the combinations of values of some columns; rows with the same values have the same number."""
    found = np.zeros(len(columns[0]), dtype=np.int64)
    for column in columns:
        _, found = np.unique(found * (int(column.max(initial=0)) + 1) + column, return_inverse=True)
    return found.astype(np.int64)


def _plain(results: ResultTable, column: str, rows: NDArray[np.int64]) -> NDArray[np.int64]:
    return results.codes(column)[0][rows].astype(np.int64) + 1  # empty cells are -1


def _worlds(results: ResultTable, rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """Numbers of the worlds, which are told apart by their content, and their names in this run."""
    contents, _ = results.codes("world")
    named, names = results.codes("world_name")
    by = np.where(contents[rows] >= 0, contents[rows], named[rows]) if len(rows) else contents[rows]
    found, first, codes = np.unique(by, return_index=True, return_inverse=True)
    labels = [names[named[rows[place]]] if named[rows[place]] >= 0 else "no world" for place in first.tolist()]
    return codes.astype(np.int64), tuple(labels[: len(found)])


def _axis(name: str, values: Sequence[Value | None], rows: NDArray[np.int64]) -> AxisColumn:
    own = [values[row] for row in rows.tolist()]
    known = sorted({each for each in own if each is not None}, key=lambda each: (isinstance(each, str), each))
    ordered: list[Value | None] = [*known, *([None] if None in own else [])]
    places = {value: place for place, value in enumerate(ordered)}
    return AxisColumn(name, np.array([places[each] for each in own], dtype=np.int64), tuple(ordered))


def _signatures(
    results: ResultTable, rows: NDArray[np.int64], failed: NDArray[np.bool_]
) -> tuple[Signature | None, ...]:
    texts = results.texts("requirements")
    return tuple(
        signature_of(json.loads(texts[row] or "[]")) if has_failed else None
        for row, has_failed in zip(rows.tolist(), failed.tolist(), strict=True)
    )


def signature_of(requirements: Sequence[Mapping[str, Any]]) -> Signature:
    """Says how a trial failed, by the first requirement that it missed.

    Args:
        requirements: Requirements of the trial, as JSON without defaults.
    """
    missed = [
        each for each in requirements if each.get("counts", True) and not each["satisfied"] and not each.get("error")
    ]
    if not missed:
        return Signature(NO_REQUIREMENT)
    first = min(missed, key=_violated_at_s)
    other = first.get("other")
    kind = other and (_NUMBERED.sub("", other) or other)
    return Signature(first["name"], first.get("room"), kind or None, _phase(requirements, first))


def _violated_at_s(requirement: Mapping[str, Any]) -> float:
    found = requirement.get("first_violation_s")
    return math.inf if found is None else float(found)


def _phase(requirements: Sequence[Mapping[str, Any]], missed: Mapping[str, Any]) -> str | None:
    """Returns the last goal reached before a violation, `after to-kitchen`, or `before` the first; else `None`."""
    goals = [each for each in requirements if each.get("kind") == "goal" and each["name"] != missed["name"]]
    at_s = _violated_at_s(missed)
    reached = [
        each for each in goals if each.get("unit") == "s" and (value := each.get("value")) is not None and value <= at_s
    ]
    if reached:
        return f"after {max(reached, key=lambda each: each['value'])['name']}"
    return f"before {goals[0]['name']}" if goals else None
