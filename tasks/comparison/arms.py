"""Axes of a run's steps: pass rates by value, and the first value against each other one in pairs of trials.

Two trials are a pair if they differ in nothing but the axis: they are of one step, drove in worlds of the same content,
and have the same seed and the same values of all other axes, those of trials too. So there are pairs where an axis
lists values, such as robots or versions; points of a spread design differ in all axes, and have none.

An axis may vary the world itself, such as its doors. Its pairs share seed and all other axes, with which goes the base
world; pairs that share a world are alike, and count as one cluster.
"""

from collections import Counter
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from ...schemas.reports.comparison import USUAL_DIFFERENCE, RateChange
from ...schemas.reports.live_comparison import FEWEST_WORLDS, Answer
from ...schemas.reports.report import ArmComparison, AxisResult, Share
from ...schemas.reports.run_record import JobRecord
from ...schemas.runs.axes import value_text
from ...schemas.runs.axis_kinds.kind import BINS, Value
from ...schemas.specs.batch_splitting import step_of
from ...schemas.wire.common import counted
from ..results.rates import Counts, trial_keys
from .compared_runs import NightRun
from .difference_test import ASSUMED_SHARE, FEWEST_PAIRS, JudgedTrials, pairs_for, rate_change
from .pairing import (
    BROKEN,
    FAILED,
    PASSED,
    CellPlace,
    Pair,
    TrialPairs,
    copies_in_words,
    each_once,
    outcomes_of,
    pair_trials,
    place_beside,
)
from .statistics.e_processes import fewest_worlds

ALPHA = 0.05
"""Error probability of all comparisons of a run together, and of those of each axis that varies the world."""
MOST_COMPARED = 20
"""Values of an axis that are compared with its first one; with more, Holm's method finds little."""
MOST_SHOWN = 50
"""Values of an axis that have a row of their own."""


def axis_results(run: NightRun, digests: Mapping[str, str], *, between_worlds: bool = False) -> list[AxisResult]:
    """Returns the results of a run by the axes of its steps; empty where no step has axes.

    Args:
        run: The run, with its table of results.
        digests: Digests of all states of jobs without trials, by label.
        between_worlds: Whether worlds that are the values of an axis are compared, too, as they are on request only.
    """
    steps: dict[str, list[JobRecord]] = {}
    for job in run.jobs:
        if job.axes:
            steps.setdefault(step_of(job.step or ""), []).append(job)
    states = run.results.states_of(run.jobs, digests) if steps else []
    axes = [
        _Axis(run, step, jobs, name, states, between_worlds)
        for step, jobs in steps.items()
        for name in dict.fromkeys(name for job in jobs for name in job.axes)
    ]
    found = [(axis, [*axis.compared()]) for axis in axes]
    adjusted = _adjusted([arms for _, arms in found])
    return [
        AxisResult(
            step=axis.step,
            axis=axis.name,
            shares=axis.shares(),
            comparisons=[_told(axis, arm, *adjusted[id(arm)]) for arm in arms],
            note=axis.note(len(arms)),
        )
        for axis, arms in found
    ]


@dataclass(frozen=True)
class _Arm:
    """Two values of an axis with their pairs."""

    baseline: Value
    value: Value
    trials: TrialPairs
    fair: TrialPairs
    """Pairs that were judged by the same requirements, each once."""
    unfair: int
    """Number of pairs that were judged by different ones."""
    repeated: int
    """Number of pairs that went through the same states as another pair: they show nothing more."""
    unpaired: int
    of_two_worlds: int
    """Number of pairs whose sides drove in different worlds, as the axis varies the world."""
    same_states: bool
    judged: JudgedTrials
    rate: RateChange | None
    """Pass rates of the pairs that were judged; None: none was."""
    strict: RateChange | None
    """The same if what broke counts as failed."""


@dataclass(frozen=True)
class _Axis:
    """One axis of a step, with the step's jobs."""

    run: NightRun
    step: str
    jobs: Sequence[JobRecord]
    name: str
    states: Sequence[str | None]
    """Digest of all states of each row of the table."""
    between_worlds: bool = False
    """Whether fewer worlds than a sample are compared."""

    @property
    def values(self) -> list[Value]:
        """The different values of one axis, in the order of the jobs."""
        return [*dict.fromkeys(job.axes[self.name] for job in self.jobs if self.name in job.axes)]

    def shares(self) -> list[Share]:
        """Pass rates by value, or by fifths of numbers that are too many."""
        values = self.values
        numbers = [value for value in values if isinstance(value, float)]
        if len(numbers) == len(values) > MOST_SHOWN:
            edges = np.quantile(numbers, np.linspace(0, 1, BINS + 1)).tolist()
            parts = np.clip(np.searchsorted(edges, numbers, side="right") - 1, 0, BINS - 1).tolist()
            of_part = dict(zip(numbers, parts, strict=True))
            names = [f"{value_text(low)} to {value_text(high)}" for low, high in pairwise(edges)]
            groups = [(names[part], {v for v in numbers if of_part[v] == part}) for part in range(BINS)]
        else:  # no mapping by names, as two values may look alike: 1 and "1"
            groups = [(self.shown(value), {value}) for value in values[:MOST_SHOWN]]
        return [self._share(name, found) for name, found in groups]

    def compared(self) -> Iterator[_Arm]:
        """Yields the comparisons of an axis's first value with each other one that has pairs with it."""
        values = [] if self._is_of_worlds else self.values
        for value in values[1 : MOST_COMPARED + 1]:
            arm = self._arm(values[0], value)
            if arm is not None:
                yield arm

    def note(self, compared: int) -> str:
        """Says why there are no comparisons, or that some values have none."""
        values = len(self.values)
        if values > len(self.shares()) == MOST_SHOWN:
            rest = self._compared_in_words(compared)
            return f"{values - MOST_SHOWN} more values have no row{rest and '; ' + rest}"
        return self._compared_in_words(compared)

    def _compared_in_words(self, compared: int) -> str:
        values = len(self.values)
        if values < 2:
            return "all jobs have the same value of it: there is nothing to compare"
        if self._is_of_worlds and values >= FEWEST_WORLDS:
            return f"its {values} values are worlds, too many to be compared each with the first one"
        if self._is_of_worlds:
            return f"its {values} values are worlds, which are compared on request only"
        if not compared:
            return "no two trials differ in it alone (same world, seed and other axes), so that there are no pairs"
        left = values - 1 - compared
        return f"{left} more value{'s are' if left > 1 else ' is'} not compared" if left else ""

    def shown(self, value: Value) -> str:
        """A value in words; of a world, which has the name of its content, the name that it has in this run."""
        return self._worlds.get(value, value_text(value))

    @property
    def _worlds(self) -> dict[Value, str]:
        return {
            job.inputs.world: job.world_title
            for job in self.jobs
            if job.inputs and job.inputs.world and job.world_title
        }

    @property
    def _is_of_worlds(self) -> bool:
        """Whether its values are worlds, which are not compared; fewer than tell of worlds of their kind may be."""
        values = self.values
        is_sample = len(values) >= FEWEST_WORLDS
        return (is_sample or not self.between_worlds) and self._worlds.keys() >= set(values)

    def _share(self, name: str, values: Container[object]) -> Share:
        rows = [row for job in self.jobs if job.axes.get(self.name) in values for row in self.run.results.rows_of(job)]
        codes = outcomes_of(self.run.results)[rows].tolist() if rows else []
        keys = [self._keys[row] for row in rows]
        judged = ((code == PASSED, key) for code, key in zip(codes, keys, strict=True) if code in (PASSED, FAILED))
        return Counts.of(judged, codes.count(BROKEN)).share(name)

    @cached_property
    def _keys(self) -> list[int | None]:
        return trial_keys(self.run.results, outcomes_of(self.run.results).tolist(), self.states)

    def _arm(self, baseline: Value, value: Value) -> _Arm | None:
        pairs = self._pairs(baseline, value)
        if not pairs:
            return None
        trials = pair_trials(pairs, self.run, self.run, ignoring=self._of_step)
        worlds = [(_world_of(pair.before), _world_of(pair.after)) for pair in pairs]
        clusters = np.array(joined(worlds), dtype=np.int64)
        trials = replace(trials, worlds=clusters[trials.jobs])
        is_fair = np.array([pair.has_same_requirements for pair in pairs], dtype=bool)
        fair = each_once(trials.only(is_fair[trials.jobs]), self.states, self.states)
        judged = _judged(fair.only(fair.judged))
        here = [job for job in self.jobs if job.axes.get(self.name) in (baseline, value)]
        return _Arm(
            baseline,
            value,
            trials,
            fair,
            unfair=int((~is_fair[trials.jobs]).sum()),
            repeated=len(trials.only(is_fair[trials.jobs])) - len(fair),
            unpaired=sum(len(self.run.results.rows_of(job)) for job in here) - 2 * len(trials),
            of_two_worlds=sum(worlds[job][0] != worlds[job][1] for job in trials.jobs.tolist()),
            same_states=self._went_the_same_way(trials),
            judged=judged,
            rate=_rate(judged),
            strict=_rate(_judged(fair.only(fair.told))),
        )

    def _went_the_same_way(self, trials: TrialPairs) -> bool:
        """Whether both trials of each pair went through the same states; False where that is not known."""
        rows = zip(trials.before_rows.tolist(), trials.after_rows.tolist(), strict=True)
        return len(trials) > 0 and all(
            self.states[old] is not None and self.states[old] == self.states[new] for old, new in rows
        )

    def _pairs(self, baseline: Value, value: Value) -> list[Pair]:
        """Pairs of jobs in the same world; where there are none, the axis varies the world, and they share all else."""
        for with_world in (True, False):
            first, other = (self._placed(each, with_world=with_world) for each in (baseline, value))
            if pairs := [Pair(first[place], job) for place, job in other.items() if place in first]:
                return pairs
        return []

    def _placed(self, value: Value, *, with_world: bool) -> dict[tuple[CellPlace, int], JobRecord]:
        """Returns the jobs of a value by their place, and a number that keeps those of one place apart.

        As with trials of one seed: the first of a place has the first one there as its partner, the second the second.
        """
        jobs = [job for job in self.jobs if job.axes.get(self.name) == value]
        places = [place_beside(job, self.name, with_world=with_world) for job in jobs]
        times, before = Counter(places), Counter[CellPlace]()
        placed: dict[tuple[CellPlace, int], JobRecord] = {}
        for place, job in zip(places, jobs, strict=True):
            # Jobs of one place in several worlds do not have theirs from the axes: nothing says which are a pair.
            if with_world or times[place] == 1:
                placed[place, before[place]] = job
            before[place] += 1
        return placed

    @property
    def _of_step(self) -> set[str]:
        return {name for job in self.jobs for name in job.axes}


def joined(links: Sequence[tuple[str, str]]) -> list[int]:
    """Numbers the clusters that links make: those that share an end, directly or through others, are one.

    Args:
        links: Both ends of each link.

    Returns:
        For each link the number of its cluster, from 0.
    """
    leads: dict[str, str] = {}

    def root(end: str) -> str:
        while (above := leads.setdefault(end, end)) != end:
            end = above
        return end

    for one, other in links:
        leads[root(one)] = root(other)
    numbers: dict[str, int] = {}
    return [numbers.setdefault(root(one), len(numbers)) for one, _ in links]


def _world_of(job: JobRecord) -> str:
    return (job.inputs and job.inputs.world) or ""


def _judged(trials: TrialPairs) -> JudgedTrials:
    old, new = trials.outcomes
    return JudgedTrials(old == PASSED, new == PASSED, trials.worlds, fewest_worlds(ALPHA))


def _rate(judged: JudgedTrials) -> RateChange | None:
    return rate_change(judged, ALPHA) if len(judged) else None


def _adjusted(axes: Sequence[Sequence[_Arm]]) -> dict[int, tuple[float | None, Answer, int]]:
    """The p-value of each comparison by Holm's method, its answer, and the number of comparisons with which it is made.

    The answer is the same with what broke left out and failed.

    Comparisons between worlds are corrected with those of their own axis: a list of worlds makes no other one weaker.
    """
    told: dict[int, tuple[float | None, Answer, int]] = {}
    of_one = [arm for arms in axes for arm in arms if not arm.of_two_worlds]
    for family in (of_one, *([arm for arm in arms if arm.of_two_worlds] for arms in axes)):
        without, failed = (_answers(rates) for rates in ([arm.rate for arm in family], [arm.strict for arm in family]))
        for arm, (p_value, answer), (_, if_failed) in zip(family, without, failed, strict=True):
            told[id(arm)] = p_value, answer if answer == if_failed else "not comparable", len(family)
    return told


def _answers(rates: Sequence[RateChange | None]) -> list[tuple[float | None, Answer]]:
    adjusted = iter(holm_adjusted([rate.p_value for rate in rates if rate is not None]))
    return [_answer(rate, next(adjusted)) if rate is not None else (None, "not comparable") for rate in rates]


def _answer(rate: RateChange, p_value: float) -> tuple[float | None, Answer]:
    if p_value > ALPHA:
        return p_value, "no difference shown"
    return p_value, "better" if rate.difference > 0 else "worse"


def _told(axis: _Axis, arm: _Arm, p_value: float | None, answer: Answer, tests: int) -> ArmComparison:
    told = ArmComparison(
        baseline=axis.shown(arm.baseline),
        value=axis.shown(arm.value),
        answer=answer,
        why="",
        pairs=len(arm.trials),
        unpaired=arm.unpaired,
        unjudged=int((~arm.fair.judged).sum()),
        repeated=arm.repeated,
        of_two_worlds=arm.of_two_worlds,
        other_requirements=arm.unfair,
        adjusted_p_value=p_value,
        same_states=arm.same_states,
        rate=arm.rate,
    )
    more = f"; {_what_would_tell(arm, tests)}" if told.is_open else ""
    return told.model_copy(update={"why": _why(arm, p_value, answer, more)})


def _what_would_tell(arm: _Arm, tests: int) -> str:
    """Says how far pairs went the same way, and how many more would show such a difference, or one of 10 points.

    Args:
        arm: The two values.
        tests: Number of tests that share their error by Holm's method; the surest of them has this part of it.
    """
    changes, pairs = arm.judged.change, len(arm.judged)
    differ, found = int(np.count_nonzero(changes)), abs(int(changes.sum())) / pairs
    difference = found or USUAL_DIFFERENCE
    by_worlds = arm.judged.by_world(changes * (1 if changes.sum() >= 0 else -1)) if arm.judged.flips_worlds else None
    share = differ / pairs if differ and pairs >= FEWEST_PAIRS else ASSUMED_SHARE  # as between two runs
    needed, worlds = pairs_for(difference, share, ALPHA / tests, by_worlds, is_margin=False)
    most = max(int((changes > 0).sum()), int((changes < 0).sum()))
    way = f"{most} of {differ} that differ went the same way" if differ else "none of them differ"
    more = counted(max(1, needed - pairs), "more pair")
    shown = "it" if found else f"a difference of {100 * difference:.3g} points"
    in_all = f", for {counted(worlds, 'world')} in all," if worlds else ""
    return f"{way}; {more}{in_all} would show {shown}"


def _why(arm: _Arm, p_value: float | None, answer: Answer, more: str) -> str:
    """Returns the reason of an answer about two values of an axis; the p-value is adjusted already, None: no pair."""
    if arm.rate is None:
        words = f"none of {counted(len(arm.trials), 'pair')} was judged on both sides by the same requirements"
    elif answer == "not comparable":
        words = f"the answer depends on {counted(int((~arm.fair.judged).sum()), 'pair')} of which a side broke"
    else:
        words = f"{counted(arm.rate.pairs, 'pair')} judged, p = {p_value:.2g} ({arm.rate.test} test, Holm's method)"
        if arm.rate.pairs > arm.rate.worlds and arm.rate.test == "exact McNemar" and answer != "no difference shown":
            words += ", in these worlds; others were not tried"
    words += more
    if arm.of_two_worlds:
        words += f"; the sides of {counted(arm.of_two_worlds, 'pair')} drove in different worlds, as the axis varies it"
    if arm.same_states:
        words += "; both sides of each pair went through the same states: the axis changes nothing"
    if arm.repeated:
        words += f"; {copies_in_words(arm.repeated)}"
    if arm.unfair:
        words += f"; {counted(arm.unfair, 'pair')} judged by different requirements do not count"
    if arm.unpaired:
        words += f"; {counted(arm.unpaired, 'trial')} without a partner"
    return words


def holm_adjusted(p_values: Sequence[float]) -> list[float]:
    """Adjusts the p-values of several tests by Holm's method, so that all of them together have the error of one.

    Holm, "A simple sequentially rejective multiple test procedure", Scandinavian Journal of Statistics 6 (1979).

    Args:
        p_values: P-value of each test.

    Returns:
        The adjusted ones in the same order, each at least the given one and at most 1.
    """
    adjusted = [1.0] * len(p_values)
    largest = 0.0
    for rank, place in enumerate(sorted(range(len(p_values)), key=p_values.__getitem__)):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[place]))
        adjusted[place] = largest
    return adjusted
