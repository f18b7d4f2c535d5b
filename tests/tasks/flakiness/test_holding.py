"""Surroundings of the processes of a rerun, and the factors that count as held."""

import os
from pathlib import Path

import pytest

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan
from prefect_robomaker.schemas.runs.programs import BoxPlan, ProgramPlan
from prefect_robomaker.tasks.flakiness.causes import UNUSED, UNWATCHED, Hold
from prefect_robomaker.tasks.flakiness.holding import Marks, held_request, programs_of, weights_of
from prefect_robomaker.tasks.runtime.process.run_request import RunRequest


@pytest.fixture
def marks(tmp_path: Path) -> Marks:
    return Marks(tmp_path / "held")


@pytest.fixture
def request_of_run(tmp_path: Path) -> RunRequest:
    program = ProgramPlan(name="robot", role="robot", kind="application", argv=["python3", "a.py"], folder=tmp_path)
    robot = ApplicationPlan(role="robot", name="driver", environment_variables={"PYTHONPATH": "/own"})
    simulation = ApplicationPlan(role="simulation", name="s", attribute="s.make")
    plan = RunPlan(
        job_id="sim-1", job_arn="arn", run_id="run-1", seed=1, max_duration_s=9, work_dir=tmp_path, output_dir=tmp_path,
        robot_application=robot, simulation_application=simulation,
        programs=[program],
    )  # fmt: skip
    return RunRequest(plan=plan, environment={}, import_path=[])


def test_only_what_is_held_is_changed(request_of_run: RunRequest, marks: Marks) -> None:
    made = held_request(request_of_run, Hold(frozenset({"threads", "network"})), marks)
    assert (made.box.level, made.box.network) == ("box", "none")
    assert made.cores == [min(os.sched_getaffinity(0))]
    [program] = made.plan.programs
    assert program.environment["PYTHONPATH"] == f"{marks.folder}:/own"
    assert program.environment["ROBOMAKER_HELD"] == made.environment["ROBOMAKER_HELD"] == "threads"

    untouched = held_request(request_of_run, Hold(frozenset()), marks)
    assert (untouched.box, untouched.cores) == (request_of_run.box, None)
    assert untouched.environment["ROBOMAKER_HELD"] == ""

    at_one = Hold(frozenset({"seed", "time"}), frozenset({("time", 1)}))
    assert held_request(request_of_run, at_one, marks).environment["ROBOMAKER_HELD"] == "seed,time:1"


def test_what_a_program_does_not_say_to_hold_is_not_held(request_of_run: RunRequest, marks: Marks) -> None:
    """A program in C holds no clock: that it went on flipping would wrongly rule the clock out."""
    programs, asked = programs_of(request_of_run), frozenset(("seed", "time", "network"))
    marks.path("the simulation").write_text("held seed,time\nused time\n")
    assert marks.held(asked, programs) == {"network"}
    assert not marks.are_watched(programs)
    marks.path("robot").write_text("held seed,time\nused seed\nheld seed\n")  # a second process of it
    assert marks.held(asked, programs) == {"seed", "network"}
    assert marks.used() == {"seed", "time"}


def test_only_what_can_be_held_here_is_weighed() -> None:
    boxed = weights_of({"time"}, is_watched=True, box=BoxPlan(level="box"), can_box=True, has_neighbours=False)
    assert boxed == {"seed": UNUSED, "time": 1.0, "threads": UNUSED, "hash": UNWATCHED, "network": UNUSED}
    bare = weights_of(set(), is_watched=False, box=BoxPlan(), can_box=False, has_neighbours=True)
    assert bare == {"seed": 1.0, "time": 1.0, "threads": 1.0, "hash": 1.0, "order": 1.0}
