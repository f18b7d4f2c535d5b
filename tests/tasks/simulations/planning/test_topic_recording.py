"""Plans of runs have a recorder of ROS topics where they should, with the right words on its command line."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan
from prefect_robomaker.schemas.runs.programs import ComputeLimits, ProgramPlan
from prefect_robomaker.schemas.runs.ros_options import RosOptions, RosPlan
from prefect_robomaker.tasks.runtime.ros.topic_report import RecorderRequest
from prefect_robomaker.tasks.simulations.planning.topic_recording import with_topic_recorder

ARENA = ApplicationPlan(role="simulation", name="arena", attribute="arena.make_environment")
Planned = Callable[..., RunPlan]


@pytest.fixture
def planned(tmp_path: Path) -> Planned:
    """Plans a run with one program; members replace those of the plan."""

    def plan(**members: Any) -> RunPlan:
        program = ProgramPlan(name="robot", role="robot", kind="application", argv=["x"], folder=tmp_path)
        usual: dict[str, Any] = {"programs": [program], "robot_application": ApplicationPlan(role="robot", name="r")}
        return RunPlan(
            job_id="sim-1", job_arn="arn:x", run_id="run-1", seed=1, max_duration_s=1, work_dir=tmp_path / "work",
            output_dir=tmp_path, **{**usual, **members},
        )  # fmt: skip

    return plan


def request_in(plan: RunPlan) -> RecorderRequest:
    return RecorderRequest.model_validate_json(plan.programs[-1].argv[-1])


def test_the_recorder_is_ours_and_is_started_again_when_it_dies(planned: Planned, tmp_path: Path) -> None:
    recorder = with_topic_recorder(planned(), None, {"PYTHONPATH": "/ours"}, 10**9).programs[-1]

    assert recorder.argv[0] == sys.executable
    assert (recorder.name, recorder.kind, recorder.exit_behavior) == ("robot.ros-topics", "tool", "RESTART")
    assert recorder.environment == {"PYTHONPATH": "/ours", "PYTHONHOME": "", "LD_LIBRARY_PATH": "", "LD_PRELOAD": ""}
    assert recorder.folder == tmp_path / "work"


@pytest.mark.parametrize(
    ("members", "times"),
    [
        ({}, "sent"),
        ({"simulation_application": ARENA}, "elapsed"),
        ({"simulation_application": ARENA, "ros": RosPlan(suite=2, domain=7)}, "clock"),
    ],
)
def test_log_times_are_those_of_the_simulation_where_it_tells_them(
    members: dict[str, Any], times: str, planned: Planned
) -> None:
    assert request_in(with_topic_recorder(planned(**members), 2, {}, 10**9)).times == times


def test_it_takes_no_more_than_a_part_of_the_jobs_disk_and_finds_the_same_nodes(planned: Planned) -> None:
    options = RosOptions(peers=["192.0.2.7"], interface="eth0")
    plan = planned(compute=ComputeLimits(disk_bytes=8000), ros=RosPlan(suite=2, domain=7, options=options))
    with_recorder = with_topic_recorder(plan, None, {}, 10**9)
    request = request_in(with_recorder)
    assert with_recorder.programs[-1].environment["ROS_DOMAIN_ID"] == "7"
    assert (request.max_bytes, request.peers, request.interface) == (1000, ["192.0.2.7"], "eth0")
    assert request_in(with_topic_recorder(plan, None, {}, 900)).max_bytes == 900
    assert request.packages == [plan.programs[0].folder, Path("/opt/ros")]


def test_runs_without_programs_and_launches_of_ros_1_have_none(planned: Planned) -> None:
    for plan, launched_by in ((planned(programs=[]), None), (planned(), 1)):
        assert with_topic_recorder(plan, launched_by, {}, 10**9) == plan


@pytest.mark.parametrize("of_ros_1", [True, False])
def test_a_log_says_why_nothing_is_recorded(
    of_ros_1: bool, planned: Planned, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not of_ros_1:
        monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    plan = planned(ros=RosPlan(suite=1, domain=7) if of_ros_1 else None)

    assert with_topic_recorder(plan, None, {}, 10**9) == plan
    why = "of ROS 1 they are recorded where a launch file" if of_ros_1 else "cyclonedds is not installed"
    assert why in (tmp_path / "logs" / "ros-topics.log").read_text()
