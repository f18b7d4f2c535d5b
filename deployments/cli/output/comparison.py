"""Formats comparisons and histories of runs as text."""

from collections.abc import Sequence
from pathlib import Path

from ....schemas.reports.changes import CellChange, RequirementChange, SinceLastRun
from ....schemas.reports.comparison import Comparison, MetricChange, NeededPairs, PairedJob
from ....schemas.reports.history import History, MissedNight, Night
from ....schemas.reports.report import ArmComparison
from ....schemas.reports.run_record import RunRecord, interrupted_briefly
from ....schemas.wire.common import counted
from ....tasks.comparison.compared_runs import NightRun
from ....tasks.inspection.run_records import is_night, since_last
from ....tasks.reporting import outcomes
from ....tasks.reporting.nights.changes import (
    change_in_words,
    judged_otherwise_in_words,
    losses_in_words,
    place_in_words,
    requirement_in_words,
    shared_since,
    since_in_words,
    trend_in_words,
    without_earlier_in_words,
)

_MOST_JOBS = 10
"""Limit of the jobs that are printed in a list; JSON and pages have them all."""
_MOST_PLACES = 3
_MOST_NIGHTS = 14


def comparison_lines(comparison: Comparison) -> list[str]:
    """Formats the comparison of two runs as text lines, the result first."""
    before, after = comparison.before, comparison.after
    lines = [
        f"{after.run_id} compared with {before.run_id}",
        f"{comparison.answer.capitalize()}: {comparison.why}",
        "",
        f"  what differs  {'; '.join(map(change_in_words, comparison.changed)) or 'nothing that is recorded'}",
    ]
    lines += [f"  {line}" for line in requirement_lines(comparison.requirements)]
    if rate := comparison.rate:
        lines.append(
            f"  pass rate     {rate.before:.1%} → {rate.after:.1%}, {_points(rate.difference)} points "
            f"({100 * (1 - comparison.alpha):.4g}% interval {_points(rate.low)} to {_points(rate.high)})"
        )
    if comparison.needed:
        lines.append(f"  needed        {_needed(comparison.needed)}")
    lines.append(f"  pairs         {_pairs(comparison)}")
    lines += [f"  note          {each}" for each in comparison.troubles]
    for title, jobs in (
        ("newly failing", comparison.newly_failing),
        ("newly passing", comparison.newly_passing),
        ("still failing", comparison.still_failing),
    ):
        lines += _paired(title, jobs)
    lines += [f"  {line}" for line in losses_in_words(comparison, _MOST_JOBS)]
    return lines + _changes("margins", comparison.margins) + _changes("metrics", comparison.metrics)


def arm_lines(run_id: str, axis: str, arm: ArmComparison) -> list[str]:
    """Formats the comparison of two values of an axis as text lines, the result first."""
    lines = [
        f"{axis} of {run_id}: {arm.value} compared with {arm.baseline}",
        f"{arm.result.capitalize()}: {arm.why}",
        "",
    ]
    if rate := arm.rate:
        lines.append(
            f"  pass rate     {rate.before:.1%} → {rate.after:.1%}, {_points(rate.difference)} points "
            f"(95% interval {_points(rate.low)} to {_points(rate.high)})"
        )
    return [*lines, f"  pairs         {counted(arm.pairs, 'trial')} of both values"]


def history_lines(history: History, page: Path) -> list[str]:
    """Formats a specification's history as text lines: changes, latest runs, flaky jobs."""
    since = history.since_last
    lines = [f"{history.name}: {counted(len(history.nights), 'run')}", ""]
    if since.previous_run_id is None:
        lines.append("  This is the first run that has results: there is nothing to compare it with.")
    elif not since.paired and since.unpaired:
        lines.append("  No job of the last run has the step, world and seed of a job of an earlier run.")
    if new := without_earlier_in_words(since):
        lines += [f"  {new}", ""]
    if since.other_requirements:
        lines += [f"  {judged_otherwise_in_words(since.other_requirements)}", ""]
    if lost := losses_in_words(since, _MOST_JOBS):
        lines += [*(f"  {line}" for line in lost), ""]
    if changed := _changed_requirements(since):
        lines += [*(f"  {line}" for line in changed), ""]
    for title, changes in (
        ("newly failing", since.newly_failing),
        ("newly passing", since.newly_passing),
        ("still failing", since.still_failing),
    ):
        lines += _changed(title, changes)
    if since.previous_run_id is not None:
        lines += _changed("failing, without an earlier result", since.first_failing)
    unsteady = [cell for cell in history.cells if cell.unsteady]
    if unsteady:
        lines.append(f"  unsteady      {len(unsteady)}")
        lines += [f"    {cell.cell.title}" for cell in unsteady[:_MOST_JOBS]]
    lines += ["", *_nights(history.nights, history.missed), "", f"  page     {page}"]
    return lines


def requirement_lines(changes: Sequence[RequirementChange]) -> list[str]:
    """Formats newly missed or met requirements as text lines, each with some trials."""
    lines = []
    for change in changes[:_MOST_JOBS]:
        lines.append(requirement_in_words(change))
        named = change.places[:_MOST_PLACES]
        lines += [f"  {place_in_words(place)}" for place in named]
        if change.newly_missed > len(named):
            lines.append(f"  … and {change.newly_missed - len(named)} more")
    return lines + ([f"… and {len(changes) - _MOST_JOBS} more"] if len(changes) > _MOST_JOBS else [])


def changed_lines(record: RunRecord) -> list[str]:
    """Formats a run's newly missed requirements and lost checks as text lines; empty for runs that are no nights."""
    if not is_night(record):
        return []
    since = since_last(NightRun.of(record), record.run_dir.parent)
    return [*_changed_requirements(since), *losses_in_words(since, _MOST_JOBS)]


def _changed_requirements(since: SinceLastRun) -> list[str]:
    """Lists requirements that are newly missed or met, and those that will soon be missed."""
    return [*requirement_lines(since.requirements), *map(trend_in_words, since.shrinking[:_MOST_JOBS])]


def _pairs(comparison: Comparison) -> str:
    told = [counted(comparison.pairs, "job") + " of both runs"]
    has_trials = comparison.trials != comparison.pairs
    told += [f"{counted(comparison.trials, 'trial')} of both"] if has_trials else []
    told += [f"{comparison.unjudged} without a verdict in one"] if comparison.unjudged else []
    if comparison.other_requirements:
        told.append(f"{comparison.other_requirements} judged by other requirements, which do not count")
    told += [f"{comparison.other_requests} with another request"] if comparison.other_requests else []
    told += [f"{comparison.only_before} only in the first"] if comparison.only_before else []
    told += [f"{comparison.only_after} only in the second"] if comparison.only_after else []
    return ", ".join(told)


def _needed(needed: NeededPairs) -> str:
    if needed.basis == "margin":
        return _needed_for_margin(needed)
    basis = {
        "asked for": "the difference asked for",
        "as found": "the difference as found",
        "10 points": "a difference, of which there was none,",
    }[needed.basis]
    chance = f"chance of {needed.power:.0%}"
    of = f"{basis} of {needed.difference * 100:.3g} points"
    if not needed.more:
        return f"no more pairs: {needed.pairs} show {of} with a {chance}, and there are as many"
    worlds = f" in {needed.worlds} worlds" if needed.worlds else ""
    return f"{needed.more} more pairs, {needed.pairs} in all{worlds}, to show {of} with a {chance}"


def _needed_for_margin(needed: NeededPairs) -> str:
    what = f"to exclude a fall by {needed.difference * 100:.3g} points with a chance of {needed.power:.0%}"
    what = f"{what}, if nothing changed"
    if not needed.more:
        return f"no more pairs: {needed.pairs}, which there are, are enough {what}; so something may have changed"
    worlds = f" in {needed.worlds} worlds" if needed.worlds else ""
    return f"{needed.more} more pairs, {needed.pairs} in all{worlds}, {what}"


def _paired(title: str, jobs: Sequence[PairedJob]) -> list[str]:
    if not jobs:
        return []
    lines = [f"  {title} {len(jobs)}"]
    for job in jobs[:_MOST_JOBS]:
        outcome = f"{job.before} → {job.after}"
        lines.append(f"    {job.cell.title}: {outcome}" + (f"; {job.reason}" if job.reason else ""))
    return lines + _more(len(jobs))


def _changed(title: str, changes: Sequence[CellChange]) -> list[str]:
    if not changes:
        return []
    shared = shared_since(changes)
    lines = [f"  {title} {len(changes)}", *([f"    {shared}"] if shared else [])]
    for change in changes[:_MOST_JOBS]:
        known = f" (known, {change.known})" if change.known else ""
        lines.append(f"    {change.cell.title}{known}" + (f": {change.reason}" if change.reason else ""))
        if change.since and not shared:
            lines.append(f"      {since_in_words(change.since)}")
    return lines + _more(len(changes))


def _more(count: int) -> list[str]:
    return [f"    … and {count - _MOST_JOBS} more"] if count > _MOST_JOBS else []


def _changes(kind: str, changes: Sequence[MetricChange]) -> list[str]:
    """Lists the metrics or margins that changed between two runs; unchanged ones are only counted."""
    changed = [each for each in changes if each.changed]
    others = len(changes) - len(changed)
    lines = [f"  {kind:<13} {len(changed)} changed, {others} show no change"] if changes else []
    width = max((len(each.name) for each in changed), default=0)
    return lines + [f"    {each.name.ljust(width)}  {_metric(each)}" for each in changed]


def _metric(change: MetricChange) -> str:
    values = f"{outcomes.compact(change.before)} → {outcomes.compact(change.after)}"
    if change.low is None or change.high is None:
        return values
    interval = f"{_signed(change.low)} to {_signed(change.high)}"
    return f"{values}, {_signed(change.difference)} (interval {interval}, {counted(change.pairs, 'pair')})"


def _nights(nights: Sequence[Night], missed: Sequence[MissedNight]) -> list[str]:
    shown = list(nights[: -_MOST_NIGHTS - 1 : -1])
    lines = [f"  {'started (UTC)':<17} {'rate':>5}  {'interval':<10} passed failed broken  changed"]
    gaps = [night for night in missed if night.due_at >= shown[-1].started_at]
    for night in shown:
        while gaps and gaps[-1].due_at > night.started_at:
            gap = gaps.pop()
            lines.append(f"  {outcomes.minute(gap.due_at):<17} {gap.kind}: {gap.reason}")
        share = night.success
        rate = "–" if share.rate is None else f"{share.rate:.0%}"
        interval = "" if share.low is None or share.high is None else f"{share.low:.0%}–{share.high:.0%}"
        told = [interrupted_briefly(night.interruptions), night.against, *map(change_in_words, night.changed)]
        changed = ", ".join(filter(None, told))
        counts = f"{share.passed:>6} {share.failed:>6} {share.errors:>6}"
        lines.append(
            f"  {outcomes.minute(night.started_at):<17} {rate:>5}  {interval:<10} {counts}  {changed}".rstrip()
        )
    if len(nights) > len(shown):
        lines.append(f"  … and {len(nights) - len(shown)} before; the page has them all")
    return lines


def _points(share: float) -> str:
    return f"{share * 100:+.1f}"


def _signed(value: float) -> str:
    return f"{'+' if value > 0 else ''}{outcomes.compact(value)}"
