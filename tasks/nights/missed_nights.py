"""Scheduled nights that did not happen: detects them, their reason, and makes the notification.

Prefect has a run for each time of a schedule, days before it is due. The next ones are recorded here, as Prefect
deletes the future runs of a schedule that is paused.
"""

import fcntl
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from pydantic import ValidationError

from ...schemas.reports.history import MissedNight, NightSchedule
from ...schemas.reports.run_record import new_run_id
from ...schemas.settings import Settings
from ..files.whole_files import write_whole
from ..notifications.notification_texts import Message
from ..notifications.sending import send

_FOLDER, _LOCK, _WRITING = "nights", "lock", "writing.lock"
_MOST_WAIT_S, _PAUSE_S = 5.0, 0.01
"""Limit and interval of waiting for another process that writes a schedule's record, in seconds.

A write takes milliseconds; a process that was stopped in the middle of it must not delay a night.
"""

_MOST_MISSED = 100
"""Limit of the missed nights that are kept for a schedule: as many as its history shows."""

_SKEW = timedelta(minutes=1)
"""Largest assumed difference between the clocks of this machine and of the Prefect server."""

PAUSED = "its schedule was paused"
_PAUSED_LATER = "it had not begun when its schedule was paused"
_NO_WORKER = "no Prefect worker was running"
_TOLD_IF = frozenset({"failure", "change", "always"})


@dataclass(frozen=True)
class DueRun:
    """A scheduled run of a deployment, as Prefect lists it."""

    state: str
    """Type of a scheduled run's Prefect state: `SCHEDULED`, `COMPLETED`."""
    state_name: str
    message: str
    has_begun: bool
    """Whether the scheduled run left anything; one that crashed in its first moments has not."""


def has_run(home: Path, name: str, since: datetime, until: datetime) -> bool:
    """Whether a run folder of a specification, in a data home, was begun between two times.

    It looks at the names of the run folders. A flow run whose process dies in its first moments has none: nothing
    finishes it.

    Args:
        home: The data home.
        name: Name of the specification.
        since: Earliest start.
        until: Latest start.
    """
    first, last = new_run_id(name, since - _SKEW), new_run_id(name, until + _SKEW)
    with suppress(OSError):
        return any(first <= path.name <= last for path in (home / "runs").iterdir())
    return False


def note_schedule(home: Path, deployment: str, name: str, now: datetime) -> None:
    """Records that a Prefect deployment's runs use this data home, so that missed nights are noticed.

    Args:
        home: The data home.
        deployment: Id of the deployment.
        name: Name of its specification.
        now: The time.
    """
    with suppress(OSError), _writing(home):
        known = _known(home, deployment) or NightSchedule(deployment=deployment, name="", checked_until=now)
        if known.name != name:  # it is new, or was not known before the first run
            _write(home, known.model_copy(update={"name": name}))


def schedules_of(home: Path) -> list[NightSchedule]:
    """Lists the recorded schedules of a data home, grouped by specification; those that cannot be read are left out."""
    found: list[NightSchedule] = []
    for path in (home / _FOLDER).glob("*.json"):
        with suppress(OSError, ValidationError):
            found.append(NightSchedule.model_validate_json(path.read_bytes()))
    return sorted(found, key=lambda each: (each.name, each.deployment))


def store_schedule(home: Path, schedule: NightSchedule) -> None:
    """Stores the result of a check of a schedule in the data home, with the specification's name of the last run."""
    with _writing(home):
        known = _known(home, schedule.deployment)
        _write(home, schedule if known is None else schedule.model_copy(update={"name": known.name}))


def _known(home: Path, deployment: str) -> NightSchedule | None:
    return next((each for each in schedules_of(home) if each.deployment == deployment), None)


def _write(home: Path, schedule: NightSchedule) -> None:
    """Writes the record of a schedule into the data home, in a file that is replaced as a whole."""
    write_whole(home / _FOLDER / f"{schedule.deployment}.json", schedule.model_dump_json(indent=2))


@contextmanager
def _writing(home: Path) -> Iterator[None]:
    """Locks the records of schedules for a moment against changes by other processes.

    It is needed because checks query Prefect meanwhile.
    """
    folder = home / _FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    until_s = time.monotonic() + _MOST_WAIT_S
    with (folder / _WRITING).open("w") as lock:
        while time.monotonic() < until_s:
            with suppress(BlockingIOError):
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            time.sleep(_PAUSE_S)
        yield


def forget_schedule(home: Path, schedule: NightSchedule) -> None:
    """Deletes the record of a schedule whose Prefect deployment was deleted."""
    with _writing(home):  # else a run that notes itself just now would bring it back, or be forgotten
        (home / _FOLDER / f"{schedule.deployment}.json").unlink(missing_ok=True)


def missed_nights(home: Path, name: str) -> list[MissedNight]:
    """Lists the scheduled runs of a specification that did not happen, oldest first."""
    found = [night for each in schedules_of(home) if each.name == name for night in each.missed]
    return sorted(found, key=lambda night: night.due_at)


@contextmanager
def only_one(home: Path) -> Iterator[bool]:
    """Tries to lock the check for missed nights within the block; yields whether this process got the lock.

    It does not wait. The folder of the lock is made if it is missing.
    """
    folder = home / _FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / _LOCK).open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield False
        else:
            yield True


def judged(
    schedule: NightSchedule,
    runs: Mapping[datetime, DueRun],
    *,
    is_paused: bool,
    now: datetime,
    max_late: timedelta,
    booted_at: datetime | None,
) -> NightSchedule:
    """Determines which scheduled runs did not happen since the last check, and returns the updated schedule.

    Args:
        schedule: Record of the schedule.
        runs: Prefect's runs for times of the schedule since `checked_until`, also for future times.
        is_paused: Whether Prefect begins none now.
        now: The time.
        max_late: Largest delay with which a night may begin.
        booted_at: Start time of this machine; `None`: unknown.

    Returns:
        Updated record of the schedule.
    """
    until = now - max_late
    if until <= schedule.checked_until:
        due: list[datetime] = []
    else:
        due = sorted(at for at in {*schedule.expected, *runs} if schedule.checked_until < at <= until)
    paused_since = schedule.paused_since
    if paused_since is None and is_paused:  # since the last look at most, which looked at what was due until so late
        paused_since = min(now, schedule.checked_until + max_late)
    missed = [
        MissedNight(due_at=at, reason=reason)
        for at in due
        if (reason := _why_missed(at, runs.get(at), paused_since=paused_since, booted_at=booted_at))
    ]
    waits = {*(at for at in schedule.expected if until < at <= now), *(at for at in runs if until < at)}
    return schedule.model_copy(
        update={
            "checked_until": max(until, schedule.checked_until),
            # Of a paused schedule Prefect has none any more; what it said before is when nights are due.
            "expected": sorted(waits | {at for at in schedule.expected if is_paused and at > now}),
            "paused_since": paused_since if is_paused else None,
            "missed": [*schedule.missed, *missed][-_MOST_MISSED:],
        }
    )


def _why_missed(at: datetime, run: DueRun | None, *, paused_since: datetime | None, booted_at: datetime | None) -> str:
    """Returns the reason why a scheduled run did not happen, in words; empty if it did."""
    was_off = f"this machine was off, until {booted_at:%Y-%m-%d %H:%M} UTC" if booted_at and booted_at > at else ""
    if run is None:
        if paused_since is not None:
            return PAUSED if at > paused_since else was_off or _PAUSED_LATER
        return was_off or "Prefect has no run for it: its schedule or its server was changed"
    if run.state_name == "Skipped" or run.state in ("SCHEDULED", "PENDING"):
        is_behind = run.state_name == "AwaitingConcurrencySlot"
        return "the run before it had its place" if is_behind else was_off or _NO_WORKER
    if run.has_begun:
        return ""
    if run.state in ("CANCELLED", "CANCELLING"):
        return "its run was cancelled in Prefect before it began"
    first = next(iter(run.message.splitlines()), "")
    return f"its run {run.state_name.lower()} before it began: {first}" if run.state in ("CRASHED", "FAILED") else ""


def message_of_missed(before: NightSchedule, found: NightSchedule) -> Message | None:
    """Makes the notification about scheduled runs that did not happen; `None` if nothing is new.

    Args:
        before: Record of the schedule before the check.
        found: Record of the schedule after the check.

    Returns:
        The message; `None`: there is nothing new to tell. Of a schedule that stays paused the first night is told.
    """
    known = {night.due_at for night in before.missed}
    told: list[MissedNight] = []
    last = before.missed[-1] if before.missed else None
    for night in found.missed:
        if night.due_at not in known:
            if not (night.reason == PAUSED and last is not None and _is_of_pause(last, before)):
                told.append(night)
            last = night
    if not told:
        return None
    name = found.name
    lines = [night.in_words() for night in told]
    more = f" and {len(lines) - 1} more" if len(lines) > 1 else ""
    look = f"`robomaker history {name}` has them all; `robomaker doctor` says what is missing now"
    return Message(f"{name}: {lines[-1]}{more}", "\n".join([*lines, "", look]), good=False)


def _is_of_pause(night: MissedNight, schedule: NightSchedule) -> bool:
    """Whether a scheduled run was missed because its schedule is paused, and in the present pause."""
    return night.reason == PAUSED and schedule.paused_since is not None and night.due_at > schedule.paused_since


def tell_of_missed(settings: Settings, message: Message) -> list[str]:
    """Sends the notification about missed nights to the configured channels; returns their errors.

    Returns:
        Errors of the channels that did not accept the message.
    """
    if settings.notify and settings.notify_when & _TOLD_IF:
        return send(settings.notify, message, {})
    return []


def booted_at() -> datetime | None:
    """Returns when this machine was started; `None` if unknown."""
    with suppress(OSError, ValueError):
        for line in Path("/proc/stat").read_text().splitlines():
            if line.startswith("btime "):
                return datetime.fromtimestamp(int(line.split()[1]), UTC)
    return None


def has_schedules(home: Path) -> bool:
    """Whether a data home has any recorded schedule."""
    with suppress(OSError):
        return any(path.suffix == ".json" for path in (home / _FOLDER).iterdir())
    return False
