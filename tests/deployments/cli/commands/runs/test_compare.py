"""compare: two runs as text, as JSON and as exit code."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from helpers.night_records import make_job, make_night, store_night

from prefect_robomaker.schemas.reports.comparison import Comparison
from prefect_robomaker.schemas.reports.run_record import RunRecord

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
        ("FFFFFFFP", "PPPPPPPP", 0, "Better: {after} passes more often than {before}, by more than chance.\n\n"
         "  how sure      8 pairs judged in both runs, p = 0.016 (exact McNemar test, alpha 0.05)"),
        ("PPPPPPPP", "FFFFFFFP", 1, "Worse: {after} passes less often than {before}, by more than chance.\n\n"
         "  how sure      8 pairs judged in both runs, p = 0.016 (exact McNemar test, alpha 0.05)"),
        ("PPPP", "FPPP", 6, "1 of 4 jobs newly fails, and none newly passes.\n"
         "Too few pairs to tell: {after} passes less often than {before}, but chance alone may do "
         "that.\n\n  how sure      4 pairs judged in both runs, p = 1 (exact McNemar test, alpha 0.05)"),
        ("PPPP", "PPPP", 6, "Too few pairs to tell: {after} passes as often as {before}, and a difference of 49 "
         "points is not excluded.\n"),
        ("P" * 40, "P" * 40, 6, "No difference shown: {after} passes as often as {before}.\n"),
        ("PPPP", "EEEE", 7, "Not comparable: {after} with {before}.\n\n  why           none of the 4 pairs was judged"),
    ],
)  # fmt: skip
def test_the_answer_comes_first_and_is_the_exit_code(
    robomaker: Any, nights: Any, before: str, after: str, code: int, answer: str
) -> None:
    nights(before, after)
    told = robomaker("compare", FIRST, SECOND)
    assert (told.code, told.err) == (code, "")
    assert told.out.startswith(answer.format(before=FIRST, after=SECOND))
    machine = robomaker("compare", FIRST, "latest", "-o", "json")
    comparison = Comparison.model_validate_json(machine.out)
    assert (machine.code, comparison.exit_code) == (code, code)


@pytest.mark.parametrize(
    ("before", "after", "code", "told"),
    [
        ("P" * 100, "P" * 98 + "FF", 0, "100 pairs judged in both runs, p = 0.5 (exact McNemar test, alpha "
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
    needed = "165 pairs, 145 more than there are, would exclude a fall by 10 points, if nothing changed, with a chance"
    assert (needed in ended.out) == (code == 6)


def test_the_text_says_how_much_what_changed_and_what_is_needed(robomaker: Any, nights: Any) -> None:
    nights("PPPFE", "FPPPE", metrics={"distance_m": 2.0})
    out = robomaker("compare", FIRST, SECOND).out
    assert "pass rate     75.0% → 75.0%, +0.0 points (95% interval -" in out
    assert "more than there are, would show a difference of 10 points, if there is one, with a chance of 80%" in out
    assert "pairs         both runs have 5 jobs; 4 pairs of jobs count; 1 without a verdict in one run\n" in out
    assert "newly failing 1\n    drive: world-1 scout, seed 7: passed → failed; gentle: 9 N, at most 5 N asked\n" in out
    assert "newly passing 1\n    drive: world-4 scout, seed 7: failed → passed" in out
    assert "still failing 1\n    drive: world-5 scout, seed 7: broken → broken; RobotApplicationCrash" in out
    assert "metrics       0 changed by more than chance, 1 stayed the same" in out
    assert "(99.7% interval -" in robomaker("compare", FIRST, SECOND, "--alpha", "0.003").out
    asked = robomaker("compare", FIRST, SECOND, "--difference", "50").out
    assert "would show a difference of 50 points, as asked for," in asked


def with_margins(night: RunRecord, margins: Sequence[float]) -> RunRecord:
    """The jobs of a run with these margins, in metres."""
    asked = [
        [job.requirements[0].model_copy(update={"margin": margin, "unit": "m"})]
        for job, margin in zip(night.jobs, margins, strict=True)
    ]
    jobs = [job.model_copy(update={"requirements": each}) for job, each in zip(night.jobs, asked, strict=True)]
    return night.model_copy(update={"jobs": jobs})


@pytest.mark.parametrize(
    ("before", "after", "first", "more"),
    [
        ([0.38], [0.12], "Margins of requirements fell: gentle, not tested.\n", [
            "gentle: 0.38 → 0.12 m; whether by chance was not tested: there is 1 pair, and a test takes 2 or more\n",
            "fell in 1 of 1 pair, most in drive: world-1 scout, seed 7: 0.38 → 0.12 m\n",
            "metrics       not tested: there is 1 pair, and a test takes 2 or more\n",
            "  watch one     robomaker repro sim-1-0\n",
        ]),
        ([0.38, 0.4, 0.42], [0.12, 0.13, 0.17], "Margins of requirements fell: gentle, by more than chance.\n", [
            "gentle: 0.4 → 0.14 m on average of 3 pairs, -0.26 m, by more than chance (95% interval -0.28",
            "fell in 3 of 3 pairs, most in drive: world-2 scout, seed 7: 0.4 → 0.13 m\n",
        ]),
        ([0.3, 0.4, 0.1], [0.29, 0.1, 0.1], "Margins of requirements fell: gentle, perhaps by chance.\n", [
            "on average of 3 pairs, -0.1033 m, which may be chance (95% interval ",
            "fell in 2 of 3 pairs, most in drive: world-2 scout, seed 7: 0.4 → 0.1 m\n",
        ]),
        ([0.3, 0.1], [0.3, 0.1], "\n", ["margins       those of 1 requirement stayed the same\n"]),
    ],
)  # fmt: skip
def test_margins_that_fell_are_told_where_the_verdicts_are_the_same(
    robomaker: Any, home: Path, before: list[float], after: list[float], first: str, more: list[str]
) -> None:
    for number, margins in enumerate((before, after)):
        night = make_night("P" * len(margins), number, runs=home / "runs", metrics={"min_clearance_m": margins[0]})
        store_night(with_margins(night, margins))
    out = robomaker("compare", FIRST, SECOND).out
    answer, rest = out.split("\n", 1)
    assert answer.startswith(f"Too few pairs to tell: {SECOND} passes as often as {FIRST}, and a difference of ")
    assert rest.startswith(first)
    assert [each for each in more if each not in out] == []


def test_metrics_have_names_for_people(robomaker: Any, home: Path) -> None:
    for number, metres in enumerate((0.5, 0.25)):
        jobs = [make_job(index, "P", night=number, metrics={"min_clearance_m": metres + index / 1e3})
                for index in range(3)]  # fmt: skip
        store_night(make_night(jobs, number, runs=home / "runs"))
    out = robomaker("compare", FIRST, SECOND).out
    assert "\n    min clearance: 0.501 → 0.251 m on average of 3 pairs, -0.25 m, by more than chance" in out
    assert "min_clearance_m" not in out


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


def test_runs_that_are_named_in_reverse_are_told_so(robomaker: Any, nights: Any) -> None:
    nights("PPPPPPPP", "FFFFFFFP")
    note = f"A, {SECOND}, is the newer run: what changed since is told backwards.\n"
    assert note in robomaker("compare", SECOND, FIRST).out
    assert "newer run" not in robomaker("compare", FIRST, SECOND).out
