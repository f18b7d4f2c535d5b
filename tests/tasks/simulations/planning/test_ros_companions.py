"""What runs beside launches of ROS; the real one does in `tests/journeys/test_ros_jobs.py`."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from prefect_robomaker.schemas.runs.programs import ProgramPlan
from prefect_robomaker.tasks.bundles.launch_files import Ros
from prefect_robomaker.tasks.simulations.environment.folders import Sandbox
from prefect_robomaker.tasks.simulations.environment.run_environment import RunEnvironment
from prefect_robomaker.tasks.simulations.planning.application_plans import RosLaunch, with_ros_companions
from prefect_robomaker.tasks.simulations.planning.launch_configurations import Code, Program

Planned = Callable[..., list[ProgramPlan]]


@pytest.fixture
def program(tmp_path: Path) -> ProgramPlan:
    return ProgramPlan(name="robot", role="robot", kind="application", argv=["x"], folder=tmp_path)


@pytest.fixture
def planned(tmp_path: Path, program: ProgramPlan) -> Planned:
    """Plans the programs of a run whose one program is launched by a ROS, or by none."""
    (tmp_path / "output").mkdir()

    def plan(ros: Ros | None, installed: tuple[str, ...] = (), *, wants_topics: bool = True) -> list[ProgramPlan]:
        environment = SimpleNamespace(
            sandbox=Sandbox(tmp_path / "root"),
            plan=SimpleNamespace(output_dir=tmp_path / "output"),
            which=lambda name: f"/there/{name}" if name in installed else None,
        )
        launch = Program(("x",), Path("/there/launcher"), ros)
        launched = RosLaunch(Code("robot", "mine"), launch, program) if ros else None
        return with_ros_companions([program], launched, cast("RunEnvironment", environment), wants_topics=wants_topics)

    return plan


def test_topics_of_ros_1_are_recorded_by_rosbag(planned: Planned, tmp_path: Path) -> None:
    recorder = planned(1, ("rosbag",))[-1]

    assert recorder.argv == ["/there/rosbag", "record", "--all", "--output-name", f"{tmp_path}/output/ros-topics.bag"]
    assert (recorder.name, recorder.kind, recorder.exit_behavior) == ("robot.ros-topics", "tool", "RESTART")


def recorders(programs: list[ProgramPlan]) -> list[str]:
    return [program.name for program in programs if program.name.endswith("ros-topics")]


def test_a_log_says_that_rosbag_is_missing(planned: Planned, tmp_path: Path) -> None:
    assert recorders(planned(1)) == []
    said = (tmp_path / "output" / "logs" / "ros-topics.log").read_text()
    assert "rosbag is not installed where the job runs" in said


def test_nothing_is_recorded_unasked(planned: Planned, tmp_path: Path) -> None:
    assert recorders(planned(1, ("rosbag",), wants_topics=False)) == []
    assert list((tmp_path / "output").iterdir()) == []


def test_a_ros_without_rospy_has_no_services(
    planned: Planned, program: ProgramPlan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    python = tmp_path / "bin" / "python3"
    python.parent.mkdir()
    python.write_text("#!/bin/sh\nexit 1\n")
    python.chmod(0o755)
    monkeypatch.setenv("PATH", str(python.parent))
    monkeypatch.setattr("os.defpath", str(python.parent))

    assert planned(1, wants_topics=False) == [program]
    assert not (tmp_path / "root" / "opt" / "robomaker" / "ros").exists()
