"""Marked moments of a run, from its result."""

from prefect_robomaker.deployments.console.timelines.run_marks import first_violation, marks_of
from prefect_robomaker.schemas.runs.plan import Collision, Requirement, RoomVisit, RunResult


def test_marks_say_what_happened_in_order() -> None:
    result = RunResult(
        verdict="FAIL", sim_time_s=20, wall_time_s=1, real_time_factor=20, ended_by="environment", seed=1,
        rooms=[RoomVisit(name="Hall", visited=True, first_visit_s=3), RoomVisit(name="Bath", visited=False)],
        collisions=[Collision(time_s=2, duration_s=0.1, x=0, y=0, other="chair_3", max_force_N=12.34)],
        requirements=[
            Requirement(name="to-hall", kind="goal", satisfied=True, detail="", value=3.5, unit="s"),
            Requirement(name="near", kind="goal", satisfied=False, detail="", value=2, unit="m", first_violation_s=20),
            Requirement(
                name="soft", satisfied=False, detail="", first_violation_s=2.0, room="Hall", other="chair_3"
            ),
            Requirement(name="aside", satisfied=False, counts=False, detail="", first_violation_s=1),
            Requirement(name="odd", satisfied=False, error="cannot", detail="", first_violation_s=1),
        ],
    )  # fmt: skip
    marks = marks_of(result)
    assert [(mark.time_s, mark.kind, mark.text) for mark in marks] == [
        (2, "contact", "robot touches chair_3, 12.3 N"),
        (2, "violation", "misses soft in Hall at chair_3"),
        (3, "room", "first in Hall"),
        (3.5, "goal", "reaches to-hall"),
        (20, "violation", "misses near"),
    ]
    assert first_violation(marks) == marks[1]
    assert first_violation(marks[2:4]) is None
