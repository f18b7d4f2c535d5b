"""The table of a challenge: which cells count, which requirement is named, and when a challenge is passed."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.reports.challenge import Challenge, SabotageResult
from prefect_robomaker.schemas.runs.plan import Requirement
from prefect_robomaker.tasks.results.challenge_verdicts import Arm, table_of

LATE, BLIND = "late", "blind"
ASKED = Challenge(sabotages=[SabotageResult(name=name, axes={"motor_delay_s": 0.5}) for name in (LATE, BLIND)])


def missed(name: str, at_s: float | None, **more: Any) -> Requirement:
    return Requirement(name=name, satisfied=False, detail="missed", first_violation_s=at_s, **more)


def control(job: int, **changes: Any) -> Arm:
    return replace(Arm(job, f"job {job}", verdict="PASS", state_digest=f"as it is {job}"), **changes)


def sabotaged(job: int, sabotage: str = LATE, **changes: Any) -> Arm:
    return replace(Arm(job, f"job {job}", sabotage, verdict="PASS", state_digest=f"{sabotage} {job}"), **changes)


def told(arms: Sequence[Arm], sabotage: str = LATE) -> str:
    return next(each.in_words for each in table_of(ASKED, arms).sabotages if each.name == sabotage)


def test_the_requirement_that_caught_it_first_is_named() -> None:
    unjudged = missed("broken", 0.1, error="it could not be measured")
    other = missed("not asked", 0.2, counts=False)
    arms = [
        *(control(job) for job in (1, 2, 3)),
        sabotaged(1, verdict="FAIL", requirements=[missed("at home", None), missed("polite", 7.25)]),
        sabotaged(2, verdict="FAIL", requirements=[unjudged, other, missed("gentle", 3.0)]),
        sabotaged(3),
    ]
    assert told(arms) == "caught by 2 of 3 jobs, first by gentle at 3.0 s, missed by 1"
    assert told([control(1), sabotaged(1, verdict="FAIL", requirements=[missed("rooms", None)])]) == (
        "caught by the only job, first by rooms"
    )


@pytest.mark.parametrize(
    ("jobs", "said"),
    [
        (1, "missed by the only job; nothing here would notice it"),
        (2, "missed by both jobs; nothing here would notice it"),
        (4, "missed by all 4 jobs; nothing here would notice it"),
    ],
)
def test_what_no_job_notices_is_said(jobs: int, said: str) -> None:
    numbers = range(jobs)
    assert told([*map(control, numbers), *map(sabotaged, numbers)]) == said


def test_what_changed_nothing_was_neither_caught_nor_missed() -> None:
    arms = [control(1), control(2), sabotaged(1, state_digest="as it is 1"), sabotaged(2)]
    assert told(arms) == "missed by 1 of 2 jobs, no effect in 1; nothing here would notice it"
    arms[-1] = sabotaged(2, state_digest="as it is 2")
    assert told(arms) == "had no effect in both jobs"
    assert not table_of(ASKED, arms).is_passed
    without = [replace(arm, state_digest=None) for arm in arms]
    assert told(without) == "missed by both jobs; nothing here would notice it", "without states nothing tells it"


def test_what_cannot_be_applied_is_not_caught() -> None:
    """A robot without a lidar fails the job of the blind one, but no requirement did."""
    refused = {"verdict": None, "failure_code": "InvalidInput", "reason": "trials.axes…"}
    arms = [
        control(1),
        sabotaged(1, verdict="FAIL", requirements=[missed("gentle", 3.0)]),
        sabotaged(1, BLIND, not_applicable="the robot has no lidar", **refused),
    ]
    table = table_of(ASKED, arms)
    assert told(arms, BLIND) == "not applicable: the robot has no lidar"
    assert table.headline == "1 of 1 sabotage caught; 1 not applicable"
    assert table.is_passed

    none = table_of(
        ASKED, [control(1), *(sabotaged(1, name, not_applicable="no", **refused) for name in (LATE, BLIND))]
    )
    assert not none.is_passed, "a challenge that sabotaged nothing shows nothing"


def test_a_job_that_fails_with_the_real_robot_shows_nothing() -> None:
    arms = [
        control(1, verdict="FAIL", reason="gentle: 300 N"),
        *(sabotaged(1, name, verdict="FAIL", requirements=[missed("gentle", 3.0)]) for name in (LATE, BLIND)),
    ]
    table = table_of(ASKED, arms)
    assert table.jobs[0].in_words == (
        "job 1: the robot fails here without a sabotage (gentle: 300 N), so this job shows nothing"
    )
    assert [each.caught for each in table.sabotages] == [0, 0]
    assert "No job passes with the real robot" in table.headline
    assert not table.is_passed


def test_jobs_without_requirements_can_catch_nothing() -> None:
    table = table_of(ASKED, [control(1, verdict="NONE"), sabotaged(1, verdict="NONE"), sabotaged(1, BLIND)])
    assert table.headline.startswith("No job has requirements, so that nothing could catch anything")
    assert "has no requirements" in table.jobs[0].in_words
    assert not table.is_passed
    assert not table.is_broken


@pytest.mark.parametrize("code", ["RobotApplicationCrash", "SimulationApplicationCrash"])
def test_a_crash_is_noticed_and_a_fault_of_the_machine_is_none_of_the_robots(code: str) -> None:
    crashed = sabotaged(1, verdict=None, failure_code=code)
    assert told([control(1), crashed]) == ("broke the only job by a crash; no requirement caught it")
    faults = [control(1), sabotaged(1, verdict=None, failure_code="InternalServiceError", reason="out of memory")]
    assert told(faults) == "was not tried: out of memory"
    assert table_of(ASKED, faults).is_broken
    assert not table_of(ASKED, [*faults, sabotaged(1, BLIND, verdict="FAIL")]).is_passed
    assert told([control(1), sabotaged(1, verdict="ERROR")]) == (
        "broke the only job by an error; no requirement caught it"
    )


def test_a_crash_alone_does_not_show_that_requirements_are_good() -> None:
    """An application may crash at a value that it cannot read, before anything is judged."""
    crash = {"verdict": None, "failure_code": "RobotApplicationCrash"}
    table = table_of(ASKED, [control(1), *(sabotaged(1, name, **crash) for name in (LATE, BLIND))])
    assert table.headline == "2 of 2 sabotages caught, 2 of them only by what broke"
    assert not table.is_passed
    assert not table.is_broken

    caught = sabotaged(1, BLIND, verdict="FAIL", requirements=[missed("gentle", 3.0)])
    table = table_of(ASKED, [control(1), sabotaged(1, **crash), caught])
    assert table.headline == "2 of 2 sabotages caught, 1 of them only by what broke"
    assert table.is_passed


def test_a_requirement_is_named_before_a_crash() -> None:
    crash = sabotaged(1, verdict=None, failure_code="RobotApplicationCrash")
    at_the_end = sabotaged(2, verdict="FAIL", requirements=[missed("rooms", None)])
    arms = [control(1), control(2), control(3), crash, at_the_end, sabotaged(3)]
    assert told(arms) == "caught by 2 of 3 jobs, first by rooms, broke 1 of them, missed by 1"
    too_late = sabotaged(1, verdict="FAIL", failure_code="RobotApplicationCrash", requirements=[missed("gentle", 3.0)])
    assert told([control(1), too_late]) == "caught by the only job, first by gentle at 3.0 s"
    assert told([control(1), control(2), crash, sabotaged(2)]) == (
        "broke 1 of 2 jobs by a crash, missed by 1; no requirement caught it"
    )


def test_where_nothing_was_run_it_is_said() -> None:
    said = "No job was run with the real robot, so that nothing shows whether sabotages would be noticed"
    assert table_of(ASKED, []).headline == said
    not_run = control(1, verdict=None, failure_code="InternalServiceError")
    assert table_of(ASKED, [not_run, sabotaged(1)]).headline == said
    assert "No job passes with the real robot" in table_of(ASKED, [not_run, control(2, verdict="FAIL")]).headline


def test_a_job_that_was_never_made_is_not_tried() -> None:
    assert told([control(1)]) == "was not tried: its jobs did not end"
    assert table_of(ASKED, [control(1)]).is_broken
    assert table_of(ASKED, [sabotaged(1), sabotaged(1, BLIND)]).jobs[0].control == "was not run"


arms = st.builds(
    Arm,
    job=st.integers(1, 4),
    name=st.just("job"),
    sabotage=st.sampled_from([None, LATE, BLIND]),
    verdict=st.sampled_from(["PASS", "FAIL", "ERROR", "NONE", None]),
    requirements=st.lists(st.just(missed("gentle", 1.0)), max_size=1),
    failure_code=st.sampled_from([None, "RobotApplicationCrash", "InternalServiceError"]),
    not_applicable=st.sampled_from(["", "", "no lidar"]),
    state_digest=st.sampled_from([None, "a", "b"]),
)


@given(st.lists(arms, max_size=12, unique_by=lambda arm: (arm.job, arm.sabotage)))
def test_every_passing_job_counts_once_for_each_sabotage(found: list[Arm]) -> None:
    table = table_of(ASKED, found)
    for each in table.sabotages:
        total = each.caught + each.missed + each.no_effect + each.not_applicable + each.not_tried
        assert total == table.showing
        assert bool(each.first) == (each.caught > 0)
        assert each.broke <= each.caught
        assert each.is_only_broken == (each.first in ("a crash", "an error"))
        assert each.in_words
    assert table.headline
    assert not (table.is_passed and not table.showing)
    assert table == table_of(ASKED, found[::-1]), "the order of jobs does not matter"
