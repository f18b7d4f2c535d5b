"""Comparing two runs: is the second one better, worse, no different as far as can be told, or not to be compared?

The answer is about verdicts. Whether a metric that rose is good news only its user knows.
"""

import math
from collections.abc import Sequence

from ...schemas.reports.comparison import (
    ANSWER_EXIT_CODES,
    Answer,
    ComparedRun,
    Comparison,
    MetricChange,
    NeededPairs,
    RateChange,
)
from ..reporting import Outcome
from .failures import appearances_of
from .losses import losses_of, told_losses
from .nights import JUDGED, NightRun, outcome_of
from .pairing import Pair, Pairing, pair_jobs
from .statistics import mcnemar_p_value, mean_difference, paired_rate_difference, pairs_needed

POWER = 0.8
"""The probability with which the pairs that are said to be needed would show the difference."""

_USUAL_DIFFERENCE = 0.1
_ENDED = (*JUDGED, Outcome.UNJUDGED)


def compare(before: NightRun, after: NightRun, *, alpha: float = 0.05, difference: float | None = None) -> Comparison:
    """Compares two runs job by job.

    The answer is that of the exact McNemar test of the pairs that were judged in both runs. Jobs that broke are not
    judged; where counting them as failed would change the answer, the runs are not comparable.

    Args:
        before: the first run.
        after: the second run.
        alpha: error probability of the test; the intervals of all metrics together have it too (Bonferroni).
        difference: difference of pass rates that `needed` is about, a share from 0 to 1; None: the one found.

    Returns:
        The answer, with what it rests on.
    """
    pairing = pair_jobs(before.jobs, after.jobs)
    fair = [pair for pair in pairing.pairs if pair.has_same_requirements]
    judged = [pair for pair in fair if pair.is_judged]
    rate = _rate(judged, alpha) if judged else None
    answer, why = _answer(before, after, pairing, fair, rate, alpha)
    needed = _needed(judged, alpha, difference) if answer == "no difference shown" else None
    lost = told_losses(losses_of([before, after], appearances_of([before, after])))
    told = [(pair, pair.outcomes) for pair in pairing.pairs]
    return Comparison(
        before=_compared(before),
        after=_compared(after),
        answer=answer,
        exit_code=ANSWER_EXIT_CODES[answer],
        why=why,
        alpha=alpha,
        pairs=len(pairing.pairs),
        only_before=len(pairing.only_before),
        only_after=len(pairing.only_after),
        unjudged=sum(not pair.is_judged for pair in pairing.pairs),
        other_requirements=len(pairing.pairs) - len(fair),
        other_requests=sum(not pair.has_same_request for pair in pairing.pairs),
        newly_failing=[pair.told() for pair, (old, new) in told if old is Outcome.PASSED and new.is_failure],
        newly_passing=[pair.told() for pair, (old, new) in told if old.is_failure and new is Outcome.PASSED],
        still_failing=[pair.told() for pair, (old, new) in told if old.is_failure and new.is_failure],
        rate=rate,
        needed=needed,
        metrics=_metrics(pairing.pairs, alpha),
        gone=lost.gone,
        no_longer_judged=lost.no_longer_judged,
        asked_less=lost.asked_less,
    )


def _compared(run: NightRun) -> ComparedRun:
    return ComparedRun(
        run_id=run.run_id, name=run.name, started_at=run.started_at, jobs=len(run.jobs), source=run.source
    )


def _answer(
    before: NightRun, after: NightRun, pairing: Pairing, fair: Sequence[Pair], rate: RateChange | None, alpha: float
) -> tuple[Answer, str]:
    """The answer and why it is that."""
    if not pairing.pairs:
        return "not comparable", _why_unpaired(before, after)
    if not fair:
        return "not comparable", (
            f"the {_counted(len(pairing.pairs), 'pair')} were judged by different requirements: a verdict says whether "
            "they were met, so that one of other requirements says something else"
        )
    if rate is None:
        return "not comparable", (
            f"none of the {_counted(len(fair), 'pair')} was judged in both runs: {_without_verdicts(before, after)}"
        )
    answer = _tested(rate, alpha)
    told = [pair for pair in fair if all(outcome in JUDGED or outcome.is_failure for outcome in pair.outcomes)]
    broken = len(told) - rate.pairs
    if broken and (strict := _tested(_rate(told, alpha), alpha)) != answer:
        return "not comparable", (
            f"the answer depends on the {_counted(broken, 'pair')} of which a job broke: {answer} when they are left "
            f"out, {strict} when what broke counts as failed; repair that and run it again"
        )
    words = f"{_counted(rate.pairs, 'pair')} judged in both runs, p = {rate.p_value:.2g} (exact McNemar test, "
    return answer, f"{words}alpha {alpha:g})"


def _tested(rate: RateChange, alpha: float) -> Answer:
    if rate.p_value > alpha:
        return "no difference shown"
    return "better" if rate.difference > 0 else "worse"


def _rate(pairs: Sequence[Pair], alpha: float) -> RateChange:
    """Pass rates of pairs; all that is not passed is failed."""
    counts = {(old, new): 0 for old in (True, False) for new in (True, False)}
    for pair in pairs:
        old, new = pair.outcomes
        counts[old is Outcome.PASSED, new is Outcome.PASSED] += 1
    both, worse, better, neither = (
        counts[key] for key in ((True, True), (True, False), (False, True), (False, False))
    )  # fmt: skip
    found = paired_rate_difference(both, worse, better, neither, alpha)
    return RateChange(
        pairs=len(pairs),
        before=(both + worse) / len(pairs),
        after=(both + better) / len(pairs),
        difference=found.value,
        low=found.low,
        high=found.high,
        p_value=mcnemar_p_value(worse, better),
    )


def _needed(pairs: Sequence[Pair], alpha: float, asked: float | None) -> NeededPairs:
    """How many pairs would show the difference that was asked for, that was found, or one of 10 points."""
    differ = [pair for pair in pairs if pair.outcomes[0] is not pair.outcomes[1]]
    rise = sum(1 if pair.outcomes[1] is Outcome.PASSED else -1 for pair in differ)
    found = abs(rise) / len(pairs)
    difference = asked or found or _USUAL_DIFFERENCE
    discordant = max(len(differ) / len(pairs), difference)
    needed = pairs_needed(discordant, difference, alpha, POWER)
    return NeededPairs(
        difference=difference,
        basis="asked for" if asked else "as found" if found else "10 points",
        discordant=discordant,
        power=POWER,
        pairs=needed,
        more=max(0, needed - len(pairs)),
    )


def _metrics(pairs: Sequence[Pair], alpha: float) -> list[MetricChange]:
    """Metrics of the pairs that ended by themselves in both runs; all intervals together hold with 1 - alpha."""
    values: dict[str, list[tuple[float, float]]] = {}
    for pair in pairs:
        if all(outcome_of(job) in _ENDED for job in (pair.before, pair.after)):
            for name, old in pair.before.metrics.items():
                new = pair.after.metrics.get(name)
                if new is not None and math.isfinite(old) and math.isfinite(new):
                    values.setdefault(name, []).append((old, new))
    tested = sum(len(found) > 1 for found in values.values())
    changes = [_metric(name, found, alpha / max(tested, 1)) for name, found in sorted(values.items())]
    return sorted(changes, key=lambda change: not change.changed)


def _metric(name: str, values: Sequence[tuple[float, float]], alpha: float) -> MetricChange:
    count = len(values)
    differences = [new - old for old, new in values]
    interval = mean_difference(differences, alpha) if count > 1 else None
    return MetricChange(
        name=name,
        pairs=count,
        before=math.fsum(old for old, _ in values) / count,
        after=math.fsum(new for _, new in values) / count,
        difference=interval.value if interval else differences[0],
        low=interval.low if interval else None,
        high=interval.high if interval else None,
        changed=interval is not None and interval.leaves_out_zero,
    )


def _why_unpaired(before: NightRun, after: NightRun) -> str:
    """Why two runs have no job in common."""
    for run in (before, after):
        if not run.jobs:
            return f"{run.run_id} has no simulation jobs"
        if not run.has_inputs:
            return (
                f"the record of {run.run_id} does not say which worlds and seeds its jobs had, because an earlier "
                f"version wrote it or its jobs are deleted; `robomaker report {run.run_id}` completes it if it can"
            )
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
    """How jobs without a verdict ended."""
    told = []
    for run in (before, after):
        outcomes = [outcome_of(job) for job in run.jobs]
        counts = [f"{outcomes.count(each)} {each.value}" for each in Outcome if each in outcomes]
        told.append(f"{run.run_id} has {', '.join(counts)}")
    return "; ".join(told)


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"
