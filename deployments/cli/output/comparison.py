"""Formats comparisons and histories of runs as text."""

from collections.abc import Mapping, Sequence
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
    """Formats the comparison of two runs as text lines: the answer, what differs between the runs, then details."""
    is_tested = comparison.answer != "not comparable"
    lines = [
        _answer(comparison),
        *_fallen(comparison.margins),
        "",
        f"  {'how sure' if is_tested else 'why':<13} {comparison.why}",
    ]
    if rate := comparison.rate:
        lines.append(
            f"  pass rate     {rate.before:.1%} → {rate.after:.1%}, {_points(rate.difference)} points "
            f"({_level(comparison.alpha)} interval {_points(rate.low)} to {_points(rate.high)})"
        )
    if comparison.needed:
        lines.append(f"  needed        {_needed(comparison.needed)}")
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


def _answer(comparison: Comparison) -> str:
    """Returns the answer as a sentence, which names both runs."""
    before, after = comparison.before.run_id, comparison.after.run_id
    rate = comparison.rate
    if comparison.answer == "not comparable":
        return f"Not comparable: {after} with {before}."
    if comparison.answer == "not worse":
        fall = f" by {100 * rate.margin.margin:.3g} points or more" if rate and rate.margin else " by as much as asked"
        return f"Not worse: the pass rate of {after} did not fall{fall} below that of {before}."
    if comparison.answer != "no difference shown":
        often = "more" if comparison.answer == "better" else "less"
        return f"{comparison.answer.capitalize()}: {after} passes {often} often than {before}, by more than chance."
    if rate is None:
        return f"No difference shown: it is open whether {after} passes more or less often than {before}."
    if not rate.difference:
        return f"No difference shown: {after} passes as often as {before}."
    often = "more" if rate.difference > 0 else "less"
    return f"No difference shown: {after} passes {often} often than {before}, but chance alone may do that."


def _fallen(margins: Sequence[MetricChange]) -> list[str]:
    """Returns a line about margins that fell on average; none where none did."""
    fallen = [each for each in margins if each.fell and each.difference < 0]
    if not fallen:
        return []
    sure = [each.name for each in fallen if each.changed]
    others = [each.name for each in fallen if not each.changed]
    told = [f"{_named(sure)}, by more than chance"] if sure else []
    told += [f"{_named(others)}, {'not tested' if _is_untested(fallen) else 'perhaps by chance'}"] if others else []
    return [f"Margins of requirements fell: {'; '.join(told)}."]


def _is_untested(changes: Sequence[MetricChange]) -> bool:
    return all(each.low is None for each in changes)


def _named(names: Sequence[str]) -> str:
    more = f" and {len(names) - _MOST_PLACES} more" if len(names) > _MOST_PLACES else ""
    return f"{', '.join(names[:_MOST_PLACES])}{more}"


def _level(alpha: float) -> str:
    return f"{100 * (1 - alpha):.4g}%"


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
    if since.previous_run_id is None:
        lines.append("  This is the first run that has results: there is nothing to compare it with.")
    elif not since.paired and since.unpaired:
        lines.append("  No job of the last run has the step, world and seed of a job of an earlier run.")
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
    """Returns the state of a run and its counts: `failed, 2 of 3 jobs passed`."""
    noun = "job" if night.trials == night.jobs else "trial"
    return night.cut_short or f"{night.state}, {night.success.passed} of {counted(night.trials, noun)} passed"


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
    lines = [*_changed_requirements(since), *losses_in_words(since, _MOST_JOBS)]
    if lines and since.previous_run_id:
        lines.append(f"better or worse: robomaker compare {since.previous_run_id} {record.run_id}")
    return lines


def _changed_requirements(since: SinceLastRun) -> list[str]:
    """Lists requirements that are newly missed or met, and those that will soon be missed."""
    return [*requirement_lines(since.requirements), *map(trend_in_words, since.shrinking[:_MOST_JOBS])]


def _pairs(comparison: Comparison) -> str:
    """Says how many jobs and trials both runs have, and how many of these pairs count for the answer."""
    has_trials = comparison.trials != comparison.pairs
    of_both = counted(comparison.pairs, "job") + (f" with {counted(comparison.trials, 'trial')}" if has_trials else "")
    told = [f"both runs have {of_both}"]
    if comparison.rate:
        told.append(f"{counted(comparison.rate.pairs, 'pair')} of {'trials' if has_trials else 'jobs'} count")
    if comparison.unjudged:
        told.append(f"{comparison.unjudged} without a verdict in one run")
    if comparison.other_requirements:
        told.append(f"{counted(comparison.other_requirements, 'job')} judged by other requirements, not counted")
    told += [f"{counted(comparison.other_requests, 'job')} with a changed request"] if comparison.other_requests else []
    for only, which in ((comparison.only_before, "first"), (comparison.only_after, "second")):
        told += [f"{counted(only, 'job')} only in the {which} run"] if only else []
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
        lines.append(f"    {each.name}: {_moved(each, each.unit or '', alpha)}")
        if fall := each.largest_fall:
            where = fall.cell.title if fall.trial is None else f"{fall.cell.title}, trial {fall.trial}"
            values = _values(fall.before, fall.after, each.unit or "")
            lines.append(f"      fell in {each.fell} of {counted(each.pairs, 'pair')}, most in {where}: {values}")
    return lines + _more(len(moved))


def _metrics(changes: Sequence[MetricChange], alpha: float) -> list[str]:
    """Lists the metrics that changed by more than chance, by their names for people; others are only counted."""
    tested = [each for each in changes if each.low is not None]
    changed = [each for each in tested if each.changed]
    if not changes:
        return []
    if not tested:
        return [f"  metrics       not tested: {_TOO_FEW}"]
    told = [f"{len(changed)} changed by more than chance", f"{len(tested) - len(changed)} show no change"]
    told += [f"{len(changes) - len(tested)} not tested: {_TOO_FEW}"] if len(changes) > len(tested) else []
    lines = [f"  metrics       {', '.join(told)}"]
    for each in changed:
        name, unit = outcomes.name_and_unit(each.name)
        lines.append(f"    {name}: {_moved(each, unit, alpha)}")
    return lines


_TOO_FEW = "there is 1 pair, and a test takes 2 or more"


def _moved(change: MetricChange, unit: str, alpha: float) -> str:
    """Says how a mean changed, and whether by more than chance."""
    values = _values(change.before, change.after, unit)
    if change.low is None or change.high is None:
        return f"{values}; whether by chance was not tested: {_TOO_FEW}"
    interval = f"{_level(alpha)} interval {_signed(change.low)} to {_signed(change.high)}"
    sure = "by more than chance" if change.changed else "which may be chance"
    difference = f"{_signed(change.difference)} {unit}".rstrip()
    return f"{values} on average of {counted(change.pairs, 'pair')}, {difference}, {sure} ({interval})"


def _values(before: float, after: float, unit: str) -> str:
    return f"{outcomes.compact(before)} → {outcomes.compact(after)} {unit}".rstrip()


def _next(comparison: Comparison) -> list[str]:
    """Lists commands that show more: both runs side by side, and the trial that newly fails or comes nearest to it."""
    if not comparison.pairs:
        return []
    before, after = comparison.before.run_id, comparison.after.run_id
    lines = ["", f"  side by side  robomaker compare {before} {after} --report compared.html"]
    places = [(each.job, each.trial) for change in comparison.requirements for each in change.places[:1]]
    falls = [each.largest_fall for each in comparison.margins if each.largest_fall and each.difference < 0]
    places += [(each.job, each.trial) for each in falls]
    if places:
        job, trial = places[0]
        lines.append(f"  watch one     robomaker repro {job}" + ("" if trial is None else f" --trial {trial}"))
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
            night.cut_short,
            interrupted_briefly(night.interruptions),
            night.against,
            *map(change_in_words, night.changed),
        ]
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
