"""Tools beside the applications of real runs."""

import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.run_processes import never, processes_with

from prefect_robomaker.schemas.runs.plan import RunPlan, RunResult
from prefect_robomaker.schemas.runs.programs import ProgramPlan, ToolEnds
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.runtime.supervision.programs import FIRST_PAUSE_S, MAX_PAUSE_S, Program

Plan = Callable[..., RunPlan]
MakeProgram = Callable[..., ProgramPlan]
ProgramsPlan = Callable[..., RunPlan]


def until_end(number: int) -> str:
    """An application that ends once a tool has ended that often, in the pause before it is started again."""
    return f"""
import os, time
from pathlib import Path
log = Path(os.environ["ROBOMAKER_OUTPUT_DIR"], "logs", "robot-rviz.stderr.log")
while not log.exists() or log.read_text().count("it is started again in ") < {number}:
    time.sleep(0.02)
"""


@pytest.fixture
def tool(program: MakeProgram) -> MakeProgram:
    def make(command: str, **members) -> ProgramPlan:
        argv = ["/bin/bash", "-c", command]
        return program("", **({"name": "robot-rviz", "kind": "tool", "argv": argv} | members))

    return make


def result_of(plan: RunPlan) -> RunResult:
    return RunResult.model_validate_json((plan.output_dir / "result.json").read_bytes())


def log_of(plan: RunPlan, name: str) -> str:
    return (plan.output_dir / "logs" / name).read_text()


@pytest.mark.parametrize(
    ("command", "text"), [("exit 0", "exited with code 0"), ("kill -KILL $$", "was killed by SIGKILL")]
)
def test_a_tool_that_may_not_end_fails_the_job(
    launcher: Launcher, program: MakeProgram, tool: MakeProgram, plan_programs: ProgramsPlan, tmp_path: Path,
    command: str, text: str,
) -> None:  # fmt: skip
    plan = plan_programs(
        program("import time; time.sleep(1000)"), tool(f"echo tool here; {command}", exit_behavior="FAIL")
    )
    outcome = launcher.run(plan, never)
    assert (outcome.status, outcome.failure_code) == ("Failed", "RobotApplicationCrash")
    assert outcome.failure_reason == (
        f"Tool rviz of robot application driver {text}\nLast lines of logs/robot-rviz.stdout.log:\ntool here"
    )
    assert processes_with(str(tmp_path)) == []


def test_a_tool_is_started_again(
    launcher: Launcher, program: MakeProgram, tool: MakeProgram, plan_programs: ProgramsPlan
) -> None:
    plan = plan_programs(program(until_end(2)), tool("echo once more; sleep 1000 & exit 3", exit_behavior="RESTART"))
    assert launcher.run(plan, never).status == "Completed"
    assert log_of(plan, "robot-rviz.stdout.log") == "once more\n" * 2
    assert log_of(plan, "robot-rviz.stderr.log").splitlines() == [
        "robomaker: start 1 of this tool",
        "robomaker: it exited with code 3; it is started again in 0.5 s",
        "robomaker: start 2 of this tool",
        "robomaker: it exited with code 3; it is started again in 1 s",
    ]


class TestRestartsAreTold:
    """Not only in the tool's own log."""

    DYING = "exit 1"

    def test_in_the_result_and_in_the_runs_log(
        self, launcher: Launcher, program: MakeProgram, tool: MakeProgram, plan_programs: ProgramsPlan
    ) -> None:
        plan = plan_programs(
            program(until_end(3)),
            tool(self.DYING, exit_behavior="RESTART"),
            tool("sleep 1000", name="robot-quiet", exit_behavior="RESTART"),
        )
        assert launcher.run(plan, never).status == "Completed"
        assert result_of(plan).tools == [ToolEnds(role="robot", name="rviz", ends=3, last_end="exited with code 1")]
        assert result_of(plan).remarks == [
            "Tool rviz of robot application driver ended 3 times, and last exited with code 1; it was started again "
            "each time"
        ]
        assert log_of(plan, "stderr.log") == (
            "robomaker: Tool rviz of robot application driver ended 3 times, and last exited with code 1\n"
        )

    def test_beside_an_episode(self, launcher: Launcher, tool: MakeProgram, make_plan: Plan) -> None:
        view = tool(self.DYING, name="simulation-view", role="simulation", exit_behavior="RESTART")
        plan = make_plan(programs=[view], variables={"STEPS": "60", "WAIT_S": "0.05"})
        assert launcher.run(plan, never).status == "Completed"
        [told] = result_of(plan).tools
        assert (told.role, told.name, told.last_end) == ("simulation", "view", "exited with code 1")
        assert result_of(plan).ended_by == "environment"

    def test_in_a_result_that_an_application_wrote(
        self, launcher: Launcher, program: MakeProgram, tool: MakeProgram, plan_programs: ProgramsPlan
    ) -> None:
        result = RunResult(
            verdict="PASS", sim_time_s=1, wall_time_s=1, real_time_factor=1, ended_by="application", seed=1
        )
        code = until_end(1)
        code += f"Path(os.environ['ROBOMAKER_OUTPUT_DIR'], 'result.json').write_text({result.model_dump_json()!r})"
        plan = plan_programs(program(code), tool(self.DYING, exit_behavior="RESTART"))
        assert launcher.run(plan, never).status == "Completed"
        assert (result_of(plan).verdict, result_of(plan).tools[0].name) == ("PASS", "rviz")

    @pytest.mark.deep
    def test_in_the_reason_of_a_failure(
        self, launcher: Launcher, program: MakeProgram, tool: MakeProgram, plan_programs: ProgramsPlan
    ) -> None:
        plan = plan_programs(program(until_end(3) + "raise SystemExit(4)"), tool(self.DYING, exit_behavior="RESTART"))
        assert launcher.run(plan, never).failure_reason == (
            "Robot application driver (program robot) exited with code 4. "
            "Tool rviz of robot application driver ended 3 times, and last exited with code 1"
        )


def test_a_tool_that_is_not_there_is_tried_again(
    launcher: Launcher, program: MakeProgram, tool: MakeProgram, plan_programs: ProgramsPlan
) -> None:
    plan = plan_programs(program(until_end(2)), tool("", argv=["no-such-tool"], exit_behavior="RESTART"))
    assert launcher.run(plan, never).status == "Completed"
    log = log_of(plan, "robot-rviz.stderr.log")
    assert log.count("it could not be started: program not found: no-such-tool") == 2


def test_the_pause_grows_and_is_forgotten(tmp_path: Path, tool: MakeProgram) -> None:
    now = [0.0]
    (tmp_path / "logs").mkdir()
    running = Program(tool("exit", exit_behavior="RESTART"), {"PATH": "/bin"}, tmp_path, lambda: None, lambda: now[0])
    pauses = []
    for _ in range(9):
        running.start()
        running.clear_away()
        pauses.append(running.pause("ended"))
    assert pauses == [0.5, 1.0, 2.0, 4.0, 8.0, 16.0, MAX_PAUSE_S, MAX_PAUSE_S, MAX_PAUSE_S]
    running.start()
    now[0] += 60.0
    running.clear_away()
    assert running.pause("ended") == FIRST_PAUSE_S


def test_killed_from_outside(
    launcher: Launcher, program: MakeProgram, tool: MakeProgram, plan_programs: ProgramsPlan
) -> None:
    """Killing a tool that is started again does nothing to the job."""
    code = "import os, signal, time\nwhile not os.path.exists('pid'): time.sleep(.02)\n"
    code += f"os.kill(int(open('pid').read()), signal.SIGKILL)\n{until_end(1)}"
    plan = plan_programs(program(code), tool("echo $$ > new; mv new pid; sleep 1000", exit_behavior="RESTART"))
    assert launcher.run(plan, never).status == "Completed"
    assert f"it was killed by {signal.SIGKILL.name}; " in log_of(plan, "robot-rviz.stderr.log")


def test_the_longest_name_a_tool_may_have(
    launcher: Launcher, program: MakeProgram, tool: MakeProgram, plan_programs: ProgramsPlan
) -> None:
    plan = plan_programs(
        program("import os, time\nwhile not os.path.exists('said'): time.sleep(.02)"),
        tool("echo hello; touch said; sleep 1000", name="simulation-" + "x" * 255),
    )
    assert launcher.run(plan, never).status == "Completed"
    assert [path.read_text() for path in plan.output_dir.glob("logs/simulation-xxx*.stdout.log")] == ["hello\n"]
