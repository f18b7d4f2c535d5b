from datetime import datetime, timedelta, timezone

import pytest

from prefect_robomaker.tasks.reporting import outcomes


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.02, "20 ms"),
        (0.0996, "0.1 s"),
        (12.34, "12.3 s"),
        (59.97, "1 min"),
        (125, "2 min 5 s"),
        (3599.7, "1 h"),
        (3780, "1 h 3 min"),
    ],
)
def test_duration(seconds: float, text: str) -> None:
    assert outcomes.duration(seconds) == text


@pytest.mark.parametrize(
    ("count", "text"),
    [(0, "0 B"), (999, "999 B"), (4180, "4.2 kB"), (999_960, "1.0 MB"), (123_456, "123 kB"), (5 * 10**12, "5.0 TB")],
)
def test_size(count: int, text: str) -> None:
    assert outcomes.size(count) == text


@pytest.mark.parametrize(
    ("metric", "name", "unit"),
    [
        ("distance_m", "distance", "m"),
        ("mean_speed_m_s", "speed, mean", "m/s"),
        ("mean_mean_speed_m_s", "speed, mean", "m/s"),
        ("mean_sim_time_s", "simulated time, mean", "s"),
        ("trials_errors", "trials that broke", ""),
        ("max_force_N", "max force", "N"),
        ("covered_area_m2", "covered area", "m²"),
        ("replans", "replans", ""),
        ("m", "m", ""),
    ],
)
def test_metric_names_lose_their_unit(metric: str, name: str, unit: str) -> None:
    assert outcomes.name_and_unit(metric) == (name, unit)


def test_numbers_that_are_none_show_a_dash() -> None:
    assert [outcomes.number(value, 1) for value in (None, float("nan"), float("inf"), 2.25)] == ["–", "–", "–", "2.2"]
    assert [outcomes.compact(value) for value in (4.0, 0.48712, float("nan"))] == ["4", "0.4871", "nan"]


def test_logs_lose_terminal_codes_and_keep_their_lines() -> None:
    log = "\x1b[1;31mError\x1b[0m: x\r\n\x1b]8;;http://a\x07link\x1b]8;;\x07\x00\n\tindented\n"
    assert outcomes.plain(log) == "Error: x\nlink\n\tindented"


def test_moments_are_told_in_utc() -> None:
    there = datetime(2026, 3, 2, 11, 30, tzinfo=timezone(timedelta(hours=2)))
    assert outcomes.moment(there) == outcomes.moment(datetime(2026, 3, 2, 9, 30)) == "2026-03-02 09:30:00 UTC"
