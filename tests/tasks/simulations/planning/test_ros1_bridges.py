"""Jobs whose robots speak ROS 1 start a bridge beside them; real ones drive in `tests/journeys/test_ros1_robots.py`."""

import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from prefect_robomaker.schemas.runs.programs import ProgramPlan
from prefect_robomaker.tasks.bundles.launch_files import Ros
from prefect_robomaker.tasks.runtime.ros.ros1_bridge import BRIDGE
from prefect_robomaker.tasks.simulations.environment.folders import TEMPORARY, Sandbox
from prefect_robomaker.tasks.simulations.environment.run_environment import RunEnvironment
from prefect_robomaker.tasks.simulations.planning.application_plans import Applications, RosLaunch, with_ros1_bridge
from prefect_robomaker.tasks.simulations.planning.launch_configurations import Code, Program

Plan = Callable[..., list[ProgramPlan]]


@pytest.fixture
def plan(tmp_path: Path) -> Plan:
    """Plans the programs of a run whose robot is a program, in a ROS whose Python has rospy or not."""
    launcher = tmp_path / "ros" / "bin" / "roslaunch"
    launcher.parent.mkdir(parents=True)
    sandbox = Sandbox(tmp_path / "root")
    sandbox.place(TEMPORARY).mkdir(parents=True)

    def made(ros: Ros | None, argv: list[str], *, has_rospy: bool = True) -> list[ProgramPlan]:
        python = launcher.with_name("python3")
        module = tmp_path / "modules" / "rospy.py"
        module.parent.mkdir(exist_ok=True)
        if has_rospy:
            module.touch()
        python.write_text(f'#!/bin/sh\nexport PYTHONPATH="{module.parent}"\nexec "{sys.executable}" "$@"\n')
        python.chmod(0o755)
        program = ProgramPlan(name="robot", role="robot", kind="application", argv=argv, folder=tmp_path)
        launch = Program(tuple(argv), launcher if ros else None, ros)
        which = {"roslaunch": str(launcher)}.get
        run = SimpleNamespace(output_dir=tmp_path)
        environment = SimpleNamespace(sandbox=sandbox, which=which, environ={"PATH": "/usr/bin:/bin"}, plan=run)
        planned = Applications(programs=[program], robot=RosLaunch(Code("robot", "mine"), launch, program))
        return with_ros1_bridge(planned, cast("RunEnvironment", environment))

    return made


@pytest.mark.parametrize(
    ("own", "launched"),
    [(["/b/my.launch"], ["{ours}", "/b/my.launch"]), (["pkg", "my.launch"], ["pkg", "my.launch", "{ours}"])],
)
def test_a_launch_has_a_bridge_and_takes_the_time_of_the_simulation(
    plan: Plan, tmp_path: Path, own: list[str], launched: list[str]
) -> None:
    robot, bridge = plan(1, ["roslaunch", *own])

    ours = tmp_path / "root" / TEMPORARY.lstrip("/") / "use_sim_time.launch"
    assert robot.argv == ["roslaunch", *(each.format(ours=ours) for each in launched)]
    assert "use_sim_time" in ours.read_text()
    assert (bridge.name, bridge.kind, bridge.exit_behavior) == ("robot.ros-bridge", "tool", "RESTART")
    assert bridge.argv[-2:] == ["python3", str(BRIDGE)]
    assert bridge.environment["PATH"].startswith(str(tmp_path / "ros" / "bin")), "ROS's own Python comes first"


def test_a_command_stays_as_it_is_and_has_a_bridge_too(plan: Plan) -> None:
    robot, bridge = plan(None, ["./start"])
    assert robot.argv == ["./start"]
    assert bridge.argv[-1] == str(BRIDGE)


def test_without_rospy_there_is_no_bridge_to_start_again_and_again(plan: Plan, tmp_path: Path) -> None:
    assert [program.argv for program in plan(None, ["./start"], has_rospy=False)] == [["./start"]]
