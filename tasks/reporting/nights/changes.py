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
    NewlyMissed,
    RequirementChange,
    SinceLastRun,
)
from ....schemas.wire.common import counted
from .. import outcomes

_MOST_NAMED = 4
"""Maximum number of requirements in a title."""
_MOST_MARGINS = 5


def change_in_words(change: ChangedInput) -> str:
    """Describes a changed input: `commit 1a2b3c4d → 5e6f7a8b`, `mujoco 3.17.0 → 3.18.0`, `its request`."""
    if change.what in ("request", "requirements"):
        return f"its {change.what}"
    if change.what == "parameter":
        before, after = ("none" if value is None else value or '""' for value in (change.before, change.after))
        return f"parameter {change.name}: {before} → {after}"
    what = change.name if change.what == "version" else f"{change.what} {change.name}".rstrip()
    if change.before is None:
        return f"{what} {_short(change.after)} is new"
    if change.after is None:
        return f"{what} is gone"
    return f"{what} {_short(change.before)} → {_short(change.after)}"


def since_in_words(since: FailureStart) -> str:
    """Describes since when a job fails and which inputs changed then, as a sentence without full stop.

    An example, with `TIME` for the start: `fails since TIME, 3 runs; changed then: mujoco 3.17.0 → 3.18.0`.
    """
    runs = counted(since.nights, "run")
    began = f"fails since {outcomes.moment(since.started_at)}, {runs}"
    if since.last_passed_run_id is None:
        return f"{began}; never passed in the runs looked at"
    if not since.changed:
        return f"{began}; nothing that is recorded changed then"
    return f"{began}; changed then: {', '.join(map(change_in_words, since.changed))}"


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
    """Describes a newly missed trial: `drive: world-1 scout, seed 7, trial 12: 9 N, at most 5 N asked`."""
    where = place.cell.title if place.trial is None else f"{place.cell.title}, trial {place.trial}"
    return f"{where}: {place.detail}" if place.detail else where


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
            lines.append(
                f"{f'1 job {one}' if len(found) == 1 else f'{len(found)} jobs {several}'}: {'; '.join(named)}{more}"
            )
    return lines


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
    return said.pop().replace("fails since", "All fail since", 1) if len(changes) > 1 and len(said) == 1 else ""


def _short(value: str | None) -> str:
    """Shortens hashes, and returns other texts unchanged."""
    return re.sub(r"(?:sha256:)?\b([0-9a-f]{8})[0-9a-f]{24,}\b", r"\1", value or "", count=0)
