"""Pairs of jobs, and of their trials, that two runs have in common."""

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...schemas.reports.changes import PairedTrial
from ...schemas.reports.comparison import PairedJob
from ...schemas.reports.run_record import JobRecord
from ...schemas.runs.axis_kinds.kind import Value
from ...schemas.trial_copies import are_copies, copy_key
from ..reporting import Outcome
from ..results.table import ResultTable
from .compared_runs import HEALTH, JUDGED, TOLD, TRIALS, CellTable, NightRun, name_of, outcome_of, reason_of

Asked = tuple[str, str | None]
"""Name and kind of a requirement; its limit is in the request, since the limit in a result can depend on the run."""


@dataclass(frozen=True)
class Pair:
    """A simulation job that both compared runs have."""

    before: JobRecord
    after: JobRecord

    @property
    def outcomes(self) -> tuple[Outcome, Outcome]:
        """Outcomes of the job in the first run and in the second run."""
        return outcome_of(self.before), outcome_of(self.after)

    @property
    def is_judged(self) -> bool:
        """Whether the job has a verdict (pass or fail) in both runs."""
        return all(outcome in JUDGED for outcome in self.outcomes)

    @property
    def is_told(self) -> bool:
        """Whether the job has a verdict or broke in both runs; a job that was not run to its end has neither."""
        return all(outcome in TOLD for outcome in self.outcomes)

    @property
    def has_same_requirements(self) -> bool:
        """Whether the job was judged by the same requirements in both runs; a job that broke counts as the same."""
        if not self.asks_for_the_same:
            return False
        before, after = _requirements(self.before), _requirements(self.after)
        # Goals that end a run when they are reached make the environment's own not count in that run.
        own = _own(self.before) & _own(self.after)
        return before - own == after - own or (not self.is_judged and not (before and after))

    @property
    def asks_for_the_same(self) -> bool:
        """Whether both job requests contain the same requirements with the same limits."""
        before, after = self.before.inputs, self.after.inputs
        return before is None or after is None or before.requirements_sha256 == after.requirements_sha256

    @property
    def has_same_request(self) -> bool:
        """Whether both job requests are the same, as far as is known: true if either job's inputs are not recorded."""
        before, after = self.before.inputs, self.after.inputs
        if before is None or after is None:
            return True
        more = {each.trials_and_data_sha256 for each in (before, after)} - {None}
        return before.request_sha256 == after.request_sha256 and len(more) < 2

    def told(self) -> PairedJob:
        """Converts the pair to the model that reports contain."""
        before, after = self.outcomes
        return PairedJob(
            cell=name_of(self.after),
            before=before.value,
            after=after.value,
            before_job=self.before.label,
            after_job=self.after.label,
            reason=reason_of(self.after) or reason_of(self.before),
        )


@dataclass(frozen=True)
class Pairing:
    """The simulation jobs of two runs, matched in pairs, with those that only one run has."""

    pairs: list[Pair]
    only_before: list[JobRecord]
    only_after: list[JobRecord]


def pair_jobs(before: Sequence[JobRecord], after: Sequence[JobRecord]) -> Pairing:
    """Matches the simulation jobs of two runs; see `CellTable`."""
    table = CellTable()
    earlier = dict(zip(table.place(before), before, strict=True))
    pairs, only_after = [], []
    for cell, job in zip(table.place(after), after, strict=True):
        if cell is not None and cell in earlier:
            pairs.append(Pair(earlier[cell], job))
        else:
            only_after.append(job)
    paired = {id(pair.before) for pair in pairs}
    return Pairing(pairs, [job for job in before if id(job) not in paired], only_after)


CellPlace = tuple[str, int | None, tuple[tuple[str, Value], ...]]
"""World, seed and values of the other axes: what two cells of an axis have in common."""


def place_beside(job: JobRecord, axis: str, *, with_world: bool = True) -> CellPlace:
    """Returns what a job of a step has in common with those that differ from it in one axis only.

    Args:
        job: The job.
        axis: Name of the axis in which they differ.
        with_world: Whether they have their worlds in common; not so where the axis varies the world.
    """
    others = tuple(sorted((name, value) for name, value in job.axes.items() if name != axis))
    # Without inputs nothing is known of its world and seed, so that it has no partner but itself.
    inputs = job.inputs
    if inputs is None:
        return job.label, None, others
    return (inputs.world or "") if with_world else "", inputs.seed, others


def _own(job: JobRecord) -> frozenset[Asked]:
    """Returns the names of the environment's own requirements, whether they count or not."""
    return frozenset((item.name, None) for item in job.requirements if item.kind is None)


def _requirements(job: JobRecord) -> frozenset[Asked]:
    """Returns the requirements by which a job, or each of its trials, was judged."""
    has_trials = any(item.counts and item.name == TRIALS for item in job.requirements)
    return frozenset(
        (item.name, item.kind) for item in job.requirements if (item.counts or has_trials) and item.kind != HEALTH
    )


PASSED, FAILED, BROKEN, UNJUDGED, STOPPED = range(5)
_CODES = {"passed": PASSED, "failed": FAILED, "broken": BROKEN, "no verdict": UNJUDGED}

ENDED = (PASSED, FAILED, UNJUDGED)
"""Outcomes of trials that ran to their end."""

TrialKey = tuple[float, tuple[tuple[str, Value], ...], int]
"""Seed, values of axes, and a number that distinguishes trials of one job with the same seed and values."""


@dataclass(frozen=True)
class TrialPairs:
    """Trials that both compared runs have, as arrays with one entry for each pair."""

    before: ResultTable
    after: ResultTable
    before_rows: NDArray[np.int64]
    after_rows: NDArray[np.int64]
    jobs: NDArray[np.int64]
    """Index of the job pair to which each trial belongs."""
    worlds: NDArray[np.int64]
    """Number of each trial's world; all jobs without a world have the same number."""

    has_worlds: bool = False
    """Whether any of the jobs used a world."""

    def __len__(self) -> int:
        return len(self.before_rows)

    @cached_property
    def outcomes(self) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
        """Outcome of each trial in the first and the second run, as codes such as `PASSED`, `FAILED` or `BROKEN`."""
        return outcomes_of(self.before)[self.before_rows], outcomes_of(self.after)[self.after_rows]

    @property
    def judged(self) -> NDArray[np.bool_]:
        """Mask of the pairs that have a pass or fail verdict in both runs."""
        before, after = self.outcomes
        return (before <= FAILED) & (after <= FAILED)

    @property
    def told(self) -> NDArray[np.bool_]:
        """Mask of the pairs that have a verdict or broke, in both runs."""
        before, after = self.outcomes
        return (before <= BROKEN) & (after <= BROKEN)

    @property
    def lost_passes(self) -> NDArray[np.int64]:
        """World numbers of trials that passed in the first run and are in none of these pairs.

        Worlds without any pair have numbers below 0.
        """
        codes = self.before.codes("world")[0].astype(np.int64)
        known = dict(zip(codes[self.before_rows].tolist(), self.worlds.tolist(), strict=True))
        lost = np.flatnonzero(outcomes_of(self.before) == PASSED)
        lost = lost[~np.isin(lost, self.before_rows)]
        return np.array([known.get(code, -2 - code) for code in codes[lost].tolist()], dtype=np.int64)

    def only(self, which: NDArray[np.bool_]) -> "TrialPairs":
        """Returns the trial pairs that a mask selects."""
        return TrialPairs(
            self.before, self.after, self.before_rows[which], self.after_rows[which], self.jobs[which],
            self.worlds[which], self.has_worlds,
        )  # fmt: skip

    def named(self, index: int, pairs: "Sequence[Pair]") -> PairedTrial:
        """Returns the name of a pair of trials, with its number in both runs.

        Args:
            index: Index of the pair of trials.
            pairs: The pairs of jobs to which the trials belong.
        """
        pair = pairs[int(self.jobs[index])]
        old, new = int(self.before_rows[index]), int(self.after_rows[index])
        before, after = self.before.numbers("trial")[old], self.after.numbers("trial")[new]
        # The job's title has the axes of its step.
        own = {name: value for name, value in self.after.axes_at(new).items() if name not in pair.after.axes}
        return PairedTrial(
            cell=name_of(pair.after),
            job=pair.after.label,
            trial=None if np.isnan(after) else int(after),
            axes={} if np.isnan(after) else own,
            before_job=pair.before.label,
            before_trial=None if np.isnan(before) else int(before),
        )

    def met(self, requirement: str) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
        """Returns whether each trial met a requirement, in the first and second run: 1 met, 0 missed, -1 not judged."""
        return self.before.met(requirement)[self.before_rows], self.after.met(requirement)[self.after_rows]

    def numbers(self, column: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns a numeric column (`metric.NAME` or `margin.NAME`) of both runs; NaN where a trial has none."""
        return self.before.numbers(column)[self.before_rows], self.after.numbers(column)[self.after_rows]


def pair_trials(
    pairs: Sequence[Pair], before: NightRun, after: NightRun, *, ignoring: Collection[str] = ()
) -> TrialPairs:
    """Matches the trials of two runs by job, seed and axes.

    Two jobs without trials are one pair. Otherwise, trials with the same seed and axes are a pair; if several of one
    job are equal in both, they are matched in order.

    Args:
        pairs: Jobs that both runs have.
        before: First run.
        after: Second run.
        ignoring: Axes whose values do not matter.
    """
    tables = before.results, after.results
    keys = [_keys_of(table, ignoring) for table in tables]
    alone = [np.isnan(table.numbers("trial")) for table in tables]
    worlds: dict[str, int] = {}
    found: list[tuple[int, int, int, int]] = []
    for number, pair in enumerate(pairs):
        old, new = before.results.rows_of(pair.before), after.results.rows_of(pair.after)
        world = (pair.after.inputs and pair.after.inputs.world) or ""
        world_number = worlds.setdefault(world, len(worlds))
        if len(old) == len(new) == 1 and alone[0][old[0]] and alone[1][new[0]]:
            matched = [(old[0], new[0])]
        else:
            rows = dict(_numbered(keys[0], old, alone[0]))
            matched = [(rows[key], row) for key, row in _numbered(keys[1], new, alone[1]) if key in rows]
        found += [(*rows_of_pair, number, world_number) for rows_of_pair in matched]
    columns = np.array(found, dtype=np.int64).reshape(-1, 4).T
    return TrialPairs(before.results, after.results, *columns, has_worlds=any(worlds))


def each_once(
    trials: TrialPairs, before_states: Sequence[str | None], after_states: Sequence[str | None]
) -> TrialPairs:
    """Returns the pairs without those that repeat another one of their world, state by state.

    They do where a seed or an axis changes nothing, and would count the same evidence again. Pairs that ended
    otherwise, as jobs with other requirements may, are no repetition.

    Args:
        trials: The pairs.
        before_states: Digest of all states of each row of the first table; None where it is not known.
        after_states: The same of the second table.
    """
    old = (before_states[row] for row in trials.before_rows.tolist())
    new = (after_states[row] for row in trials.after_rows.tolist())
    ended = zip(trials.worlds.tolist(), *(codes.tolist() for codes in trials.outcomes), strict=True)
    keys = [copy_key(states_of_pair(*states), *each) for *states, each in zip(old, new, ended, strict=True)]
    return trials.only(~np.array(are_copies(keys), dtype=bool))


def states_of_pair(before: str | None, after: str | None) -> tuple[str, str] | None:
    """Returns the digests of both trials of a pair; `None` if one of them is not known."""
    return None if before is None or after is None else (before, after)


def copies_in_words(count: int) -> str:
    """Says that pairs repeat others: `2 pairs repeat another pair state by state and do not count`."""
    if count == 1:
        return "1 pair repeats another pair state by state and does not count"
    return f"{count} pairs repeat another pair state by state and do not count"


def outcomes_of(table: ResultTable) -> NDArray[np.int8]:
    """Returns the outcome of each trial of a run, as codes such as `PASSED`."""
    codes, names = table.codes("outcome")
    known = np.array([_CODES.get(name, STOPPED) for name in names], dtype=np.int8)
    return known[codes] if len(codes) else np.zeros(0, np.int8)


def _keys_of(table: ResultTable, ignoring: Collection[str]) -> list[tuple[float, tuple[tuple[str, Value], ...]]]:
    """Returns seed and axis values of each trial, by which trials are matched."""
    seeds = table.numbers("seed").tolist()
    names = sorted(set(table.axes).difference(ignoring))
    if not names:
        return [(seed, ()) for seed in seeds]
    values = zip(*(table.values(name) for name in names), strict=True)
    return [
        (seed, tuple((name, value) for name, value in zip(names, row, strict=True) if value is not None))
        for seed, row in zip(seeds, values, strict=True)
    ]


def _numbered(
    keys: Sequence[tuple[float, tuple[tuple[str, Value], ...]]], rows: range, alone: NDArray[np.bool_]
) -> Iterator[tuple[TrialKey, int]]:
    """Yields the rows of a job's trials with their keys, without the row of a failure between two trials."""
    seen: Counter[tuple[float, tuple[tuple[str, Value], ...]]] = Counter()
    for row in rows:
        key = keys[row]
        if len(rows) > 1 and alone[row]:
            continue
        yield (*key, seen[key]), row
        seen[key] += 1
