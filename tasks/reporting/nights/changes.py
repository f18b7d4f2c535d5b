"""Texts on changes between runs, and on when a job began to fail."""

import re
from collections.abc import Sequence

from ....schemas.reports.changes import (
    CellChange,
    ChangedInput,
    FailureStart,
    Loss,
    Losses,
    MarginTrend,
    MetricChange,
    NewlyMissed,
    RequirementChange,
    SinceLastRun,
)
from ....schemas.wire.common import counted
from .. import outcomes

_MOST_NAMED = 4
"""Maximum number of requirements in a title."""
_MOST_MARGINS = 5
_MOST_FALLEN = 3
_FAILS, _BREAKS = "fails", "breaks"
TOO_FEW = "there is 1 pair, and a test takes 2 or more"
"""Reason why a change of a margin or a metric was not tested."""


def change_in_words(change: ChangedInput) -> str:
    """Describes a changed input: `commit 1a2b3c4d → 5e6f7a8b`, `mujoco 3.17.0 → 3.18.0`, `its request`."""
    if change.what in ("request", "requirements"):
        return f"its {change.what}"
    if change.what == "parameter":
        before, after = ("none" if value is None else value or '""' for value in (change.before, change.after))
        return f"parameter {change.name}: {before} → {after}"
    what = change.name if change.what == "version" else f"{change.what} {change.name}".rstrip()
    if change.before is None:
        return f"{what} {_short(change.after)}".rstrip() + " is new"
    if change.after is None:
        return f"{what} is gone"
    before, after = (
        _digests(value) if change.what == "application" else _short(value) for value in (change.before, change.after)
    )
    return f"{what} {before} → {after}"


def since_in_words(since: FailureStart) -> str:
    """Describes since when a job fails or breaks and which inputs changed then, as a sentence without full stop.

    An example, with `TIME` for the start: `fails since TIME, 3 runs; changed then: mujoco 3.17.0 → 3.18.0`.
    """
    failed = since.nights - since.broke
    does = " or ".join(word for word, count in ((_FAILS, failed), (_BREAKS, since.broke)) if count)
    each = f": failed in {failed}, broke in {since.broke}" if failed and since.broke else ""
    began = f"{does} since {outcomes.moment(since.started_at)}, {counted(since.nights, 'run')}{each}"
    if since.last_passed_run_id is None:
        return f"{began}; never passed in the runs looked at"
    if not since.changed:
        return f"{began}; nothing that is recorded changed then"
    return f"{began}; changed then: {', '.join(map(change_in_words, since.changed))}"


def newly_failing_in_words(since: SinceLastRun) -> str:
    """Counts newly failing jobs: `newly failing 4 since RUN (changed: parameter delay: 0 → 0.6)`.

    It is empty if there are none; known failures are no news.
    """
    failing = [each for each in since.newly_failing if not each.known]
    if not failing:
        return ""
    passed = {each.since.last_passed_run_id for each in failing if each.since}
    last = passed.pop() if len(passed) == 1 else since.previous_run_id
    changed = changed_for_all(failing)
    cause = f"changed: {changed}" if changed else "nothing that is recorded changed for all of them"
    return f"newly failing {len(failing)} since {last} ({cause})"


def changed_for_all(changes: Sequence[CellChange]) -> str:
    """Names the inputs that changed when jobs began to fail, for all of them: `parameter delay: 0 → 0.6`.

    The text is empty if there are none. A request is not named beside a parameter, by which it differs.
    """
    each_changed = [each.since.changed if each.since else [] for each in changes]
    common = [each for each in each_changed[0] if all(each in others for others in each_changed)] if changes else []
    has_parameter = any(each.what == "parameter" for each in common)
    told = [change_in_words(each) for each in common if not (has_parameter and each.what == "request")]
    more = f" and {len(told) - _MOST_NAMED} more" if len(told) > _MOST_NAMED else ""
    return f"{', '.join(told[:_MOST_NAMED])}{more}"


def newly_missed_briefly(changes: Sequence[RequirementChange]) -> str:
    """Lists newly missed requirements: `newly missed: upright, gentle`; empty if there are none."""
    names = [each.name for each in changes if each.newly_missed]
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return f"newly missed: {', '.join(names[:_MOST_NAMED])}{more}" if names else ""


def requirement_in_words(change: RequirementChange) -> str:
    """Describes a changed requirement: `gentle: newly missed in 2 of 9 trials; world and seed are the same; ...`.

    `robomaker flaky` is named only where neither the code nor the request changed, so that chance may be the cause.
    """
    of = f"of {change.pairs} {'trial' if change.pairs == 1 else 'trials'}"
    told = [f"newly missed in {change.newly_missed} {of}"] if change.newly_missed else []
    told += [f"newly met in {change.newly_met}{'' if told else f' {of}'}"] if change.newly_met else []
    same = "world and seed are" if all(place.cell.world for place in change.places) else "the seed is"
    others = dict.fromkeys(_input_in_words(each) for place in change.places for each in place.changed)
    is_one = len(others) == 1 and "the requirements" not in others
    differs = f", but {' and '.join(others)} {'differs' if is_one else 'differ'}"
    # Jobs with trials are not run again by `flaky`.
    tells = "verify" if any(place.trial is not None for place in change.places) else "flaky"
    fact = differs if others else f"; `robomaker {tells}` tells whether it is chance"
    return f"{change.name}: {', '.join(told)}{f'; {same} the same{fact}' if _is_certain(change) else ''}"


def _input_in_words(change: ChangedInput) -> str:
    if change.what == "version":
        return change.name
    return f"application {change.name}" if change.what == "application" else f"the {change.what}"


def trend_in_words(trend: MarginTrend) -> str:
    """Describes a margin that shrinks: `gentle: its smallest margin shrinks, 3, 2, 1 N in the last 3 runs …`."""
    shown = trend.margins[-_MOST_MARGINS:]
    margins = ", ".join(f"{each:.3g}" for each in shown)
    unit = f" {trend.unit}" if trend.unit else ""
    nights = max(1, round(trend.nights_left))
    return (
        f"{trend.name}: its smallest margin shrinks, {margins}{unit} in the last {len(shown)} runs of as many trials: "
        f"missed in about {nights} more"
    )


def place_in_words(place: NewlyMissed) -> str:
    """Describes a newly missed trial: `drive: world-1 scout, mass 2.1 (trial 12): 9 N, at most 5 N asked`."""
    return f"{place.title}: {place.detail}" if place.detail else place.title


def _is_certain(change: RequirementChange) -> bool:
    """Returns whether nothing that is recorded differs by chance, in all trials of a change."""
    return bool(change.places) and all(place.certain for place in change.places)


def judged_otherwise_in_words(jobs: int) -> str:
    """Warns that some jobs were judged by other requirements than before; empty if none were.

    It begins `3 jobs were judged by other requirements than before: `.
    """
    if not jobs:
        return ""
    were = "1 job was" if jobs == 1 else f"{jobs} jobs were"
    return f"{were} judged by other requirements than before: a verdict that changed may say nothing about the robot."


def without_earlier_in_words(since: SinceLastRun) -> str:
    """Returns the text that some jobs have no earlier result; empty if none or all of them have none.

    It reads `2 jobs have no earlier result: new, or with another world or seed than before.`
    """
    if not since.unpaired or not since.paired:
        return ""
    have = "1 job has" if since.unpaired == 1 else f"{since.unpaired} jobs have"
    return f"{have} no earlier result: new, or with another world or seed than before."


def losses_in_words(losses: Losses, most: int | None = None) -> list[str]:
    """Describes losses against earlier runs, one line for each kind: `1 job is gone: drive: request 3 scout, ...`.

    Args:
        losses: Jobs, requirements and trials that earlier runs had and the new run lacks.
        most: Maximum number of jobs in a line; None: all.
    """
    kinds = (
        (losses.gone, "is gone", "are gone"),
        (losses.no_longer_judged, "is no longer judged", "are no longer judged"),
        (losses.asked_less, "is asked less than before", "are asked less than before"),
        (losses.fewer_trials, "has fewer trials than before", "have fewer trials than before"),
    )
    lines = []
    for found, one, several in kinds:
        if found:
            named = [f"{each.cell.title} ({loss_in_words(each)})" for each in found[:most]]
            more = f"; and {len(found) - len(named)} more" if len(found) > len(named) else ""
            cause = f", since {why}" if (why := cause_in_words(found)) else ""
            count = f"1 job {one}" if len(found) == 1 else f"{len(found)} jobs {several}"
            lines.append(f"{count}{cause}: {'; '.join(named)}{more}")
    return lines


def cause_in_words(losses: Sequence[Loss]) -> str:
    """Returns why jobs or trials are missing: `drive has 2 seeds instead of 20 (parameter seeds) and 4 worlds …`.

    The text is empty where the cause of any of them is not known.
    """
    if not losses or not all(each.causes for each in losses):
        return ""
    by_step: dict[str, dict[str, None]] = {}
    for each in losses:
        by_step.setdefault(each.cell.step, {}).update(dict.fromkeys(each.causes))
    return "; ".join(f"{step or 'the run'} has {' and '.join(causes)}" for step, causes in by_step.items())


def loss_in_words(loss: Loss) -> str:
    """Describes one loss: `failed before; requirement east is not asked any more`."""
    before = "broke before" if loss.before == "broken" else f"{loss.before} before"
    if loss.trials_now is not None:
        trials = counted(loss.trials_now, "trial")
        return f"{before}; {trials}, {loss.trials_before} before"
    if not loss.requirements:
        return before
    names = ", ".join(loss.requirements)
    dropped = f"requirement {names} is" if len(loss.requirements) == 1 else f"requirements {names} are"
    return f"{before}; {dropped} not asked any more"


def shared_since(changes: Sequence[CellChange]) -> str:
    """Describes since when several jobs all fail, `All fail since TIME, 3 runs; ...`; empty if that differs."""
    said = {since_in_words(each.since) if each.since else "" for each in changes}
    if len(changes) < 2 or len(said) > 1:
        return ""
    does, since, more = said.pop().partition(" since ")
    return f"All {does.replace(_FAILS, 'fail').replace(_BREAKS, 'break')}{since}{more}" if since else ""


def _digests(value: str) -> str:
    """Shortens an application's digests; an empty one is that of an application that could not be loaded."""
    return ", ".join(_short(each) or "not loaded" for each in value.split(", "))


def _short(value: str | None) -> str:
    """Shortens hashes, and returns other texts unchanged."""
    return re.sub(r"(?:sha256:)?\b([0-9a-f]{8})[0-9a-f]{24,}\b", r"\1", value or "", count=0)


def repro_command(job: str, trial: int | None) -> str:
    """Returns the command that runs a job, or one of its trials, again with a recording and a video."""
    return f"robomaker repro {job}" + ("" if trial is None else f" --trial {trial}")


def fallen_briefly(margins: Sequence[MetricChange]) -> str:
    """Names the margins that fell on average: `Margins of requirements fell: clearance, perhaps by chance`.

    The text is empty if none fell.
    """
    fallen = [each for each in margins if each.has_fallen]
    if not fallen:
        return ""
    sure = [each.name for each in fallen if each.changed]
    others = [each.name for each in fallen if not each.changed]
    is_untested = all(each.low is None for each in fallen)
    told = [f"{_named(sure)}, by more than chance"] if sure else []
    told += [f"{_named(others)}, {'not tested' if is_untested else 'perhaps by chance'}"] if others else []
    return f"Margins of requirements fell: {'; '.join(told)}."


def _named(names: Sequence[str]) -> str:
    more = f" and {len(names) - _MOST_FALLEN} more" if len(names) > _MOST_FALLEN else ""
    return f"{', '.join(names[:_MOST_FALLEN])}{more}"


def moved_in_words(change: MetricChange, unit: str, alpha: float) -> str:
    """Says how a mean changed, and whether by more than chance.

    Args:
        change: The change of a metric or a margin.
        unit: Its unit; empty: none.
        alpha: Error probability of the intervals of all metrics, or all margins, together.
    """
    values = _values(change.before, change.after, unit)
    if change.low is None or change.high is None:
        return f"{values}; whether by chance was not tested: {TOO_FEW}"
    interval = f"{level(alpha)} interval {_signed(change.low)} to {_signed(change.high)}"
    sure = "by more than chance" if change.changed else "which may be chance"
    difference = f"{_signed(change.difference)} {unit}".rstrip()
    return f"{values} on average of {counted(change.pairs, 'pair')}, {difference}, {sure} ({interval})"


def fallen_in_words(change: MetricChange, alpha: float = 0.05) -> str:
    """Says of a margin by how much it fell: `margin of clearance fell: 0.21 → 0.13 m on average of 40 pairs, …`."""
    return f"margin of {change.name} fell: {moved_in_words(change, change.unit or '', alpha)}"


def largest_fall_in_words(change: MetricChange) -> str:
    """Says in how many pairs a margin fell, and in which one most; empty if it fell in none."""
    fall = change.largest_fall
    if fall is None:
        return ""
    return f"fell in {change.fell} of {counted(change.pairs, 'pair')}, most in {fall.title}: {_fall(change)}"


def fell_most_in_words(change: MetricChange) -> str:
    """Says how far a margin fell in the pair in which it fell most, without its name."""
    return f"fell most here, {_fall(change)}; in {change.fell} of {counted(change.pairs, 'pair')} it fell"


def _fall(change: MetricChange) -> str:
    fall = change.largest_fall
    return "" if fall is None else _values(fall.before, fall.after, change.unit or "")


def level(alpha: float) -> str:
    """Formats a confidence level: `95%`."""
    return f"{100 * (1 - alpha):.4g}%"


def _values(before: float, after: float, unit: str) -> str:
    return f"{outcomes.compact(before)} → {outcomes.compact(after)} {unit}".rstrip()


def _signed(value: float) -> str:
    return f"{'+' if value > 0 else ''}{outcomes.compact(value)}"
