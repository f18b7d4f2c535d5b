"""compare: two runs as text, as JSON and as exit code."""

import json
from pathlib import Path
from typing import Any

import pytest
from helpers.night_records import make_night, store_night

from prefect_robomaker.schemas.reports.comparison import Comparison

FIRST, SECOND = "nightly-20260301T020000000", "nightly-20260302T020000000"


@pytest.fixture
def nights(home: Path) -> Any:
    """Stores two runs with these verdicts."""

    def store(before: str, after: str, **members: Any) -> None:
        for number, verdicts in enumerate((before, after)):
            store_night(make_night(verdicts, number, runs=home / "runs", **members))

    return store


@pytest.mark.parametrize(
    ("before", "after", "code", "answer"),
    [
        ("FFFFFFFP", "PPPPPPPP", 0, "Better: 8 pairs judged in both runs, p = 0.016 (exact McNemar test, alpha 0.05)"),
        ("PPPPPPPP", "FFFFFFFP", 1, "Worse: 8 pairs judged in both runs, p = 0.016 (exact McNemar test, alpha 0.05)"),
        ("PPPP", "FPPP", 6, "No difference shown: 4 pairs judged in both runs, p = 1 (exact McNemar test, alpha 0.05)"),
        ("PPPP", "EEEE", 7, "Not comparable: none of the 4 pairs was judged in both runs"),
    ],
)
def test_the_answer_is_the_exit_code(
    robomaker: Any, nights: Any, before: str, after: str, code: int, answer: str
) -> None:
    nights(before, after)
    told = robomaker("compare", FIRST, SECOND)
    assert (told.code, told.err) == (code, "")
    assert f"{SECOND} compared with {FIRST}\n{answer}" in told.out
    machine = robomaker("compare", FIRST, "latest", "-o", "json")
    comparison = Comparison.model_validate_json(machine.out)
    assert (machine.code, comparison.exit_code) == (code, code)


@pytest.mark.parametrize(
    ("before", "after", "code", "told"),
    [
        ("P" * 100, "P" * 98 + "FF", 0, "Not worse: 100 pairs judged in both runs, p = 0.5 (exact McNemar test, alpha "
         "0.05); the pass rate did not fall by 10 points or more (p = 0.0038, Tango's score test)"),
        ("P" * 20, "P" * 20, 6, "a fall by 10 points or more is not excluded (p = 0.068, Tango's score test)"),
        ("P" * 30, "P" * 20 + "F" * 10, 1, "Worse: "),
    ],
)  # fmt: skip
def test_a_margin_lets_a_gate_pass(robomaker: Any, nights: Any, before: str, after: str, code: int, told: str) -> None:
    nights(before, after)
    ended = robomaker("compare", FIRST, SECOND, "--margin", "10points")
    assert ended.code == code
    assert told in ended.out
    needed = "15 more pairs, 35 in all, to exclude a fall by 10 points with a chance of 80%, if nothing changed"
    assert (needed in ended.out) == (code == 6)


def test_the_text_says_how_much_what_changed_and_what_is_needed(robomaker: Any, nights: Any) -> None:
    nights("PPPFE", "FPPPE", metrics={"distance_m": 2.0})
    out = robomaker("compare", FIRST, SECOND).out
    assert "pass rate     75.0% → 75.0%, +0.0 points (95% interval -" in out
    assert "more pairs" in out
    assert "to show a difference, of which there was none, of 10 points with a chance of 80%" in out
    assert "pairs         5 jobs of both runs, 1 without a verdict in one\n" in out
    assert "newly failing 1\n    drive: world-1 scout, seed 7: passed → failed; gentle: 9 N, at most 5 N asked\n" in out
    assert "newly passing 1\n    drive: world-4 scout, seed 7: failed → passed" in out
    assert "still failing 1\n    drive: world-5 scout, seed 7: broken → broken; RobotApplicationCrash" in out
    assert "metrics       0 changed, 1 show no change" in out
    assert "(99.7% interval -" in robomaker("compare", FIRST, SECOND, "--alpha", "0.003").out
    asked = robomaker("compare", FIRST, SECOND, "--difference", "50").out
    assert "to show the difference asked for of 50 points" in asked


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((FIRST, FIRST), f"both runs are {FIRST}; name two"),
        ((FIRST, "nothing"), "there is no run 'nothing'"),
        ((FIRST, SECOND, "--alpha", "0"), "--alpha is 0; it has to be above 0 and below 1, such as 0.05"),
        ((FIRST, SECOND, "--alpha", "nan"), "--alpha is nan"),
        ((FIRST, SECOND, "--difference", "101"), "--difference is '101'; a number above 0 and at most 100, such as 5"),
        ((FIRST, SECOND, "--margin", "100"), "--margin is '100'; a number above 0 and below 100, such as 5"),
        ((FIRST, SECOND, "--margin", "-5"), "--margin is '-5'; a number above 0"),
        ((FIRST, SECOND, "--margin", "5", "--difference", "5"), "ask for different numbers of pairs; leave one out"),
    ],
)
def test_bad_usage_has_a_code_of_its_own(robomaker: Any, nights: Any, words: tuple[str, ...], said: str) -> None:
    nights("P", "P")
    told = robomaker("compare", *words)
    assert told.code == 2
    assert said in told.err


def test_records_of_other_versions_are_refused(robomaker: Any, nights: Any, home: Path) -> None:
    nights("PP", "PF")
    path = home / "runs" / FIRST / "run.json"
    record = json.loads(path.read_text())
    path.write_text(json.dumps({**record, "schema_version": 9}))
    newer = robomaker("compare", FIRST, SECOND)
    assert newer.code == 2
    assert f"{path} is not a run's record: schema_version" in newer.err
