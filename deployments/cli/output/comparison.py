"""Formats comparisons and histories of runs as text."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from ....schemas.reports.changes import CellChange, MetricChange, PairedTrial, RequirementChange, SinceLastRun
from ....schemas.reports.comparison import Comparison, NeededPairs, PairedJob
from ....schemas.reports.history import History, MissedNight, Night
from ....schemas.reports.report import ArmComparison
from ....schemas.reports.run_record import RunRecord, interrupted_briefly
from ....schemas.trial_copies import COPIES
from ....schemas.wire.common import counted
from ....tasks.comparison.compared_runs import NightRun
from ....tasks.inspection.run_records import is_night, since_last
from ....tasks.reporting import outcomes
from ....tasks.reporting.nights.changes import (
    TOO_FEW,
    change_in_words,
    fallen_briefly,
    fallen_in_words,
    judged_otherwise_in_words,
    largest_fall_in_words,
    level,
    losses_in_words,
    moved_in_words,
    newly_failing_in_words,
    place_in_words,
    repro_command,
    requirement_in_words,
    shared_since,
    since_in_words,
    trend_in_words,
    without_earlier_in_words,
)

_MOST_JOBS = 10
"""Limit of the jobs that are printed in a list; JSON and pages have them all."""
_MOST_LOST = 2
"""Jobs that the end of a run names of those that are gone; `robomaker history` names more."""
_MOST_MOVED = 2
"""Metrics that are named although chance may have moved them: those that moved furthest."""
_MOST_PLACES = 3
_MOST_NIGHTS = 14


def comparison_lines(comparison: Comparison) -> list[str]:
    """Formats the comparison of two runs as text lines: the answer, what differs between the runs, then details."""
    is_tested = comparison.answer != "not comparable"
    lines = [
        *([f"{turned}."] if (turned := comparison.turned_in_words) else []),
        f"{(answer := comparison.answer_in_words)[0].upper()}{answer[1:]}: "
        f"{comparison.told_of(comparison.before.run_id, comparison.after.run_id)}.",
        *([fallen] if (fallen := fallen_briefly(comparison.margins)) else []),
        *([f"{order[0].upper()}{order[1:]}."] if (order := comparison.order_in_words) else []),
        "",
        f"  {'how sure' if is_tested else 'why':<13} {comparison.why}",
    ]
    if rate := comparison.rate:
        lines.append(
            f"  pass rate     {rate.before:.1%} → {rate.after:.1%}, {_points(rate.difference)} points "
            f"({level(comparison.alpha)} interval {_points(rate.low)} to {_points(rate.high)})"
        )
    if comparison.needed:
        lines.append(f"  needed        {_needed(comparison.needed)}")
        lines += [f"    assumed: {words}" for words in comparison.needed.assumed]
    lines += [
        f"  pairs         {_pairs(comparison)}",
        f"  what differs  {'; '.join(map(change_in_words, comparison.changed)) or 'nothing that is recorded'}",
    ]
    lines += [f"  note          {each}" for each in comparison.troubles]
    lines += [f"  {line}" for line in requirement_lines(comparison.requirements)]
    for title, jobs in (
        ("newly failing", comparison.newly_failing),
        ("newly passing", comparison.newly_passing),
        ("still failing", comparison.still_failing),
    ):
        lines += _paired(title, jobs)
    lines += [f"  {line}" for line in losses_in_words(comparison, _MOST_JOBS)]
    lines += _margins(comparison.margins, comparison.alpha) + _metrics(comparison.metrics, comparison.alpha)
    return lines + _next(comparison)


def arm_lines(run_id: str, axis: str, arm: ArmComparison) -> list[str]:
    """Formats the comparison of two values of an axis as text lines, the result first."""
    lines = [
        f"{arm.result.capitalize()}: {axis}={arm.value} compared with {axis}={arm.baseline}, in {run_id}.",
        "",
        f"  {'why' if arm.rate is None else 'how sure':<13} {arm.why}",
    ]
    if rate := arm.rate:
        lines.append(
            f"  pass rate     {rate.before:.1%} → {rate.after:.1%}, {_points(rate.difference)} points "
            f"(95% interval {_points(rate.low)} to {_points(rate.high)})"
        )
    return [*lines, f"  pairs         both values have {counted(arm.pairs, 'trial')} that differ in nothing else"]


def history_lines(history: History, page: Path) -> list[str]:
    """Formats a specification's history as text lines: changes, latest runs, flaky jobs."""
    since = history.since_last
    lines = [f"{history.name}: {counted(len(history.nights), 'run')}", ""]
    if told := _last_run(history.nights[-1], since):
        lines += [f"  {told}", *([""] if history.nights[-1].why_broken and not history.nights[-1].jobs else [])]
    lines += _counts(since)
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


def _last_run(last: Night, since: SinceLastRun) -> str:
    """Returns why the last run is not compared with an earlier one; empty: it is."""
    if last.refusal:
        return f"The last run was {last.refused_in_words}"
    if last.step_error and not last.jobs:
        return f"The last run made no jobs: {last.step_error}"
    if since.previous_run_id is None:
        first = "This is the first run that has results: there is nothing to compare it with."
        return first if last.jobs else "The last run has no results."
    if not since.paired and since.unpaired:
        return "No job of the last run has the step, world and seed of a job of an earlier run."
    return ""


def _counts(since: SinceLastRun) -> list[str]:
    """Says how many jobs of a run have no result, no earlier one, or other requirements; each with a blank line."""
    have = "has" if since.without_result == 1 else "have"
    told = (
        f"{counted(since.without_result, 'job')} of the last run {have} no result" if since.without_result else "",
        without_earlier_in_words(since),
        judged_otherwise_in_words(since.other_requirements) if since.other_requirements else "",
    )
    return [line for each in told if each for line in (f"  {each}", "")]


def newest_lines(newest: Mapping[str, Night]) -> list[str]:
    """Formats the newest run of each specification as a text line.

    Args:
        newest: Runs by the name of their specification.
    """
    width = max(map(len, newest), default=0)
    return [f"{name:<{width}}  {outcomes.minute(night.started_at)}  {_ended(night)}" for name, night in newest.items()]


def _ended(night: Night) -> str:
    """Returns the state of a run and its counts: `failed, 2 of 3 jobs passed, 1 of 3 taken over`."""
    if night.why_broken and not night.jobs:
        return f"{night.state}, {night.why_broken}"
    told = night.cut_short or f"{night.shown_state}, {night.passed_in_words}"
    return f"{told}, {night.jobs_in_words}" if night.taken_over else told


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
    """Formats what is new in a run as text lines: requirements, lost checks, newly failing jobs; of a night only."""
    if not is_night(record):
        return []
    since = since_last(NightRun.of(record), record.run_dir.parent)
    lines = [*_changed_requirements(since), *losses_in_words(since, _MOST_LOST)]
    lines += [failing] if (failing := newly_failing_in_words(since)) else []
    if lines and since.previous_run_id:
        lines.append(f"better or worse: robomaker compare {since.previous_run_id} {record.run_id}")
    return lines


def _changed_requirements(since: SinceLastRun) -> list[str]:
    """Lists requirements that are newly missed or met, margins that fell, and those that will soon be missed."""
    lines = requirement_lines(since.requirements)
    for each in since.margins[:_MOST_JOBS]:
        lines += [fallen_in_words(each), *(f"  {fall}" for fall in [largest_fall_in_words(each)] if fall)]
    return [*lines, *map(trend_in_words, since.shrinking[:_MOST_JOBS])]


def _pairs(comparison: Comparison) -> str:
    """Says how many jobs and trials both runs have, and how many of these pairs count for the answer."""
    has_trials = comparison.trials != comparison.pairs
    with_trials = f" with {counted(comparison.trials, 'trial')}" if comparison.trials else ", and no trial in common"
    told = [f"both runs have {counted(comparison.pairs, 'job')}{with_trials if has_trials else ''}"]
    if comparison.rate:
        told.append(f"{counted(comparison.rate.pairs, 'pair')} of {'trials' if has_trials else 'jobs'} count")
    if comparison.unjudged:
        told.append(f"{comparison.unjudged} without a verdict in one run")
    if comparison.other_requirements:
        told.append(f"{counted(comparison.other_requirements, 'job')} judged by other requirements, not counted")
    told += [f"{counted(comparison.other_requests, 'job')} with a changed request"] if comparison.other_requests else []
    for only, which in ((comparison.only_before, "first"), (comparison.only_after, "second")):
        told += [f"{counted(only, 'job')} only in the {which} run"] if only else []
    # Where jobs are missing their trials are among these.
    if has_trials and comparison.trials and not comparison.only_before + comparison.only_after:
        for only, which in ((comparison.trials_only_before, "first"), (comparison.trials_only_after, "second")):
            told += [f"{counted(only, 'trial')} only in the {which} run"] if only else []
    return "; ".join(told)


def _needed(needed: NeededPairs) -> str:
    """Says how many pairs would answer the question, in all and beside those that count."""
    worlds = f" in {counted(needed.worlds, 'world')}" if needed.worlds else ""
    points = f"{needed.difference * 100:.3g} points"
    shown = {
        "margin": f"exclude a fall by {points}, if nothing changed,",
        "asked for": f"show a difference of {points}, as asked for,",
        "as found": f"show a difference of {points}, as found,",
        "10 points": f"show a difference of {points}, if there is one,",
    }[needed.basis]
    chance = f"with a chance of {needed.power:.0%}"
    if not needed.more:
        rest = "; so something may have changed" if needed.basis == "margin" else ""
        return f"no more pairs: {needed.pairs}{worlds} {shown} {chance}, and there are as many{rest}"
    return f"{needed.pairs} pairs{worlds}, {needed.more} more than there are, would {shown} {chance}"


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


def _margins(changes: Sequence[MetricChange], alpha: float) -> list[str]:
    """Lists the requirements whose margins moved, each with the pair in which it fell most."""
    moved = [each for each in changes if each.fell or each.rose]
    if not changes:
        return []
    asked = counted(len(changes), "requirement")
    if not moved:
        return [f"  margins       those of {asked} stayed the same"]
    lines = [f"  margins       those of {len(moved)} of {asked} moved"]
    for each in moved[:_MOST_JOBS]:
        lines.append(f"    {each.name}: {moved_in_words(each, each.unit or '', alpha)}")
        if fall := largest_fall_in_words(each):
            lines.append(f"      {fall}")
    return lines + _more(len(moved))


def _metrics(changes: Sequence[MetricChange], alpha: float) -> list[str]:
    """Lists the metrics that changed by more than chance, by their names for people; others are only counted."""
    tested = [each for each in changes if each.low is not None]
    changed = [each for each in tested if each.changed]
    if not changes:
        return []
    if not tested:
        return [f"  metrics       not tested: {TOO_FEW}"]
    moved = sorted((each for each in tested if (each.fell or each.rose) and not each.changed), key=_share_moved)
    told = [f"{len(changed)} changed by more than chance"]
    told += [f"{len(moved)} moved, which may be chance"] if moved else []
    told += [f"{same} stayed the same"] if (same := len(tested) - len(changed) - len(moved)) else []
    told += [f"{len(changes) - len(tested)} not tested: {TOO_FEW}"] if len(changes) > len(tested) else []
    lines = [f"  metrics       {', '.join(told)}"]
    for each in [*changed, *moved[:_MOST_MOVED]]:
        name, unit = outcomes.name_and_unit(each.name)
        lines.append(f"    {name}: {moved_in_words(each, unit, alpha)}")
    return lines


def _share_moved(change: MetricChange) -> float:
    """Returns a key that sorts metrics by how far their means moved, the furthest first."""
    largest = max(abs(change.before), abs(change.after))
    return -abs(change.difference) / largest if largest else 0.0


def _next(comparison: Comparison) -> list[str]:
    """Lists commands that show more: both runs side by side, and the trial that newly fails or comes nearest to it."""
    if not comparison.pairs:
        return []
    before, after = comparison.before.run_id, comparison.after.run_id
    lines = ["", f"  side by side  robomaker compare {before} {after} --report compared.html"]
    places: list[PairedTrial] = [each for change in comparison.requirements for each in change.places[:1]]
    places += [each.largest_fall for each in comparison.margins if each.largest_fall and each.has_fallen]
    if places:
        lines.append(f"  watch one     {repro_command(places[0].job, places[0].trial)}")
        if earlier := places[0].before_job:
            lines.append(f"  the same in A {repro_command(earlier, places[0].before_trial)}")
    return lines


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
        told = [
            night.cut_short or _broke(night),
            night.jobs_in_words,
            interrupted_briefly(night.interruptions),
            night.against,
            share.copies_briefly,
            *map(change_in_words, night.changed),
        ]
        changed = ", ".join(filter(None, told))
        counts = f"{share.passed:>6} {share.failed:>6} {share.errors:>6}"
        lines.append(
            f"  {outcomes.minute(night.started_at):<17} {rate:>5}  {interval:<10} {counts}  {changed}".rstrip()
        )
    lines += [f"  {COPIES}"] if any(night.success.copies for night in shown) else []
    if len(nights) > len(shown):
        lines.append(f"  … and {len(nights) - len(shown)} before; the page has them all")
    return lines


def _broke(night: Night) -> str:
    """Says that a run broke and why, where no job tells it; empty if it did not, or its broken trials are counted."""
    if night.why_broken:
        return f"{night.state}: {night.why_broken}"
    return night.state if night.state == "broken" and not night.success.errors else ""


def _points(share: float) -> str:
    return f"{share * 100:+.1f}"
