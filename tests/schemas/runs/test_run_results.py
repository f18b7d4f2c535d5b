"""Properties of results of runs."""

from typing import Any

import pytest

from prefect_robomaker.schemas.runs.plan import Requirement, RunResult


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
