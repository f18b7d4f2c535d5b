"""Runs that are stopped at their duration limit while somebody does not answer: they are never without a verdict."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.paths import BUNDLES
from helpers.run_processes import limit_reached, never

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunPlan, RunResult
from prefect_robomaker.schemas.runs.programs import ApplicationRole, ProgramPlan
from prefect_robomaker.schemas.runs.requirements import parse_requirements
from prefect_robomaker.schemas.runs.trials import Trials
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher

YARD = BUNDLES / "yard"
CRATE = [{"kind": "clearance", "name": "polite", "min_m": 0.01}]
PROGRAM = """
import os, pathlib, time
from prefect_robomaker.tasks.runtime.agents.agent_client import connect
with connect() as simulation:
    for step in simulation:
        if step.step == 5:
            pathlib.Path("busy").touch()
            time.sleep({pause_s})
        simulation.act([0.0, 0.0])
"""

Plan = Callable[..., RunPlan]


@pytest.fixture
def plan_yard(make_plan: Plan) -> Plan:
    """Plans a run of the yard in which something hangs."""

    def plan(hang: str, environment: str = "make_environment", asked: Any = (), **members: Any) -> RunPlan:
        factories: dict[ApplicationRole, str] = {"simulation": f"yard.{environment}", "robot": "yard.make_agent"}
        applications: dict[str, Any] = {
            f"{role}_application": ApplicationPlan(
                role=role, name=role, attribute=factory, path=YARD, environment_variables={"HANG": hang}
            )
            for role, factory in factories.items()
        }
        return make_plan(**{**applications, "requirements": parse_requirements(list(asked), "asked"), **members})

    return plan


def result_of(plan: RunPlan) -> RunResult:
    return RunResult.model_validate_json((plan.output_dir / "result.json").read_bytes())


@pytest.mark.parametrize(
    ("hang", "words"),
    [
        ("act", "the robot application did not answer in step 37, at 0.72 s simulated"),
        ("act-in-python", "the robot application did not answer in step 37, at 0.72 s simulated"),
        ("step", "the simulation application did not answer in step 37, at 0.72 s simulated"),
        ("agent", "the robot application did not answer in making the agent"),
    ],
)
@pytest.mark.parametrize(("environment", "asked"), [("make_judging_environment", ()), ("make_environment", CRATE)])
def test_who_does_not_answer_is_said(
    launcher: Launcher, plan_yard: Plan, hang: str, words: str, environment: str, asked: Any
) -> None:
    plan = plan_yard(hang, environment, asked)
    outcome = launcher.run(plan, never, clock=limit_reached((plan.work_dir / "busy").exists))
    assert (outcome.status, outcome.timed_out, outcome.verdict) == ("Completed", True, "ERROR")
    assert outcome.finished, "its outputs get a manifest"
    result = result_of(plan)
    assert f"stopped at the duration limit: {words}" in (result.reason or "")
    assert result.ended_by == "duration limit"
    assert result.metrics["steps"] == (0 if hang == "agent" else 36)


def test_a_report_that_does_not_come(launcher: Launcher, plan_yard: Plan) -> None:
    plan = plan_yard("result", "make_judging_environment")
    outcome = launcher.run(plan, never, clock=limit_reached((plan.work_dir / "busy").exists))
    assert (outcome.verdict, outcome.finished) == ("ERROR", True)
    assert "the simulation application did not answer in environment.run_result()" in (outcome.verdict_reason or "")


def test_where_nothing_is_judged_it_is_a_note(launcher: Launcher, plan_yard: Plan) -> None:
    plan = plan_yard("act")
    outcome = launcher.run(plan, never, clock=limit_reached((plan.work_dir / "busy").exists))
    assert (outcome.status, outcome.verdict, outcome.finished) == ("Completed", "NONE", True)
    [note] = result_of(plan).remarks
    assert note.endswith("the robot application did not answer in step 37, at 0.72 s simulated")


@pytest.mark.parametrize(("pause_s", "verdict"), [(10_000, "ERROR"), (0.5, "PASS")], ids=["silent", "slow"])
def test_a_program_that_is_asked_at_the_limit_may_answer(
    launcher: Launcher, plan_yard: Plan, tmp_path: Path, pause_s: float, verdict: str
) -> None:
    robot = ProgramPlan(
        name="robot", role="robot", kind="application", argv=[sys.executable, "-c", PROGRAM.format(pause_s=pause_s)],
        folder=tmp_path,
    )  # fmt: skip
    plan = plan_yard("", asked=CRATE, robot_application=ApplicationPlan(role="robot", name="driver"), programs=[robot])
    is_asked = (tmp_path / "busy").exists
    # For one that is slow the clock stands at the limit, so that it has all the time it needs.
    clock = limit_reached(is_asked) if verdict == "ERROR" else lambda: 120.0 if is_asked() else 0.0
    outcome = launcher.run(plan, never, clock=clock)
    assert (outcome.status, outcome.verdict, outcome.timed_out) == ("Completed", verdict, True), outcome
    if verdict == "ERROR":
        assert "the robot application did not answer in step 6, at 0.10 s" in (outcome.verdict_reason or "")


def test_a_program_that_never_connects_is_unhealthy_whichever_limit_comes_first(
    launcher: Launcher, plan_yard: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # What it says of being told to end is no reason of the failure.
    code = (
        "import pathlib, signal, sys, time\n"
        "signal.signal(signal.SIGTERM, lambda *_: sys.exit('shut down from outside'))\n"
        "print('waiting for /cmd_vel', flush=True); pathlib.Path('busy').touch(); time.sleep(1e4)"
    )
    robot = ProgramPlan(
        name="robot", role="robot", kind="application", argv=[sys.executable, "-c", code], folder=tmp_path
    )
    plan = plan_yard("", asked=CRATE, robot_application=ApplicationPlan(role="robot", name="driver"), programs=[robot])
    outcome = launcher.run(plan, never, clock=limit_reached((tmp_path / "busy").exists))
    assert (outcome.status, outcome.failure_code) == ("Failed", "RobotApplicationHealthCheckFailure")
    assert "driver did not connect before the job's duration limit of 120 s" in (outcome.failure_reason or "")
    assert (outcome.failure_reason or "").endswith("Last lines of logs/robot.stdout.log:\nwaiting for /cmd_vel")
    assert (plan.output_dir / "logs" / "robot.stderr.log").read_text() == "shut down from outside\n"


@pytest.mark.parametrize("hang", ["act", "act-in-python"])
def test_who_does_not_answer_in_a_trial_is_said(launcher: Launcher, plan_yard: Plan, hang: str) -> None:
    plan = plan_yard(hang, "make_judging_environment", trials=Trials(seeds=3))
    outcome = launcher.run(plan, never, clock=limit_reached((plan.work_dir / "busy").exists))
    assert (outcome.status, outcome.verdict) == ("Completed", "ERROR")
    reason = result_of(plan).reason or ""
    assert reason.startswith(
        "trials: stopped in trial 0 of 3: stopped at the duration limit: the robot application did not answer in step"
    )
