"""Comparison of two runs: whether the second one is better, worse, not different, or not comparable.

The answer is about verdicts of trials; a job without trials counts as one trial. Whether a higher metric is better is
for the user to decide.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...schemas.reports.changes import LargestFall, MetricChange
from ...schemas.reports.comparison import ComparedRun, Comparison, MarginTest, PairedJob, RateChange
from ...schemas.reports.live_comparison import Answer
from ...schemas.reports.run_exit_codes import ANSWER_EXIT_CODES
from ...schemas.wire.common import counted
from ..reporting import Outcome
from ..results.rates import margin_units, units_if_met
from .compared_runs import NightRun, outcome_of
from .difference_test import JudgedTrials, mean_change, needed_pairs, rate_change
from .early_stops import answer_while_running
from .failure_starts import appearances_of, changed_nights, changed_versions
from .loss_causes import why_no_trials
from .losses import losses_of, told_losses
from .pairing import ENDED, PASSED, Pair, Pairing, TrialPairs, copies_in_words, each_once, pair_jobs, pair_trials
from .requirement_changes import RequirementChanges, requirement_changes
from .statistics.e_processes import fewest_worlds

_LOOKS_THE_SAME = 1e-4
"""Share of a value up to which a difference does not show, as numbers are shown with four digits."""
_LARGEST = 1e100
"""Absolute value from which numbers are left out of means, as their squares are not finite."""


def compare(
    before: NightRun,
    after: NightRun,
    *,
    alpha: float = 0.05,
    difference: float | None = None,
    margin: float | None = None,
) -> Comparison:
    """Compares two runs of a specification by a statistical test: did the robot get better, worse, or is it unclear?

    The answer is that of a test of the trials that were judged in both runs: the exact McNemar test, or where six
    worlds or more have several trials, the test that flips whole worlds. Trials that broke are not judged; where
    counting them as failed would change the answer, the runs are not comparable. A run that was looked at while it
    ran, beside the first one, has the answer of its e-values.

    Args:
        before: First run.
        after: Second run.
        alpha: Error probability of the test; the intervals of all metrics together have it too (Bonferroni).
        difference: Difference of pass rates for which `needed` is computed, a share from 0 to 1; None: the observed
            one.
        margin: Relevant decrease of the pass rate, a share from 0 to 1; if given, a second run that is shown to have
            decreased by less is "not worse".

    Returns:
        The answer, with what it rests on.
    """
    pairing = pair_jobs(before.jobs, after.jobs)
    trials = pair_trials(pairing.pairs, before, after)
    is_fair, shared = _fair(pairing, trials)
    fair = _each_once(shared)
    judged = _judged(fair.only(fair.judged), alpha)
    looked_at = answer_while_running(before, after, alpha, margin)
    rate = rate_change(judged, alpha, margin) if len(judged) and looked_at is None else None
    answer, why = looked_at or _answer(before, after, pairing, fair, judged, rate, alpha)
    if (
        looked_at is None
        and answer == "not worse"
        and (open_question := _depends_on_lost(judged, shared, alpha, margin))
    ):
        answer, why = "not comparable", open_question
    if rate is not None and (repeated := len(shared) - len(fair)):
        why += f"; {copies_in_words(repeated)}"
    ended = np.array([pair.is_told for pair in pairing.pairs], dtype=bool)
    # The same as the run's report.
    versions = changed_versions(before, after)
    requirements = requirement_changes(trials.only(ended[trials.jobs]), pairing.pairs, versions)
    told = [(_told(pair, requirements), pair.outcomes) for pair in pairing.pairs]
    comparison = Comparison(
        before=_compared(before),
        after=_compared(after),
        answer=answer,
        exit_code=ANSWER_EXIT_CODES[answer],
        why=why,
        alpha=alpha,
        changed=changed_nights(before, after),
        pairs=len(pairing.pairs),
        only_before=len(pairing.only_before),
        only_after=len(pairing.only_after),
        trials=len(trials),
        identical=_identical(fair.only(fair.judged)),
        trials_only_before=len(before.results) - len(trials),
        trials_only_after=len(after.results) - len(trials),
        unjudged=int((~trials.judged).sum()),
        other_requirements=int((~is_fair).sum()),
        other_requests=sum(not pair.has_same_request for pair in pairing.pairs),
        troubles=[run.trouble for run in (before, after) if run.trouble],
        requirements=requirements.changes,
        newly_failing=[pair for pair, (old, new) in told if old is Outcome.PASSED and new.is_failure],
        newly_passing=[pair for pair, (old, new) in told if old.is_failure and new is Outcome.PASSED],
        still_failing=[pair for pair, (old, new) in told if old.is_failure and new.is_failure],
        rate=rate,
        e_values=after.against.e_values if after.against and looked_at else {},
        metrics=_changes("metric", trials, pairing.pairs, alpha) if looked_at is None else [],
        margins=_changes("margin", fair, pairing.pairs, alpha) if looked_at is None else [],
        **dict(told_losses(losses_of([before, after], appearances_of([before, after])))),
    )
    if rate is None or answer != "no difference shown" or comparison.is_unchanged:
        return comparison
    needed = needed_pairs(judged, (before.run_id, after.run_id), alpha, difference, margin)
    return comparison.model_copy(update={"needed": needed})


def judged_pairs(before: NightRun, after: NightRun, alpha: float = 0.05) -> JudgedTrials:
    """Returns the pairs of trials that were judged in both of two runs, and by the same requirements."""
    fair = _fair_trials(before, after)[1]
    return _judged(fair.only(fair.judged), alpha)


def fallen_margins(before: NightRun, after: NightRun, alpha: float = 0.05) -> list[MetricChange]:
    """Returns the margins of requirements that fell on average between two runs, as their comparison has them.

    The list is empty if the second run was looked at while it ran beside the first one: its trials are no fixed number.
    """
    if answer_while_running(before, after, alpha, None) is not None:
        return []
    pairing, fair = _fair_trials(before, after)
    return [each for each in _changes("margin", fair, pairing.pairs, alpha) if each.has_fallen]


def _fair_trials(before: NightRun, after: NightRun) -> tuple[Pairing, TrialPairs]:
    """Returns the pairs of jobs, and their pairs of trials that were judged by the same requirements, each once."""
    pairing = pair_jobs(before.jobs, after.jobs)
    return pairing, _each_once(_fair(pairing, pair_trials(pairing.pairs, before, after))[1])


def _fair(pairing: Pairing, trials: TrialPairs) -> tuple[NDArray[np.bool_], TrialPairs]:
    """Returns a mask of the job pairs with the same requirements in both runs, and those jobs' trial pairs."""
    is_fair = np.array([pair.has_same_requirements for pair in pairing.pairs], dtype=bool)
    return is_fair, trials.only(is_fair[trials.jobs])


def _identical(trials: TrialPairs) -> int:
    """Counts the pairs whose states have the same digest, taken until the same time."""
    old, new = (
        list(zip(table.texts("state_digest"), table.numbers("digest_until_s").tolist(), strict=True))
        for table in (trials.before, trials.after)
    )
    pairs = zip(trials.before_rows.tolist(), trials.after_rows.tolist(), strict=True)
    return sum(old[a][0] is not None and _are_same(old[a], new[b]) for a, b in pairs)


def _are_same(one: tuple[str | None, float], other: tuple[str | None, float]) -> bool:
    return one[0] == other[0] and (one[1] == other[1] or (math.isnan(one[1]) and math.isnan(other[1])))


def _each_once(trials: TrialPairs) -> TrialPairs:
    before, after = (table.texts("state_digest") for table in (trials.before, trials.after))
    return each_once(trials, before, after)


def _told(pair: Pair, requirements: RequirementChanges) -> PairedJob:
    return pair.told().model_copy(update={"newly_missed": requirements.missed_by(pair.after)})


def _judged(trials: TrialPairs, alpha: float) -> JudgedTrials:
    """Makes the judged pairs of trials; trials that did not pass count as failed."""
    old, new = trials.outcomes
    return JudgedTrials(old == PASSED, new == PASSED, trials.worlds, fewest_worlds(alpha))


def _compared(run: NightRun) -> ComparedRun:
    return ComparedRun(
        run_id=run.run_id,
        name=run.name,
        started_at=run.started_at,
        jobs=len(run.jobs),
        parameters=run.parameters,
        source=run.source,
    )


def _answer(
    before: NightRun,
    after: NightRun,
    pairing: Pairing,
    fair: TrialPairs,
    judged: JudgedTrials,
    rate: RateChange | None,
    alpha: float,
) -> tuple[Answer, str]:
    """Returns the answer of a comparison of two runs, and the reason for it in words.

    It is "not comparable" if no trials are paired, none was judged in both runs, or the answer depends on what broke.
    """
    if not pairing.pairs:
        return "not comparable", _why_unpaired(before, after)
    if not len(fair):
        if any(pair.has_same_requirements for pair in pairing.pairs):
            return "not comparable", why_no_trials(before, after)
        return "not comparable", (
            f"{counted(len(pairing.pairs), 'pair')} of jobs, all judged by different requirements: a verdict says "
            "whether they were met, so that one of other requirements says something else"
        )
    if rate is None:
        return "not comparable", (
            f"none of the {counted(len(fair), 'pair')} was judged in both runs: {_without_verdicts(before, after)}"
        )
    answer = _tested(rate, alpha)
    told = _judged(fair.only(fair.told), alpha)
    broken = len(told) - rate.pairs
    margin = rate.margin.margin if rate.margin else None
    if broken and (strict := _tested(rate_change(told, alpha, margin), alpha)) != answer:
        return "not comparable", (
            f"the answer depends on the {counted(broken, 'pair')} of which a side broke: {answer} when they are left "
            f"out, {strict} when what broke counts as failed; repair that and run it again"
        )
    scope = _scope(judged, fair) if answer != "no difference shown" else ""
    words = _judged_in_words(judged, fair)
    about = f"; {_margin_in_words(rate.margin)}" if rate.margin else ""
    return answer, f"{words}, p = {rate.p_value:.2g} ({rate.test} test, alpha {alpha:g}){about}{scope}"


def _margin_in_words(test: MarginTest) -> str:
    """Returns a text on whether it is shown that the pass rate fell by less than the margin.

    An example: `the pass rate did not fall by 5 points or more (p = 0.012, Tango's score test)`.
    """
    by = f"p = {test.p_value:.2g}, {test.test} test" if test.p_value is not None else test.test
    points = f"{100 * test.margin:.3g} points"
    if test.outcome == "shown":
        return f"the pass rate did not fall by {points} or more ({by})"
    return f"a fall by {points} or more is not excluded ({by})"


def _depends_on_lost(judged: JudgedTrials, fair: TrialPairs, alpha: float, margin: float | None) -> str:
    """Returns a warning if missing trials that passed in the first run could hide a fall by the margin; else empty."""
    worlds = fair.only(fair.told).lost_passes
    if not (lost := len(worlds)):
        return ""
    worst = JudgedTrials(
        np.concatenate([judged.before, np.ones(lost, dtype=np.bool_)]),
        np.concatenate([judged.after, np.zeros(lost, dtype=np.bool_)]),
        np.concatenate([judged.worlds, worlds]),
        judged.fewest_worlds,
    )
    if _tested(rate_change(worst, alpha, margin), alpha) in ("not worse", "better"):
        return ""
    return (
        f"{counted(lost, 'trial')} that passed in the first run have no verdict by the same requirements in the "
        "second; if they failed, a fall by the margin would not be excluded: run them too"
    )


def _judged_in_words(judged: JudgedTrials, fair: TrialPairs) -> str:
    words = f"{counted(len(judged), 'pair')} judged in both runs"
    if not fair.has_worlds or not judged.has_repeated_worlds:
        return words
    worlds = f"{words}, in {counted(judged.world_count, 'world')}"
    return f"{worlds} of which {judged.changed_worlds} changed" if judged.flips_worlds else worlds


def _scope(judged: JudgedTrials, fair: TrialPairs) -> str:
    """Returns a note on where an answer holds, if there are too few worlds to generalise; empty without worlds."""
    if not judged.is_of_few_worlds or not fair.has_worlds:
        return ""
    these = "this world" if judged.world_count == 1 else "these worlds"
    return f"; it holds in {these}, as other worlds were not tried"


def _tested(rate: RateChange, alpha: float) -> Answer:
    differs = rate.p_value <= alpha
    if differs and rate.difference > 0:
        return "better"
    if rate.margin is not None and rate.margin.outcome == "shown":
        return "not worse"  # by as much as matters, also where it is shown to be a little worse
    return "worse" if differs else "no difference shown"


def _changes(kind: str, trials: TrialPairs, jobs: Sequence[Pair], alpha: float) -> list[MetricChange]:
    """Returns changes of metrics or margins of trials that ended by themselves, changed ones first.

    All intervals hold together with probability 1 - alpha. Values that are not finite are left out.

    Args:
        kind: `metric` or `margin`.
        trials: The pairs of trials.
        jobs: The pairs of jobs that they belong to.
        alpha: Error probability of all intervals together.
    """
    old, new = trials.outcomes
    ended = trials.only(np.isin(old, ENDED) & np.isin(new, ENDED))
    found = {}
    if_met = {} if kind == "metric" else _if_met(trials)
    names = dict.fromkeys(trials.after.metrics) if kind == "metric" else _with_margins(trials) | if_met
    for name in sorted(names):
        values = ended.numbers(f"{kind}.{name}")
        finite = np.isfinite(values[0]) & np.isfinite(values[1]) & (np.abs(values).max(axis=0) < _LARGEST)
        if name in if_met:
            finite &= np.minimum(*ended.met(name)) > 0
        if finite.any():
            found[name] = (values[0][finite], values[1][finite], ended.only(finite))
    tested = sum(len(pairs) > 1 for _, _, pairs in found.values())
    share = alpha / max(tested, 1)
    changes = []
    for name, (old, new, pairs) in found.items():
        change = _metric(name, old, new, pairs, share)
        if kind == "margin":
            fall = _largest_fall(old, new, pairs, jobs) if change.fell else None
            change = change.model_copy(update={"unit": names[name], "largest_fall": fall})
        changes.append(change)
    return sorted(changes, key=lambda change: not change.changed)


def _with_margins(trials: TrialPairs) -> dict[str, str | None]:
    """Returns the requirements whose margins have the same unit in both runs, so that they can be compared; by unit."""
    before, after = (margin_units(table) for table in (trials.before, trials.after))
    return {name: next(iter(units)) for name, units in after.items() if len(units) == 1 and before.get(name) == units}


def _if_met(trials: TrialPairs) -> dict[str, str | None]:
    """Returns the requirements whose margins can be compared where both trials met them, by unit: seconds of goals."""
    before, after = (units_if_met(table) for table in (trials.before, trials.after))
    return {name: unit for name, unit in after.items() if before.get(name) == unit}


def _largest_fall(
    before: NDArray[np.float64], after: NDArray[np.float64], trials: TrialPairs, jobs: Sequence[Pair]
) -> LargestFall:
    place = int(np.argmin(after - before))
    return LargestFall(**dict(trials.named(place, jobs)), before=float(before[place]), after=float(after[place]))


def _metric(
    name: str, before: NDArray[np.float64], after: NDArray[np.float64], pairs: TrialPairs, alpha: float
) -> MetricChange:
    differences = after - before
    moved = np.abs(differences) > _LOOKS_THE_SAME * np.maximum(np.abs(before), np.abs(after))
    interval = mean_change(_judged(pairs, alpha), differences, alpha) if len(differences) > 1 else None
    return MetricChange(
        name=name,
        pairs=len(differences),
        before=float(before.mean()),
        after=float(after.mean()),
        difference=interval.value if interval else float(differences[0]),
        low=interval.low if interval else None,
        high=interval.high if interval else None,
        changed=interval is not None and interval.leaves_out_zero,
        fell=int((moved & (differences < 0)).sum()),
        rose=int((moved & (differences > 0)).sum()),
    )


def _why_unpaired(before: NightRun, after: NightRun) -> str:
    """Returns the reason why two runs have no job in common, as a clause without a full stop."""
    for run in (before, after):
        if not run.jobs:
            return f"{run.run_id} has no simulation jobs"
        if not run.has_inputs:
            return f"the record of {run.run_id} does not say which worlds and seeds its jobs had: they were deleted"
    if _steps(before).isdisjoint(_steps(after)):
        return "their jobs are of steps with different names, and pairs are sought within the steps of one name"
    if _worlds(before).isdisjoint(_worlds(after)):
        return (
            "their jobs drove in different worlds: a generation job makes the same worlds again when it has the same "
            "seed, template and version of the generator"
        )
    return "no job has step, world and seed of one of the other run: give the jobs a seed, the same in both runs"


def _steps(run: NightRun) -> set[str]:
    return {job.step or "" for job in run.jobs if job.inputs}


def _worlds(run: NightRun) -> set[str]:
    return {job.inputs.world or "" for job in run.jobs if job.inputs}


def _without_verdicts(before: NightRun, after: NightRun) -> str:
    """Counts the jobs of two runs by outcome, as text: `night-1 has 2 passed, 1 broken; night-2 has 3 canceled`."""
    told = []
    for run in (before, after):
        outcomes = [outcome_of(job) for job in run.jobs]
        counts = [f"{outcomes.count(each)} {each.value}" for each in Outcome if each in outcomes]
        told.append(f"{run.run_id} has {', '.join(counts)}")
    return "; ".join(told)
