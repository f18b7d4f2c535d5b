"""The example programs, packed as their README says, in jobs as users order them."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.paths import REPOSITORY
from helpers.required_programs import needs

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan, RunResult
from prefect_robomaker.schemas.runs.programs import ProgramPlan
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.storage import unpack

EXAMPLES = REPOSITORY / "deployments" / "specs" / "examples"
EXAMPLE = EXAMPLES / "agent_process"
CARTPOLE = EXAMPLES / "cartpole_bundle"
MakePlan = Callable[..., RunPlan]
pytestmark = needs("cc", shutil.which("cc"), "there is no C compiler here: cc is not in PATH")


@pytest.fixture
def unpacked(tmp_path: Path) -> Path:
    """The archive that the README's commands make."""
    source = shutil.copytree(EXAMPLE, tmp_path / "source", ignore=shutil.ignore_patterns("__pycache__"))
    (commands,) = re.findall(r"^```bash\n(.*?)^```$", (EXAMPLE / "README.md").read_text(), re.MULTILINE | re.DOTALL)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    subprocess.run(["bash", "-euc", commands], cwd=source, check=True, env={**os.environ, "PATH": path})
    unpack(source / "agent_process.tar.gz", tmp_path / "unpacked")
    return tmp_path / "unpacked"


@pytest.fixture
def plan_balancing(make_plan: MakePlan, unpacked: Path) -> MakePlan:
    def make(argv: list[str], **variables: str) -> RunPlan:
        return make_plan(
            simulation_application=ApplicationPlan(
                role="simulation", name="cartpole", attribute="my_cartpole.arena.make_environment", path=CARTPOLE
            ),
            robot_application=ApplicationPlan(
                role="robot", name="balancer", path=unpacked, environment_variables=variables
            ),
            programs=[ProgramPlan(name="robot", role="robot", kind="application", argv=argv, folder=unpacked)],
        )

    return make


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        pytest.param(["python3", "robot.py"], "driving run run-1\n", marks=pytest.mark.deep),
        (["./robot"], 'the run is over: {"ended_by":"environment"}\n'),
    ],
)
def test_the_pole_stays_up(launcher: Launcher, plan_balancing: MakePlan, argv: list[str], said: str) -> None:
    plan = plan_balancing(argv)
    outcome = launcher.run(plan, lambda: None)
    assert outcome.status == "Completed", outcome.failure_reason
    result = RunResult.model_validate_json((plan.output_dir / "result.json").read_bytes())
    assert (result.verdict, result.ended_by, result.sim_time_s) == ("PASS", "environment", pytest.approx(10.0))
    assert result.extra["agent"]["actions"] == 500
    assert (plan.output_dir / "logs" / "robot.stdout.log").read_text() == said


@pytest.mark.deep
def test_without_gain_it_falls(launcher: Launcher, plan_balancing: MakePlan) -> None:
    plan = plan_balancing(["python3", "robot.py"], GAIN="0")
    outcome = launcher.run(plan, lambda: None)
    assert outcome.status == "Completed", outcome.failure_reason
    result = RunResult.model_validate_json((plan.output_dir / "result.json").read_bytes())
    assert (result.verdict, result.ended_by) == ("FAIL", "environment")


@pytest.mark.parametrize("argv", [["python3", "robot.py"], pytest.param(["./robot"], marks=pytest.mark.deep)])
def test_another_environment_is_no_riddle(
    launcher: Launcher, plan_balancing: MakePlan, argv: list[str], make_plan: MakePlan
) -> None:
    counting = make_plan().simulation_application
    plan = plan_balancing(argv).model_copy(update={"simulation_application": counting})
    outcome = launcher.run(plan, lambda: None)
    assert (outcome.status, outcome.failure_code) == ("Failed", "RobotApplicationCrash")
    assert "balancer" in (outcome.failure_reason or "")
