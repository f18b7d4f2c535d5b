"""Robots and simulations that are spoiled do not pass, whichever requirement is asked and however they are run.

`CAUGHT_BY` says who catches what. A new kind of requirement, and a new place where a verdict is decided, needs a row.
"""

import ast
import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, get_args

import pytest
from helpers.paths import BUNDLES, REPOSITORY

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunOutcome, RunPlan, RunResult
from prefect_robomaker.schemas.runs.programs import ProgramPlan
from prefect_robomaker.schemas.runs.requirements import JobRequirement, parse_requirements
from prefect_robomaker.schemas.runs.trial_rows import TRIALS_FILE
from prefect_robomaker.schemas.runs.trials import Trials
from prefect_robomaker.tasks.runtime.states.checkpoint_files import resumable_plan
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.runtime.trials.table import read_row

YARD = BUNDLES / "yard"
SABOTAGES = ("idle", "ghost", "blind", "nan", "reversed", "gone")
ASKED: Mapping[str, dict[str, Any]] = {
    "goal": {"name": "east", "x": 1.2, "y": 0.5, "within_m": 0.2},
    "no_collision": {"name": "gentle", "max_force_N": 5.0},
    "time_limit": {"name": "quick", "limit_s": 4.5},
    "clearance": {"name": "polite", "min_m": 0.05},
    "predicate": {"name": "moves", "attribute": "yard.moves"},
}
"""One requirement of each kind, which the unspoiled robot meets."""

CAUGHT_BY: Mapping[str, Mapping[str, str]] = {
    "goal": {
        "idle": "east",
        "blind": "east",
        "reversed": "east",
        "nan": "physics",
        "gone": "simulated",
    },
    "no_collision": {
        "ghost": "gentle",
        "blind": "gentle",
        "reversed": "gentle",
        "nan": "physics",
        "gone": "simulated",
    },
    "time_limit": {
        "idle": "quick",
        "blind": "quick",
        "reversed": "quick",
        "nan": "physics",
        "gone": "simulated",
    },
    "clearance": {
        "ghost": "polite",
        "blind": "polite",
        "reversed": "polite",
        "nan": "physics",
        "gone": "simulated",
    },
    "predicate": {
        "idle": "moves",
        "nan": "physics",
        "gone": "simulated",
    },
}
"""Catchers of each sabotage by kind of requirement: the requirement itself, or a watcher of physics and steps."""

FAILS_THE_JOB: Mapping[str, tuple[str, ...]] = {
    "nan": ("mjWARN_BADCTRL", "the action is [nan, nan]; it has to be finite"),
    "gone": ("without connecting to the simulation",),
}
"""Sabotages for which a job may be `Failed` instead: dm_control's physics or the robot's client may refuse them."""

JUDGES: Mapping[str, tuple[str, ...]] = {
    "tasks/runtime/episode/results.py": ("factory", "program", "own environment", "resume", "container", "reuse"),
    "tasks/runtime/trials/tally.py": ("trials",),
    "tasks/runtime/supervision/finished_outputs.py": ("a program alone, whose own verdict counts",),
}
"""Modules that ask for a verdict, and the ways of running that end there."""


def asked() -> list[dict[str, Any]]:
    return [{"kind": kind, **members} for kind, members in ASKED.items()]


@pytest.fixture
def plan_yard(make_plan: Callable[..., RunPlan]) -> Callable[..., RunPlan]:
    """Plans a run of the yard with a sabotage."""

    def plan(
        sabotage: str, environment: str = "make_environment", variables: dict[str, str] | None = None, **members: Any
    ) -> RunPlan:
        given = {"SABOTAGE": sabotage, **(variables or {})}
        simulation = ApplicationPlan(
            role="simulation", name="yard", attribute=f"yard.{environment}", path=YARD, environment_variables=given
        )
        robot = ApplicationPlan(
            role="robot", name="driver", attribute="yard.make_agent", path=YARD, environment_variables=given
        )
        requirements = parse_requirements(asked(), "asked")
        run_id = f"run-{sabotage or 'honest'}"
        return make_plan(**{
            "run_id": run_id, "simulation_application": simulation, "robot_application": robot,
            "requirements": requirements, "max_duration_s": 600.0, **members,
        })  # fmt: skip

    return plan


def result_of(plan: RunPlan) -> RunResult:
    return RunResult.model_validate_json((plan.output_dir / "result.json").read_bytes())


def assert_caught(outcome: RunOutcome, plan: RunPlan, sabotage: str) -> None:
    """Asserts that the run did not pass, and that for each kind of requirement somebody caught the sabotage."""
    if outcome.status == "Failed" and sabotage in FAILS_THE_JOB:
        assert any(words in (outcome.failure_reason or "") for words in FAILS_THE_JOB[sabotage])
        return
    assert outcome.status == "Completed", outcome
    result = result_of(plan)
    if not sabotage:
        assert (result.verdict, result.reason) == ("PASS", None), "the unspoiled robot passes, or nothing is shown"
        return
    assert result.verdict in ("FAIL", "ERROR")
    missed = {item.name for item in result.requirements if not item.satisfied}
    for kind, caught in CAUGHT_BY.items():
        if sabotage in caught:
            assert caught[sabotage] in missed, (kind, missed)


# Ways of running


@pytest.mark.parametrize("sabotage", ["", *SABOTAGES])
def test_factories(launcher: Launcher, plan_yard: Callable[..., RunPlan], sabotage: str) -> None:
    plan = plan_yard(sabotage)
    assert_caught(launcher.run(plan, lambda: None), plan, sabotage)


@pytest.mark.parametrize("sabotage", ["", *SABOTAGES])
def test_an_environment_that_drives_and_asks_itself(
    launcher: Launcher, plan_yard: Callable[..., RunPlan], sabotage: str
) -> None:
    own = {"requirements": [], "variables": {"ASKED": json.dumps(asked())}}
    plan = plan_yard(sabotage, "make_own_environment", **own)
    assert_caught(launcher.run(plan, lambda: None), plan, sabotage)


def test_trials(launcher: Launcher, plan_yard: Callable[..., RunPlan]) -> None:
    plan = plan_yard(
        "", failure_behavior="Continue", trials=Trials(seeds=1, parameters={"SABOTAGE": ["none", *SABOTAGES]})
    )
    assert launcher.run(plan, lambda: None).status == "Completed"
    rows = [read_row(plan.output_dir / TRIALS_FILE, number) for number in range(7)]
    verdicts = {row.parameters["SABOTAGE"]: row.verdict for row in rows if row is not None}
    assert verdicts.pop("none") == "PASS"
    assert set(verdicts) == set(SABOTAGES)
    assert not {"PASS", "NONE"} & set(verdicts.values()), verdicts
    assert result_of(plan).verdict in ("FAIL", "ERROR")


@pytest.mark.parametrize("sabotage", ["", "blind", "idle", "reversed"])
def test_a_run_that_was_killed_and_goes_on(
    launcher: Launcher, plan_yard: Callable[..., RunPlan], tmp_path: Path, sabotage: str
) -> None:
    kept = {"checkpoint_dir": tmp_path / "checkpoints", "checkpoint_every_s": 0.5}
    plan = plan_yard(sabotage, variables={"KILL_AT": "120", "CHECKPOINTS": str(kept["checkpoint_dir"])}, **kept)
    assert launcher.run(plan, lambda: None).status == "Failed"
    found, _ = resumable_plan(kept["checkpoint_dir"])
    assert_caught(launcher.run(found, lambda: None), found, sabotage)


@pytest.mark.deep
@pytest.mark.parametrize("sabotage", ["", *SABOTAGES])
def test_a_program(launcher: Launcher, plan_yard: Callable[..., RunPlan], tmp_path: Path, sabotage: str) -> None:
    program = ProgramPlan(
        name="robot", role="robot", kind="application", argv=[sys.executable, str(YARD / "drive.py")], folder=tmp_path,
        environment={"SABOTAGE": sabotage, "PYTHONPATH": str(YARD)},
    )  # fmt: skip
    plan = plan_yard(sabotage, robot_application=ApplicationPlan(role="robot", name="driver"), programs=[program])
    assert_caught(launcher.run(plan, lambda: None), plan, sabotage)


# The table is whole


def test_each_kind_has_a_row_and_catches_what_it_is_for() -> None:
    kinds = {get_args(member.model_fields["kind"].annotation)[0] for member in get_args(get_args(JobRequirement)[0])}
    assert kinds == set(ASKED) == set(CAUGHT_BY)
    assert {sabotage for caught in CAUGHT_BY.values() for sabotage in caught} == set(SABOTAGES)
    for kind, caught in CAUGHT_BY.items():
        assert ASKED[kind]["name"] in caught.values(), f"{kind} catches nothing by itself"


def test_each_module_that_asks_for_a_verdict_has_a_row() -> None:
    asking = set()
    for layer in ("tasks", "flows", "deployments", "schemas"):
        for path in (REPOSITORY / layer).rglob("*.py"):
            names = {node.id for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Name)}
            if "decide_verdict" in names:
                asking.add(path.relative_to(REPOSITORY).as_posix())
    assert asking == set(JUDGES)
