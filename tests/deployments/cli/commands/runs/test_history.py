"""history: the runs of a specification as text, as JSON and as a page."""

import json
from pathlib import Path
from typing import Any

import pytest
from helpers.night_records import make_night, make_trials_night, store_night

from prefect_robomaker.schemas.reports.history import History
from prefect_robomaker.tasks.inspection.run_records import write_record


@pytest.fixture
def nights(home: Path) -> None:
    """Three runs of one specification, one of another whose name begins the same."""
    for number, verdicts in enumerate(("PPP", "PFP", "PFE")):
        store_night(make_night(verdicts, number, runs=home / "runs", robot=f"robot {min(number, 1)}"))
    store_night(make_night("F", 0, name="nightly-long", runs=home / "runs"))


def test_the_text_opens_with_what_changed(robomaker: Any, nights: None, home: Path) -> None:
    told = robomaker("history", "nightly")
    assert (told.code, told.err) == (0, "")
    assert told.out.startswith("nightly: 3 runs\n")
    assert "newly failing 1\n    drive: world-3 scout, seed 7: RobotApplicationCrash: ZeroDivisionError\n" in told.out
    assert "still failing 1\n    drive: world-2 scout, seed 7: gentle: 9 N, at most 5 N asked\n" in told.out
    assert "fails since 2026-03-02 02:00:00 UTC, 2 runs; changed then: application scout " in told.out
    assert "2026-03-03 02:00    50%  9%–91%          1      1      1\n" in told.out
    page = home / "history" / "nightly.html"
    assert f"  page     {page}\n" in told.out
    assert 'href="../runs/nightly-20260303T020000000/report.html"' in page.read_text()


def test_a_margin_that_shrinks_is_told_before_it_is_missed(robomaker: Any, home: Path) -> None:
    for night, limit in enumerate((21.0, 18.1, 15.0, 12.0, 9.9)):
        store_night(make_night("PP", night, runs=home / "runs", name="shrinks", limit=limit))
    margins = "12, 9.1, 6, 3, 0.9 N in the last 5 runs of as many trials"
    said = f"gentle: its smallest margin shrinks, {margins}: missed in about 1 more"
    assert said in robomaker("history", "shrinks").out
    assert said in (home / "history" / "shrinks.html").read_text()
    assert "No verdict changed" not in (home / "history" / "shrinks.html").read_text()


def test_without_a_name_it_lists_the_specifications_that_have_runs(robomaker: Any, nights: None, home: Path) -> None:
    told = robomaker("history")
    assert (told.code, told.err) == (0, "")
    assert told.out.splitlines() == [
        "nightly       2026-03-03 02:00  broken, 1 of 3 jobs passed",
        "nightly-long  2026-03-01 02:00  failed, 0 of 1 job passed",
    ]
    listed = json.loads(robomaker("history", "-o", "json").out)["specifications"]
    assert [each["name"] for each in listed] == ["nightly", "nightly-long"]
    make_trials_night(("PPP", "PP"), name="trials", runs=home / "runs")
    assert [line.partition("02:00  ")[2] for line in robomaker("history").out.splitlines()[2:]] == [
        "passed, 2 of 2 jobs passed (5 of 5 trials passed)"
    ]
    assert "--to is for the page of one" in robomaker("history", "--to", "x.html").err


def test_the_list_says_that_a_run_took_over_its_results(robomaker: Any, home: Path) -> None:
    record = make_trials_night(("PPP", "PF"), 1, runs=home / "runs")
    jobs = [job.model_copy(update={"reused_from": "nightly-20260301T020000000"}) for job in record.jobs]
    write_record(record.model_copy(update={"jobs": jobs}))
    assert robomaker("history").out == "nightly  2026-03-02 02:00  succeeded, 1 of 2 jobs passed, taken over\n"
    (listed,) = json.loads(robomaker("history", "-o", "json").out)["specifications"]
    assert listed["taken_over"] == 2


def test_a_run_alone_is_compared_with_the_run_before_it(robomaker: Any, nights: None) -> None:
    alone, both = robomaker("compare", "nightly"), robomaker("compare", "nightly-20260302T020000000", "nightly")
    assert (alone.out, alone.code, alone.err) == (both.out, both.code, "")


def test_without_runs_the_list_says_so(robomaker: Any, home: Path) -> None:
    told = robomaker("history")
    assert (told.code, told.out) == (0, f"there are no runs in {home}/runs yet; `robomaker run SPEC` makes one\n")


def test_json_and_options(robomaker: Any, nights: None, tmp_path: Path) -> None:
    told = robomaker("history", "nightly", "-o", "json", "--runs", "2", "--to", tmp_path / "page.html")
    history = History.model_validate_json(told.out)
    assert [night.run_id[8:16] for night in history.nights] == ["20260302", "20260303"]
    assert history.left_out >= 1
    assert (tmp_path / "page.html").is_file()
    assert len(History.model_validate_json(robomaker("history", "nightly-long", "-o", "json").out).nights) == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("daily",), "there is no run of 'daily' in {home}/runs; there are runs of nightly, nightly-long"),
        (("../nightly",), "there is no run of '../nightly'"),
        (("nightly", "--runs", "0"), "--runs is 0; it has to be a number from 1"),
        (("nightly", "--to", "/nowhere/page.html"), "--to is /nowhere/page.html; it has to be a file in a folder"),
    ],
)
def test_bad_usage_is_told(robomaker: Any, nights: None, home: Path, words: tuple[str, ...], said: str) -> None:
    told = robomaker("history", *words)
    assert told.code == 2
    assert said.format(home=home) in told.err


def test_challenges_and_probes_are_no_nights(robomaker: Any, nights: None, home: Path) -> None:
    probe = make_night("P", name="nightly-challenge", runs=home / "runs").model_copy(update={"probe": True})
    store_night(probe)
    told = robomaker("history", "nightly-challenge")
    assert told.code == 2
    assert told.err.endswith(
        f"no run of 'nightly-challenge' in {home}/runs is a night: "
        "challenges, probes and reruns of some jobs are none; `robomaker report RUN` shows one\n"
    )
    told = robomaker("history", "daily")
    assert told.err.endswith("there are runs of nightly, nightly-long\n"), "what it names has a history"


def test_without_runs_it_says_how_to_make_one(robomaker: Any) -> None:
    told = robomaker("history", "nightly")
    assert told.code == 2
    assert "there are none yet; `robomaker run SPEC` makes one" in told.err


def test_a_record_that_cannot_be_read_is_left_out(robomaker: Any, nights: None, home: Path) -> None:
    record = home / "runs" / "nightly-20260302T020000000" / "run.json"
    record.write_text("{}")
    told = robomaker("history", "nightly", "-o", "json")
    assert told.code == 0
    assert f"left out: {record} is not a run's record" in told.err
    assert len(History.model_validate_json(told.out).nights) == 2
