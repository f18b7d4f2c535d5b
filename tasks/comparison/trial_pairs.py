"""Pairs of trials of two runs, as arrays: trials of paired jobs with the same seed and parameters."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..results.table import ResultTable
from .nights import NightRun
from .pairing import Pair

PASSED, FAILED, BROKEN, UNJUDGED, STOPPED = range(5)
_CODES = {"passed": PASSED, "failed": FAILED, "broken": BROKEN, "no verdict": UNJUDGED}

ENDED = (PASSED, FAILED, UNJUDGED)
"""Outcomes of trials that came to their end."""

TrialKey = tuple[float, tuple[tuple[str, str], ...], int]
"""Seed, parameters, and which of the trials of one job that have the same."""


@dataclass(frozen=True)
class TrialPairs:
    """Trials of both runs; all arrays have one entry a pair."""

    before: ResultTable
    after: ResultTable
    before_rows: NDArray[np.int64]
    after_rows: NDArray[np.int64]
    jobs: NDArray[np.int64]
    """The pair of jobs that it belongs to."""
    worlds: NDArray[np.int64]
    """Number of the world; all jobs without a world have the same."""

    has_worlds: bool = False
    """Whether any of their jobs drove in a world."""

    def __len__(self) -> int:
        return len(self.before_rows)

    @cached_property
    def outcomes(self) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
        """How each trial ended in either run: `PASSED`, `FAILED`, `BROKEN`, `UNJUDGED` or `STOPPED`."""
        return _outcomes(self.before)[self.before_rows], _outcomes(self.after)[self.after_rows]

    @property
    def judged(self) -> NDArray[np.bool_]:
        """The pairs that have a verdict about the robot in both runs."""
        before, after = self.outcomes
        return (before <= FAILED) & (after <= FAILED)

    @property
    def told(self) -> NDArray[np.bool_]:
        """The pairs that were judged or broke, in both runs."""
        before, after = self.outcomes
        return (before <= BROKEN) & (after <= BROKEN)

    def only(self, which: NDArray[np.bool_]) -> "TrialPairs":
        """Some of the pairs."""
        return TrialPairs(
            self.before, self.after, self.before_rows[which], self.after_rows[which], self.jobs[which],
            self.worlds[which], self.has_worlds,
        )  # fmt: skip

    def met(self, requirement: str) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
        """Whether a requirement was met in either run: 1 met, 0 missed, -1 not judged."""
        return self.before.met(requirement)[self.before_rows], self.after.met(requirement)[self.after_rows]

    def numbers(self, column: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The numbers of a column in either run, `metric.NAME` or `margin.NAME`; NaN where a trial has none."""
        return self.before.numbers(column)[self.before_rows], self.after.numbers(column)[self.after_rows]


def pair_trials(pairs: Sequence[Pair], before: NightRun, after: NightRun) -> TrialPairs:
    """Finds the trials that two runs have in common.

    Two jobs without trials are one pair. Of others, trials with the same seed and parameters are; where several of one
    job have both, they are taken in their order.

    Args:
        pairs: the jobs of both runs.
        before: the first run.
        after: the second run.
    """
    tables = before.results, after.results
    keys = [_keys_of(table) for table in tables]
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


def _outcomes(table: ResultTable) -> NDArray[np.int8]:
    codes, names = table.codes("outcome")
    known = np.array([_CODES.get(name, STOPPED) for name in names], dtype=np.int8)
    return known[codes] if len(codes) else np.zeros(0, np.int8)


def _keys_of(table: ResultTable) -> list[tuple[float, tuple[tuple[str, str], ...]]]:
    """Seed and parameters of each row."""
    seeds = table.numbers("seed").tolist()
    names = sorted(table.parameters)
    if not names:
        return [(seed, ()) for seed in seeds]
    values = zip(*(table.texts(f"parameter.{name}") for name in names), strict=True)
    return [
        (seed, tuple((name, value) for name, value in zip(names, row, strict=True) if value is not None))
        for seed, row in zip(seeds, values, strict=True)
    ]


def _numbered(
    keys: Sequence[tuple[float, tuple[tuple[str, str], ...]]], rows: range, alone: NDArray[np.bool_]
) -> Iterator[tuple[TrialKey, int]]:
    """The trials of a job, by what tells them apart; a row that says that the job broke between them is none."""
    seen: Counter[tuple[float, tuple[tuple[str, str], ...]]] = Counter()
    for row in rows:
        key = keys[row]
        if len(rows) > 1 and alone[row]:
            continue
        yield (*key, seen[key]), row
        seen[key] += 1
