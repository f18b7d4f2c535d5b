"""Properties of results of runs."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import pytest

from prefect_robomaker.schemas.runs.plan import Collision, Requirement, RunResult


@pytest.mark.parametrize(
    ("extra", "runs_free"),
    [
        ({}, False),
        ({"agent": {"mode": "lockstep"}}, False),
        ({"agent": {"mode": "free"}}, True),
        ({"ros": {"time": "paced"}}, True),
        ({"ros": {"time": "free"}}, True),
        ({"ros": {"time": "lockstep", "unanswered": 0}}, False),
        ({"ros": {"time": "lockstep", "unanswered": 1}}, True),
        ({"ros": "of the application's own", "agent": 7}, False),
    ],
)
def test_a_run_whose_time_waited_for_no_robot_may_end_otherwise_the_next_time(
    extra: dict[str, Any], runs_free: bool
) -> None:
    result = RunResult(
        verdict="PASS", sim_time_s=1, wall_time_s=1, real_time_factor=1, ended_by="environment", seed=1, extra=extra
    )  # fmt: skip
    assert result.runs_free is runs_free


def reason(ended_by: str, *missed: Requirement, touched: Mapping[str, float] = MappingProxyType({})) -> str | None:
    collisions = [
        Collision(time_s=1, duration_s=1, x=0, y=0, other=other, max_force_N=force) for other, force in touched.items()
    ]
    return RunResult(
        verdict="FAIL", sim_time_s=1, wall_time_s=1, real_time_factor=1, ended_by=ended_by, seed=1,
        requirements=list(missed), collisions=collisions,
    ).reason  # fmt: skip


def test_the_reason_begins_with_what_was_missed_first() -> None:
    asked = [
        Requirement(name="to-office", kind="goal", satisfied=False, detail="not reached"),
        Requirement(name="polite", kind="clearance", satisfied=False, detail="too near", first_violation_s=3.5),
        Requirement(name="gentle", kind="no_collision", satisfied=False, detail="30 N", first_violation_s=2.5),
    ]
    assert reason("agent", *asked) == "gentle: 30 N; polite: too near; to-office: not reached"


def test_the_reason_leaves_out_what_follows_from_the_jobs_own_requirements() -> None:
    """All rooms cannot have been visited when another requirement ended the run, and one contact is told once."""
    rooms = Requirement(name="rooms_visited", satisfied=False, detail="not visited: bedroom")
    hard = Requirement(name="no_hard_collision", satisfied=False, detail="hardest touch 30 N")
    gentle = Requirement(
        name="gentle", kind="no_collision", satisfied=False, detail="30 N", first_violation_s=2.5, other="wall",
        value=29.998, unit="N",
    )  # fmt: skip
    polite = Requirement(name="polite", kind="clearance", satisfied=False, detail="too near")
    touched = {"chair": 5.0, "wall": 30.0}
    assert reason("requirements", rooms, hard, gentle, touched=touched) == "gentle: 30 N"
    assert reason("agent", rooms, hard, gentle, touched=touched) == "gentle: 30 N; rooms_visited: not visited: bedroom"
    assert reason("requirements", rooms, hard, polite) == "polite: too near; no_hard_collision: hardest touch 30 N"
    assert reason("requirements", rooms) == "rooms_visited: not visited: bedroom", "nothing else tells why"


def test_the_reason_tells_of_a_harder_collision_that_the_jobs_own_requirement_leaves_out() -> None:
    """A requirement about chairs says nothing of a wall; one about all things does, whatever was touched first."""
    hard = Requirement(name="no_hard_collision", satisfied=False, detail="hardest touch 900 N")
    chairs = Requirement(
        name="chairs", kind="no_collision", satisfied=False, detail="30 N", other="chair", value=30.0, unit="N"
    )
    touched = {"chair": 30.0, "wall": 900.0}
    assert reason("agent", hard, chairs, touched=touched) == "chairs: 30 N; no_hard_collision: hardest touch 900 N"
    everything = chairs.model_copy(update={"detail": "900 N", "value": 900.0})
    assert reason("agent", hard, everything, touched=touched) == "chairs: 900 N"
    few = chairs.model_copy(update={"detail": "2 harder", "value": 2.0, "unit": "collisions"})
    assert reason("agent", hard, few, touched={"chair": 900.0}) == "chairs: 2 harder"
    assert reason("agent", hard, few, touched={"wall": 1.0, "chair": 0.5}) != "chairs: 2 harder", "2 is no force"


def test_the_reason_begins_with_what_the_job_asks_for_itself() -> None:
    """Its environment asks the same of all jobs; a rule that broke comes before both."""
    asked = [
        Requirement(name="own", satisfied=False, detail="of the environment"),
        Requirement(name="polite", kind="clearance", satisfied=False, detail="of the job"),
        Requirement(name="lost", kind="topic", satisfied=False, detail="no topic", error="no topic"),
    ]
    result = RunResult(
        verdict="FAIL", sim_time_s=1, wall_time_s=1, real_time_factor=1, ended_by="environment", seed=1,
        requirements=asked,
    )  # fmt: skip
    assert result.reason == "lost: no topic; polite: of the job; own: of the environment"
