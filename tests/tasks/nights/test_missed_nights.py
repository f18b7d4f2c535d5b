"""Nights that were due and did not happen: which, why, and how often they are told."""

import threading
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from prefect_robomaker.schemas.reports.history import MissedNight, NightSchedule
from prefect_robomaker.tasks.nights import missed_nights
from prefect_robomaker.tasks.nights.missed_nights import (
    PAUSED,
    DueRun,
    forget_schedule,
    has_run,
    judged,
    message_of_missed,
    note_schedule,
    schedules_of,
    store_schedule,
)

DUE = datetime(2026, 11, 27, 2, tzinfo=UTC)
NOW = DUE + timedelta(hours=7)
DAY = timedelta(days=1)
LATE = DueRun("SCHEDULED", "Late", "", has_begun=False)
SCHEDULE = NightSchedule(
    deployment="d", name="night", checked_until=DUE - DAY + timedelta(hours=1), expected=[DUE, DUE + DAY]
)


def look(
    run: DueRun | None,
    schedule: NightSchedule = SCHEDULE,
    *,
    now: datetime = NOW,
    is_paused: bool = False,
    booted_at: datetime | None = None,
) -> NightSchedule:
    runs = {} if run is None else {DUE: run}
    late = timedelta(hours=6)
    return judged(schedule, runs, is_paused=is_paused, now=now, max_late=late, booted_at=booted_at)


@pytest.mark.parametrize(
    ("run", "reason"),
    [
        (LATE, "no Prefect worker was running"),
        (DueRun("CANCELLED", "Skipped", "begun 9 h later", has_begun=True), "no Prefect worker was running"),
        (DueRun("SCHEDULED", "AwaitingConcurrencySlot", "", has_begun=False), "the run before it had its place"),
        (DueRun("CANCELLED", "Cancelled", "", has_begun=False), "its run was cancelled in Prefect before it began"),
        (DueRun("CRASHED", "Crashed", "no such image\nx", has_begun=False), "its run crashed before it began: no such"),
        (None, "Prefect has no run for it"),
    ],
)
def test_a_night_that_did_not_happen_says_why(run: DueRun | None, reason: str) -> None:
    [missed] = look(run).missed
    assert missed.due_at == DUE
    assert missed.reason.startswith(reason)
    assert missed.in_words().startswith(f"no night on 27 November (02:00 UTC): {reason}")


@pytest.mark.parametrize(
    "run",
    [
        DueRun("COMPLETED", "Completed", "", has_begun=True),
        DueRun("FAILED", "Failed", "", has_begun=True),
        DueRun("CRASHED", "Crashed", "", has_begun=True),  # it is finished by another process, and has a record
        DueRun("RUNNING", "Running", "", has_begun=True),
    ],
)
def test_a_night_that_began_is_not_missed(run: DueRun) -> None:
    assert look(run).missed == []


def test_a_night_killed_in_its_first_moments_has_no_run(tmp_path: Path) -> None:
    def killed(name: str = "night") -> bool:
        return has_run(tmp_path, name, DUE, DUE + timedelta(minutes=3))

    assert not killed()
    for folder in ("night-20261127T030000000", "night-2-20261127T020100000", "other-20261127T020100000"):
        (tmp_path / "runs" / folder).mkdir(parents=True)
    assert not killed()
    (tmp_path / "runs" / "night-20261127T020100000").mkdir()
    assert killed()


def test_a_machine_that_was_off_is_told_apart_from_a_missing_worker() -> None:
    [missed] = look(LATE, booted_at=DUE + timedelta(hours=3)).missed
    assert missed.reason == "this machine was off, until 2026-11-27 05:00 UTC"
    [missed] = look(LATE, booted_at=DUE - timedelta(hours=3)).missed
    assert missed.reason == "no Prefect worker was running"


def test_a_night_may_still_begin_for_some_hours() -> None:
    early = look(LATE, now=DUE + timedelta(hours=5))
    assert early.missed == []
    assert DUE in early.expected
    assert len(look(LATE, early).missed) == 1
    assert len(look(LATE, look(LATE, early), now=NOW + timedelta(minutes=1)).missed) == 1  # it is judged once


def test_a_schedule_that_is_paused_is_told_once_and_another_pause_again() -> None:
    paused = look(None, now=DUE - timedelta(hours=3), is_paused=True)
    assert paused.expected == [DUE, DUE + DAY]
    first = look(None, paused, is_paused=True)
    assert first.missed == [MissedNight(due_at=DUE, reason=PAUSED)]
    message = message_of_missed(paused, first)
    assert message is not None
    assert message.title == "night: no night on 27 November (02:00 UTC): its schedule was paused"
    second = look(None, first, now=NOW + DAY, is_paused=True)
    assert len(second.missed) == 2
    assert message_of_missed(first, second) is None
    assert message_of_missed(second, second) is None

    other = second.model_copy(update={"paused_since": NOW + DAY})
    third = other.model_copy(update={"missed": [*other.missed, MissedNight(due_at=DUE + 2 * DAY, reason=PAUSED)]})
    assert message_of_missed(other, third) is not None


@pytest.mark.parametrize("booted_at", [None, DUE + timedelta(hours=3)])
def test_a_pause_is_no_reason_of_a_night_that_was_due_before_it(booted_at: datetime | None) -> None:
    """It may still begin for six hours, and loses its run when somebody pauses the schedule in these."""
    waits = SCHEDULE.model_copy(update={"checked_until": DUE - timedelta(minutes=10)})
    paused = look(None, waits, now=DUE + timedelta(hours=6, minutes=5), is_paused=True, booted_at=booted_at)
    [missed] = paused.missed
    late = "it had not begun when its schedule was paused"
    assert missed.reason == (late if booted_at is None else "this machine was off, until 2026-11-27 05:00 UTC")
    following = look(None, paused, now=NOW + DAY, is_paused=True)
    assert following.missed[-1] == MissedNight(due_at=DUE + DAY, reason=PAUSED)
    assert message_of_missed(paused, following) is not None


def test_looks_and_runs_that_begin_lose_nothing_of_each_other(tmp_path: Path) -> None:
    """A run notes its name while a look asks Prefect, and while it stores what it found."""
    note_schedule(tmp_path, "d", "night", NOW)
    failed: list[Exception] = []

    def repeat(*acts: object) -> None:
        try:
            for number in range(150):
                for act in acts:
                    act(number)  # type: ignore[operator]
        except Exception as error:
            failed.append(error)

    def seen(number: int) -> None:
        [known] = schedules_of(tmp_path)
        night = MissedNight(due_at=DUE + number * DAY, reason=PAUSED)
        store_schedule(tmp_path, known.model_copy(update={"missed": [*known.missed, night]}))

    def noted(number: int) -> None:
        note_schedule(tmp_path, "d", f"night {number}", NOW)
        assert schedules_of(tmp_path)[0].name == f"night {number}"

    looks = [threading.Thread(target=repeat, args=[seen]), threading.Thread(target=repeat, args=[noted])]
    for each in looks:
        each.start()
    for each in looks:
        each.join()
    assert failed == []
    [found] = schedules_of(tmp_path)
    assert (found.name, len(found.missed)) == ("night 149", 150)


def test_a_schedule_is_forgotten_when_nobody_writes(tmp_path: Path) -> None:
    """Else a run that notes itself at that moment would bring it back."""
    note_schedule(tmp_path, "d", "night", NOW)
    [known] = schedules_of(tmp_path)
    forgets = threading.Thread(target=forget_schedule, args=(tmp_path, known))
    with missed_nights._writing(tmp_path):
        forgets.start()
        forgets.join(0.2)
        assert schedules_of(tmp_path) == [known]
    forgets.join()
    assert schedules_of(tmp_path) == []


def test_a_message_has_all_nights_of_a_week_off() -> None:
    nights = [MissedNight(due_at=DUE + number * DAY, reason="this machine was off") for number in range(3)]
    message = message_of_missed(SCHEDULE, SCHEDULE.model_copy(update={"missed": nights}))
    assert message is not None
    assert message.title == "night: no night on 29 November (02:00 UTC): this machine was off and 2 more"
    assert message.body.count("no night on") == 3
    assert not message.good
