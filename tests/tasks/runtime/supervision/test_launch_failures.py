"""Lines of `roslaunch` and `ros2 launch` when a launch fails, as they print them."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.run_processes import never

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan
from prefect_robomaker.schemas.runs.programs import ProgramPlan
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.runtime.supervision.programs import LaunchWatch

DRIVER = ApplicationPlan(role="robot", name="driver")
CANNOT = (
    "cannot launch node of type [demo/gone.py]: Cannot locate node of type [gone.py] in package [demo]. Make sure file "
    "exists in package path and permission is set to executable (chmod +x)"
)
NO_PACKAGE = (
    "Caught exception in launch (see debug for traceback): \"package 'nopkg' not found, searching: ['/opt/ros/jazzy']\""
)
NO_EXECUTABLE = (
    "Caught exception in launch (see debug for traceback): executable 'gone' not found on the libexec directory "
    "'/opt/ros/jazzy/lib/demo'"
)
REQUIRED_1 = "\x1b[31m" + "=" * 80 + "REQUIRED process [a-3] has died!\n"
DIED_1 = "process has died [pid 7, exit code 3, cmd /src/demo/scripts/die.py __name:=a]."
DIED_2 = "process has died [pid 7, exit code 3, cmd '/opt/demo/die --ros-args']."
REQUIRED_2 = "[INFO] [launch]: process[die-1] was required: shutting down launched system\n"
TRACEBACK = 'Traceback (most recent call last):\n  File "execute_local.py", line 9, in run\n    start()\n'


@pytest.mark.parametrize(
    ("printed", "said"),
    [
        (f"\x1b[31mERROR: {CANNOT}\x1b[0m\n", CANNOT),
        (f"{REQUIRED_1}{DIED_1}\nlog file: a-3*.log\n", f"REQUIRED process [a-3] has died! {DIED_1}"),
        (f"{REQUIRED_1}process has finished cleanly\n", None),
        (f"[ERROR] [launch]: {NO_PACKAGE}\n", NO_PACKAGE),
        (f"1700000000.123 [ERROR] [launch]: {NO_EXECUTABLE}\n", NO_EXECUTABLE),
        (f"[ERROR] [die-1]: {DIED_2}\n{REQUIRED_2}", f"required node die-1: {DIED_2}"),
        (f"[ERROR] [die-1]: {DIED_2}\n", None),
        (f"[ERROR] [other-2]: {DIED_2}\n[INFO] [die-1]: process has finished cleanly [pid 7]\n{REQUIRED_2}", None),
        (
            f"[ERROR] [a-1]: exception occurred while executing process:\n{TRACEBACK}FileNotFoundError: [Errno 2]\n",
            "a-1 cannot be executed: FileNotFoundError: [Errno 2]",
        ),
        (f"[talker-1] ERROR: {CANNOT}\n[talker-1] [ERROR] [launch]: {NO_PACKAGE}\n", None),
        (f"the log has: ERROR: {CANNOT}\n", None),
    ],
)
@pytest.mark.parametrize("piece", [1, 4096])
def test_what_a_launch_says(tmp_path: Path, printed: str, said: str | None, piece: int) -> None:
    descriptor = os.open(tmp_path / "log", os.O_RDWR | os.O_CREAT | os.O_APPEND)
    watch, found = LaunchWatch(descriptor), []
    content = printed.encode()
    for start in range(0, len(content), piece):
        os.write(descriptor, content[start : start + piece])
        found += [line for line in [watch.look()] if line]
    os.close(descriptor)
    assert found == ([said] if said else [])


def test_what_was_there_before_and_logs_that_are_cut_say_nothing(tmp_path: Path) -> None:
    descriptor = os.open(tmp_path / "log", os.O_RDWR | os.O_CREAT | os.O_APPEND)
    os.write(descriptor, f"ERROR: {CANNOT}\n".encode())
    watch = LaunchWatch(descriptor)
    assert watch.look() is None
    os.ftruncate(descriptor, 3)
    assert watch.look() is None
    os.write(descriptor, f"\nERROR: {CANNOT}\n".encode())
    assert watch.look() == CANNOT
    os.close(descriptor)


@pytest.mark.parametrize("role", ["robot", "simulation"])
@pytest.mark.parametrize("goes_on", [True, False], ids=["goes on", "ends with 0"])
def test_a_program_that_could_not_launch_its_nodes_crashed(
    launcher: Launcher,
    program: Callable[..., ProgramPlan],
    plan_programs: Callable[..., RunPlan],
    role: str,
    goes_on: bool,
) -> None:
    code = f"import sys, time; print('ERROR: {CANNOT}', file=sys.stderr, flush=True); time.sleep({9999 * goes_on})"
    other = "simulation" if role == "robot" else "robot"
    plan = plan_programs(
        program(code, name=role, role=role), program("import time; time.sleep(9999)", name=other, role=other)
    )

    outcome = launcher.run(plan, never)

    assert (outcome.status, outcome.failure_code) == ("Failed", f"{role.capitalize()}ApplicationCrash")
    assert f"(program {role}) failed in its launch: {CANNOT}" in (outcome.failure_reason or "")


def test_a_robot_that_could_not_be_launched_fails_before_it_would_have_had_to_connect(
    launcher: Launcher, program: Callable[..., ProgramPlan], make_plan: Callable[..., RunPlan]
) -> None:
    code = f"import sys, time; print('ERROR: {CANNOT}', file=sys.stderr, flush=True); time.sleep(9999)"

    outcome = launcher.run(make_plan(programs=[program(code)], robot_application=DRIVER), never)

    assert (outcome.status, outcome.failure_code) == ("Failed", "RobotApplicationCrash")
    assert f"failed in its launch: {CANNOT}" in (outcome.failure_reason or "")


def test_a_program_that_ends_well_without_connecting_is_unhealthy_as_before(
    launcher: Launcher, program: Callable[..., ProgramPlan], make_plan: Callable[..., RunPlan]
) -> None:
    outcome = launcher.run(make_plan(programs=[program("print('all done')")], robot_application=DRIVER), never)

    assert (outcome.status, outcome.failure_code) == ("Failed", "RobotApplicationHealthCheckFailure")


def test_a_tool_may_print_what_it_likes(
    launcher: Launcher, program: Callable[..., ProgramPlan], plan_programs: Callable[..., RunPlan]
) -> None:
    tool = program(f"print('ERROR: {CANNOT}', flush=True); input()", name="robot-watch", kind="tool",
                   exit_behavior="RESTART")  # fmt: skip

    assert launcher.run(plan_programs(program("import time; time.sleep(0.5)"), tool), never).status == "Completed"
