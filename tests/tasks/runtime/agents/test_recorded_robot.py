"""Reruns in which recorded actions take the place of a robot's program."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dm_env import specs
from helpers.remote_jobs import ARENA, Job

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RecordedActions, RunOutcome, RunPlan, RunResult
from prefect_robomaker.schemas.runs.provenance import Provenance
from prefect_robomaker.tasks.runtime.agents.action_log import ActionLog, ActionLogWriter, header_of
from prefect_robomaker.tasks.runtime.agents.agent_client import ACTION_HEADER
from prefect_robomaker.tasks.runtime.agents.agent_layout import Layout
from prefect_robomaker.tasks.runtime.replay.replay import read_outputs, why_not_repeatable
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher

MakePlan = Callable[..., RunPlan]
Start = Callable[..., Job]
Repeat = Callable[..., tuple[RunOutcome, RunPlan]]
DRIVER = ApplicationPlan(role="robot", name="driver")


@pytest.fixture
def repeat(launcher: Launcher) -> Repeat:
    """Runs a plan again with recorded actions and no program that connects."""

    def repeat(plan: RunPlan, **recorded: Any) -> tuple[RunOutcome, RunPlan]:
        folder = plan.work_dir.parent.parent / "again"
        actions = RecordedActions(**({"path": plan.output_dir / "actions.bin", "ended_by": "agent"} | recorded))
        folders = {"work_dir": folder / "work", "output_dir": folder / "out"}
        again = plan.model_copy(update={**folders, "recorded_actions": actions})
        return launcher.run(again, lambda: None), again

    return repeat


def result_of(plan: RunPlan) -> RunResult:
    return RunResult.model_validate_json((plan.output_dir / "result.json").read_bytes())


def log_of(path: Path, spec: Any, *actions: Any) -> Path:
    writer = ActionLogWriter(path, header_of("lockstep", Layout(spec, ACTION_HEADER.size)))
    for action in actions:
        writer.add(np.asarray(action, "<f8").tobytes())
    writer.close()
    return path


def test_actions_of_every_kind_are_given_again_as_they_were(start: Start, repeat: Repeat) -> None:
    job = start(ARENA.format("make_unusual"))
    with job.connect() as simulation:
        for step in simulation:
            simulation.act({"grip": step.step % 2 == 0, "arms": [[0.1 * step.step, -step.step], step.step % 4]})

    first = job.result().extra

    _, again = repeat(job.plan)

    second = result_of(again).extra
    assert second["taken"] == first["taken"] != []
    assert (second["kinds"], second["owned"]) == (first["kinds"], 5)
    assert second["agent"] == {"mode": "recorded", "actions": 5}
    assert not (again.output_dir / "actions.bin").exists()


def test_of_a_robot_that_runs_free_every_step_is_known(start: Start, repeat: Repeat) -> None:
    job = start(ARENA.format("make_timed"))
    with job.connect(mode="free") as simulation:
        for step in simulation:
            simulation.act(float(step.step))
            time.sleep(0.03)  # a step is 0.02 s: some actions are held
    first = job.result().extra
    assert len(set(first["actions"])) < 30

    _, again = repeat(job.plan)

    second = result_of(again).extra
    assert second["actions"] == first["actions"]
    assert second["times"][-1] - second["times"][0] < first["times"][-1] - first["times"][0], "it waits for no program"
    assert ActionLog(job.plan.output_dir / "actions.bin").header.mode == "free"


def test_what_was_done_is_known_without_reading_it(start: Start, tmp_path: Path) -> None:
    """So that a long run ends as fast as a short one, and what an application puts in its place is found out."""
    job = start()
    with job.connect() as simulation:
        for step in simulation:
            if step.step == 7:
                log_of(tmp_path / "forged.bin", specs.Array((1,), np.float64), [0.0]).rename(
                    job.plan.output_dir / "actions.bin"
                )
            simulation.act([0.5])
    steps = job.result().metrics["steps"]

    actions = Provenance.model_validate_json((job.plan.output_dir / "provenance.json").read_bytes()).actions

    assert actions is not None
    assert actions.actions == steps > 7
    run = read_outputs(job.plan.output_dir)
    [reason] = why_not_repeatable(run)
    assert reason.endswith(f"actions.bin is not what the run wrote: 1 of {steps:.0f} actions are whole")


def test_where_actions_end_the_rerun_ends_as_the_run_did(start: Start, repeat: Repeat) -> None:
    job = start()
    with job.connect() as simulation:
        for step in simulation:
            if step.step == 3:
                break
            simulation.act([0.5])
    assert job.result().ended_by == "agent"

    _, again = repeat(job.plan)
    assert (result_of(again).ended_by, result_of(again).metrics["steps"]) == ("agent", 3.0)
    _, again = repeat(job.plan, ended_by="duration limit")
    assert (result_of(again).ended_by, result_of(again).metrics["steps"]) == ("duration limit", 3.0)
    outcome, _ = repeat(job.plan, ended_by=None)
    assert (outcome.status, outcome.failure_code) == ("Failed", "RobotApplicationCrash")
    assert "the recorded actions of robot application driver end here, after 3 steps" in (outcome.failure_reason or "")


@pytest.mark.parametrize(
    ("spec", "actions", "code", "text"),
    [
        (specs.Array((2,), np.float64), [], "InvalidInput", "are float64[2]; this environment takes float64[1]"),
        (specs.Array((1,), np.float32), [], "InvalidInput", "are float32[1]; this environment takes float64[1]"),
        ({"a": specs.Array((1,), np.float64)}, [], "InvalidInput", "are a: float64[1]; this environment takes"),
        (
            specs.Array((1,), np.float64), [[0.0], [np.nan]], "RobotApplicationCrash",
            "recorded action 1: the action is [nan]; it has to be finite",
        ),
    ],
)  # fmt: skip
def test_what_this_environment_does_not_take_is_refused(
    make_plan: MakePlan, repeat: Repeat, tmp_path: Path, spec: Any, actions: list[Any], code: str, text: str
) -> None:
    plan = make_plan(robot_application=DRIVER)
    outcome, _ = repeat(plan, path=log_of(tmp_path / "other.bin", spec, *actions))
    assert (outcome.status, outcome.failure_code) == ("Failed", code), outcome
    assert text in (outcome.failure_reason or "")


def test_what_is_no_log_is_said(make_plan: MakePlan, repeat: Repeat, tmp_path: Path) -> None:
    outcome, _ = repeat(make_plan(robot_application=DRIVER), path=tmp_path / "gone.bin")
    assert "the recorded actions of robot application driver: " in (outcome.failure_reason or "")
    assert "gone.bin cannot be read" in (outcome.failure_reason or "")


def test_a_log_that_does_not_say_what_its_actions_are_is_no_log(
    make_plan: MakePlan, repeat: Repeat, tmp_path: Path
) -> None:
    forged = tmp_path / "forged.bin"
    array = '{"dtype": "float64", "shape": [1], "offset": 0}'
    forged.write_text(f'robomaker actions 1\n{{"mode": "lockstep", "size": 8, "arrays": [{array}]}}\n')
    outcome, _ = repeat(make_plan(robot_application=DRIVER), path=forged)
    assert (outcome.status, outcome.failure_code) == ("Failed", "InvalidInput")
    said = "the recorded actions of robot application driver: "
    assert f"{said}{forged} is no log of actions: arrays.0.path: Field required" in (outcome.failure_reason or "")
