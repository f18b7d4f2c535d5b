from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from prefect_robomaker.schemas.runs.plan import ENVIRONMENT_VERDICT, Collision, Requirement, RunResult
from prefect_robomaker.schemas.runs.requirement_kinds.off import OffRequirement, OffRule
from prefect_robomaker.tasks.runtime.episode.run_results import (
    EnvironmentReport,
    Episode,
    Findings,
    make_result,
    read_report,
    write_result,
)


def episode(report: EnvironmentReport, wall_time_s: float = 0.5) -> Episode:
    return Episode("environment", report, steps=10, sim_time_s=2.0, wall_time_s=wall_time_s)


def test_an_environment_that_judges_nothing() -> None:
    assert read_report(object()) == EnvironmentReport()


def test_numbers_of_numpy_are_welcome_in_dicts() -> None:
    report = {
        "verdict": "FAIL",
        "metrics": {"m": np.float32(0.5), "n": np.int64(3)},
        "path": [np.array([0.0, 1.0, 2.0])],
    }
    read = read_report(SimpleNamespace(run_result=lambda: report))
    assert (read.verdict, read.metrics, read.path) == ("FAIL", {"m": 0.5, "n": 3.0}, [(0.0, 1.0, 2.0)])


@pytest.mark.parametrize("report", [{"verdict": "MAYBE"}, {"verdct": "PASS"}, None, {"metrics": {"x": "far"}}])
def test_other_reports_are_refused(report: Any) -> None:
    with pytest.raises(ValueError, match=r"run_result\(\) returned something that is no EnvironmentReport: \w+"):
        read_report(SimpleNamespace(run_result=lambda: report))


def test_long_lists_are_cut() -> None:
    collision = Collision(time_s=0.0, duration_s=0.1, x=0.0, y=0.0, other="wall", max_force_N=1.0)
    path = [(float(i), 0.0, 0.0) for i in range(601)]
    result = make_result(episode(EnvironmentReport(collisions=[collision] * 201, path=path)), 1)
    assert len(result.collisions) == 200
    assert len(result.path) == 600
    assert (result.path[0], result.path[-1]) == (path[0], path[-1])


def test_written_whole_and_read_back(tmp_path: Path) -> None:
    report = EnvironmentReport(verdict="PASS", metrics={"a_m": 1.5, "b": float("inf")}, extra={"kept": [1]})
    result = make_result(episode(report), 7, [Findings({"video_error": "no driver"})])
    path = write_result(result, tmp_path)
    assert RunResult.model_validate_json(path.read_bytes()) == result
    assert result.real_time_factor == 4.0
    assert result.extra == {"kept": [1], "video_error": "no driver", "not_finite": {"b": "inf"}}
    assert [item.name for item in tmp_path.iterdir()] == ["result.json"]


def test_what_json_cannot_say_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="cannot be written as JSON"):
        write_result(make_result(episode(EnvironmentReport(extra={"x": object()})), 1), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_no_time_no_factor() -> None:
    assert make_result(episode(EnvironmentReport(), wall_time_s=0.0), 1).real_time_factor == 0.0


@pytest.mark.parametrize(
    ("satisfied", "others", "verdict"), [(True, True, "PASS"), (False, True, "FAIL"), (True, False, "FAIL")]
)
def test_of_two_requirements_of_one_name_the_jobs_counts(satisfied: bool, others: bool, verdict: str) -> None:
    own = [
        Requirement(name="gentle", satisfied=False, detail="30 N, at most 20 N"),
        Requirement(name="upright", satisfied=others, detail="the robot stayed upright"),
    ]
    asked = Requirement(name="gentle", kind="no_collision", satisfied=satisfied, detail="30 N, at most 50 N")
    report = EnvironmentReport(verdict="FAIL", summary="Failed: 30 N.", requirements=own)

    result = make_result(episode(report), 1, [Findings(requirements=[asked])])

    assert result.verdict == verdict
    assert [item.name for item in result.requirements] == ["upright", "gentle"]
    assert result.requirements[1].kind == "no_collision"
    assert ("The job's own gentle counts instead." in result.summary) == satisfied


OFF = OffRule(OffRequirement(kind="off", name="rooms")).judged(2.0, "environment")
ROOMS = Requirement(name="rooms", satisfied=False, detail="1 of 2 rooms")
GENTLE = Requirement(name="gentle", satisfied=True, detail="0 N, at most 20 N")
ASKED = Requirement(name="quick", kind="time_limit", satisfied=True, detail="ended at 2 s")


@pytest.mark.parametrize(
    ("own", "asked", "verdict"),
    [
        ([ROOMS, GENTLE], [], "PASS"),
        ([ROOMS, GENTLE.model_copy(update={"satisfied": False})], [], "FAIL"),
        ([ROOMS], [], "NONE"),  # nothing is left that was judged
        ([ROOMS.model_copy(update={"satisfied": True})], [], "NONE"),
        ([ROOMS], [ASKED], "PASS"),
        ([ROOMS], [ASKED.model_copy(update={"satisfied": False})], "FAIL"),
    ],
)
def test_what_a_job_switches_off_of_the_environments_own_does_not_count(
    own: list[Requirement], asked: list[Requirement], verdict: str
) -> None:
    passed = all(item.satisfied for item in own)
    report = EnvironmentReport(verdict="PASS" if passed else "FAIL", summary="Told.", requirements=own)

    result = make_result(episode(report), 1, [Findings(requirements=[OFF, *asked])])

    assert result.verdict == verdict
    [off] = [item for item in result.requirements if item.name == "rooms"]
    assert (off.kind, off.counts, off.error) == ("off", False, None)
    assert off.detail == "switched off by the job: 1 of 2 rooms"
    assert ("The job has switched rooms off." in result.summary) == (not own[0].satisfied)
    if asked and not asked[0].satisfied:
        assert result.summary.startswith("Not met: quick: ended at 2 s. Told."), "what counts comes first"


@pytest.mark.parametrize(("own", "words"), [([GENTLE], "to switch off; it has gentle"), ([], "to switch off")])
def test_switching_off_what_is_not_there_is_an_error(own: list[Requirement], words: str) -> None:
    report = EnvironmentReport(verdict="PASS", requirements=own)
    result = make_result(episode(report), 1, [Findings(requirements=[OFF, ASKED])])
    assert result.verdict == "ERROR"
    assert (result.reason or "").endswith(words)


def test_a_run_that_was_cancelled_has_no_verdict() -> None:
    missed = Requirement(name="rooms", satisfied=False, detail="1 of 2 rooms")
    asked = Requirement(name="gentle", satisfied=False, detail="30 N, at most 20 N")
    report = EnvironmentReport(verdict="PASS", summary="All well.", requirements=[missed])
    canceled = Episode("canceled", report, steps=10, sim_time_s=2.0, wall_time_s=0.5)

    result = make_result(canceled, 1, [Findings(requirements=[asked])])

    assert result.verdict == "NONE"
    assert result.summary == "Canceled at 2.0 s, so that nothing was judged."
    assert [item.counts for item in result.requirements] == [False, False]
    assert result.reason is None


@pytest.mark.parametrize(("satisfied", "told"), [(True, "FAIL"), (False, None)])
def test_an_environments_own_fail_is_told_where_no_requirement_of_it_tells(satisfied: bool, told: str | None) -> None:
    own = [Requirement(name="upright", satisfied=satisfied, detail="leaned 0.1 rad")]
    missed = Requirement(name="gentle", satisfied=False, detail="9 N, at most 5 N asked")
    report = EnvironmentReport(verdict="FAIL", requirements=own)
    result = make_result(episode(report), 1, [Findings(requirements=[missed])])
    assert (result.verdict, result.extra.get(ENVIRONMENT_VERDICT)) == ("FAIL", told)
