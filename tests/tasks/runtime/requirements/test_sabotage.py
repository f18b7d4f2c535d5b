"""Robots and simulations that are spoiled do not pass, whichever requirement is asked and however they are run.

`CAUGHT_BY` says who catches what, `JUDGES` which test walks each way. A new kind of requirement, and a new place where
a verdict is decided, needs a row.
"""

import ast
import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from helpers.paths import REPOSITORY
from helpers.variable_axes import trials_of_variables
from helpers.yard_sabotages import ASKED, CAUGHT_BY, JUDGED_ELSEWHERE, SABOTAGES, YARD, asked, assert_caught

from prefect_robomaker.schemas.runs.plan import ApplicationPlan, RunOutcome, RunPlan, RunResult
from prefect_robomaker.schemas.runs.programs import ProgramPlan
from prefect_robomaker.schemas.runs.requirements import REQUIREMENT_KINDS, parse_requirements
from prefect_robomaker.schemas.runs.trial_rows import TRIALS_FILE
from prefect_robomaker.tasks.runtime.states.checkpoint_files import resumable_plan
from prefect_robomaker.tasks.runtime.supervision.launcher import Launcher
from prefect_robomaker.tasks.runtime.trials.completion import read_row

_JOBS = "tests/journeys/test_sabotaged_jobs.py"
_HANGS = "tests/tasks/runtime/supervision/test_unanswered.py"
JUDGES: Mapping[str, Mapping[str, str]] = {
    "tasks/runtime/episode/run_results.py": {
        "factory": "test_factories",
        "program": "test_a_program",
        "own environment": "test_an_environment_that_drives_and_asks_itself",
        "resume": "test_a_run_that_was_killed_and_goes_on",
        "container": f"{_JOBS}::test_a_robot_in_a_container",
        "reuse": f"{_JOBS}::test_results_that_are_taken_over",
    },
    "tasks/runtime/trials/tally.py": {"trials": "test_trials"},
    "tasks/runtime/supervision/finished_outputs.py": {
        "a program alone": "test_a_program_alone",
        "killed at the limit": f"{_HANGS}::test_who_does_not_answer_is_said",
    },
}
"""Modules that ask for a verdict, the ways of running that end there, and the test that walks each of them."""


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


def assert_run_caught(outcome: RunOutcome, plan: RunPlan, sabotage: str) -> None:
    stored = plan.output_dir / "result.json"
    assert_caught(outcome.status, outcome.failure_reason, stored.read_bytes() if stored.exists() else None, sabotage)


# Ways of running


@pytest.mark.parametrize("sabotage", ["", *SABOTAGES])
def test_factories(launcher: Launcher, plan_yard: Callable[..., RunPlan], sabotage: str) -> None:
    plan = plan_yard(sabotage)
    assert_run_caught(launcher.run(plan, lambda: None), plan, sabotage)


@pytest.mark.parametrize("sabotage", ["", *SABOTAGES])
def test_an_environment_that_drives_and_asks_itself(
    launcher: Launcher, plan_yard: Callable[..., RunPlan], sabotage: str
) -> None:
    own = {"requirements": [], "variables": {"ASKED": json.dumps(asked())}}
    plan = plan_yard(sabotage, "make_own_environment", **own)
    assert_run_caught(launcher.run(plan, lambda: None), plan, sabotage)


def test_trials(launcher: Launcher, plan_yard: Callable[..., RunPlan]) -> None:
    plan = plan_yard("", failure_behavior="Continue", trials=trials_of_variables(1, {"SABOTAGE": ["none", *SABOTAGES]}))
    assert launcher.run(plan, lambda: None).status == "Completed"
    rows = [read_row(plan.output_dir / TRIALS_FILE, number) for number in range(7)]
    verdicts = {row.axes["SABOTAGE"]: row.verdict for row in rows if row is not None}
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
    assert_run_caught(launcher.run(found, lambda: None), found, sabotage)


@pytest.mark.deep
@pytest.mark.parametrize("sabotage", ["", *SABOTAGES])
def test_a_program(launcher: Launcher, plan_yard: Callable[..., RunPlan], tmp_path: Path, sabotage: str) -> None:
    program = ProgramPlan(
        name="robot", role="robot", kind="application", argv=[sys.executable, str(YARD / "drive.py")], folder=tmp_path,
        environment={"SABOTAGE": sabotage, "PYTHONPATH": str(YARD)},
    )  # fmt: skip
    plan = plan_yard(sabotage, robot_application=ApplicationPlan(role="robot", name="driver"), programs=[program])
    assert_run_caught(launcher.run(plan, lambda: None), plan, sabotage)


@pytest.mark.parametrize(
    ("said", "asks", "verdict"),
    [
        ({"name": "east", "satisfied": False}, False, "FAIL"),
        ({"name": "east", "satisfied": False, "error": "no map"}, False, "ERROR"),
        ({"name": "east", "satisfied": True}, True, "ERROR"),
        ({"name": "east", "satisfied": True}, False, "PASS"),
    ],
)
def test_a_program_alone(
    launcher: Launcher,
    plan_programs: Callable[..., RunPlan],
    program: Callable[..., ProgramPlan],
    said: dict[str, Any],
    asks: bool,
    verdict: str,
) -> None:
    result = {"verdict": "PASS", "requirements": [{"kind": "own", "detail": "", **said}]}
    code = f"import os; open(os.environ['ROBOMAKER_OUTPUT_DIR'] + '/result.json', 'w').write({json.dumps(result)!r})"
    requirements = parse_requirements(asked()[:1] if asks else [], "asked")
    plan = plan_programs(program(code), requirements=requirements)

    assert launcher.run(plan, lambda: None).status == "Completed"
    assert result_of(plan).verdict == verdict


# The table is whole


def test_each_kind_has_a_row_and_catches_what_it_is_for() -> None:
    assert set(ASKED) == set(CAUGHT_BY)
    assert set(REQUIREMENT_KINDS) == {*ASKED, *JUDGED_ELSEWHERE}
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


def test_each_way_has_a_test() -> None:
    for ways in (*JUDGES.values(), JUDGED_ELSEWHERE):
        for way, test in ways.items():
            path, _, name = test.rpartition("::")
            source = (REPOSITORY / path if path else Path(__file__)).read_text()
            assert f"def {name}(" in source, f"{way}: there is no {test}"
