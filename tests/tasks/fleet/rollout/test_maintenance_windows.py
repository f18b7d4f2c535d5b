"""Maintenance windows: when they are open, by the clocks of their time zones."""

from datetime import UTC, datetime, timedelta
from typing import Any
from zoneinfo import ZoneInfo

import pytest
from helpers.examples import examples
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from prefect_robomaker.schemas.fleet.operations.deployment_jobs import MaintenanceWindow
from prefect_robomaker.tasks.fleet.rollout.maintenance_windows import closed_spans, is_open, next_change_s, opens_s

DAYS = ["MONDAY", "TUESDAY", "WEDNESDAY", "THURSDAY", "FRIDAY", "SATURDAY", "SUNDAY"]
NIGHT = MaintenanceWindow(startTime="22:30", durationInSeconds=4 * 3600, timeZone="Europe/Berlin")


def at(text: str, zone: str = "Europe/Berlin") -> float:
    return datetime.fromisoformat(text).replace(tzinfo=ZoneInfo(zone)).timestamp()


def shown(moment_s: float | None, zone: str = "Europe/Berlin") -> str:
    assert moment_s is not None
    return datetime.fromtimestamp(moment_s, ZoneInfo(zone)).strftime("%a %d %H:%M")


def test_without_windows_it_is_always_open() -> None:
    assert is_open((), 0)
    assert next_change_s((), 0) is None
    assert opens_s((), 17.0) == 17.0


def test_when_it_was_closed() -> None:
    closed = list(closed_spans([NIGHT], at("2026-01-05 20:00"), at("2026-01-06 23:00")))

    assert [(shown(from_s), shown(until_s)) for from_s, until_s in closed] == [
        ("Mon 05 20:00", "Mon 05 22:30"),
        ("Tue 06 02:30", "Tue 06 22:30"),
    ]
    assert list(closed_spans([NIGHT], at("2026-01-05 23:00"), at("2026-01-06 01:00"))) == []
    assert list(closed_spans([], 0.0, 9.0)) == []


def test_a_night_goes_on_after_midnight() -> None:
    assert not is_open([NIGHT], at("2026-01-05 22:29"))
    assert is_open([NIGHT], at("2026-01-05 22:30"))
    assert is_open([NIGHT], at("2026-01-06 02:29"))
    assert not is_open([NIGHT], at("2026-01-06 02:30"))
    assert shown(next_change_s([NIGHT], at("2026-01-05 23:00"))) == "Tue 06 02:30"
    assert shown(opens_s([NIGHT], at("2026-01-06 03:00"))) == "Tue 06 22:30"


def test_on_days_on_which_clocks_change_it_begins_by_the_clock_and_lasts_as_long() -> None:
    assert shown(next_change_s([NIGHT], at("2026-03-28 23:00"))) == "Sun 29 03:30", "an hour is left out"
    assert shown(next_change_s([NIGHT], at("2026-10-24 23:00"))) == "Sun 25 02:30", "the first 02:30 is summer's"
    assert (next_change_s([NIGHT], at("2026-10-24 23:00")) or 0) - at("2026-10-24 22:30") == 4 * 3600


def test_a_window_of_one_day_opens_in_the_next_week() -> None:
    window = MaintenanceWindow(days=["SUNDAY"], startTime="03:00", durationInSeconds=3600)
    assert shown(opens_s([window], at("2026-01-05 00:00", "UTC")), "UTC") == "Sun 11 03:00"
    assert shown(opens_s([window], at("2026-01-04 04:00", "UTC")), "UTC") == "Sun 11 03:00"


def test_windows_without_a_gap_are_one() -> None:
    whole_day = MaintenanceWindow(startTime="00:00", durationInSeconds=24 * 3600)
    now_s = at("2026-01-05 12:00", "UTC")
    assert is_open([whole_day], now_s)
    assert (next_change_s([whole_day], now_s) or 0) > now_s + 5 * 86400, "only a moment to ask again"


WINDOWS = st.builds(
    MaintenanceWindow,
    days=st.none() | st.lists(st.sampled_from(DAYS), min_size=1, max_size=3, unique=True),
    startTime=st.builds("{:02}:{:02}".format, st.integers(0, 23), st.sampled_from([0, 15, 59])),
    durationInSeconds=st.integers(1, 24 * 60).map(lambda minutes: minutes * 60),
    timeZone=st.sampled_from([None, "Europe/Berlin", "Asia/Kathmandu", "America/St_Johns"]),
)


def minute_by_minute(windows: list[MaintenanceWindow], begin: datetime, minutes: int) -> list[bool]:
    """Whether robots may be changed, in each minute: windows begin when a clock on a wall shows their time."""
    left = dict.fromkeys(range(len(windows)), 0.0)
    found: list[bool] = []
    for minute in range(-26 * 60, minutes):
        moment = begin + timedelta(minutes=minute)
        for number, window in enumerate(windows):
            wall = moment.astimezone(ZoneInfo(window.timeZone or "UTC"))
            if wall.strftime("%H:%M") == window.startTime and (not window.days or DAYS[wall.weekday()] in window.days):
                left[number] = max(left[number], window.durationInSeconds)
        found.append(any(seconds > 0 for seconds in left.values()))
        left = {number: seconds - 60 for number, seconds in left.items()}
    return found[26 * 60 :]


@examples(25)
@given(st.lists(WINDOWS, min_size=1, max_size=3), st.integers(0, 300))
def test_they_are_open_as_clocks_on_walls_say(windows: list[MaintenanceWindow], day: int) -> None:
    begin = datetime(2026, 4, 2, tzinfo=UTC) + timedelta(days=day % 170)  # no clock changes until October
    expected = minute_by_minute(windows, begin, 2 * 1440)

    start_s = begin.timestamp()
    assert [is_open(windows, start_s + 60 * minute) for minute in range(0, 2 * 1440, 7)] == expected[::7]
    change_s = next_change_s(windows, start_s)
    changed = next((minute for minute, each in enumerate(expected) if each != expected[0]), None)
    if changed is not None:
        assert change_s == start_s + 60 * changed


@pytest.mark.parametrize(
    ("members", "said"),
    [
        ({"startTime": "24:00"}, "startTime"),
        ({"durationInSeconds": 59}, "durationInSeconds"),
        ({"timeZone": "Mars/Crater"}, "'Mars/Crater' is no time zone"),
        ({"timeZone": "../etc/passwd"}, "is no time zone"),
        ({"days": []}, "days"),
    ],
)
def test_what_is_no_window_is_refused(members: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        MaintenanceWindow.model_validate({"startTime": "22:00", "durationInSeconds": 3600, **members})
