"""The test that a reproduction comes with."""

import ast
from collections.abc import Callable
from pathlib import Path

from prefect_robomaker.schemas.provenance import PROVENANCE_FILE, Provenance
from prefect_robomaker.schemas.simulation_run import RunPlan
from prefect_robomaker.tasks.runtime.provenance import machine_facts
from prefect_robomaker.tasks.runtime.repro import write_reproduction


def test_what_a_run_says_of_itself_is_no_code(make_plan: Callable[..., RunPlan], tmp_path: Path) -> None:
    """Outputs may come from anybody."""
    names = {"job_id": 'sim-1/../../x"""\nimport evil\n"""', "run_id": 'r\\"""; import evil; """'}
    plan = make_plan(simulation_application=None, robot_application=None, **names)
    first = tmp_path / "first"
    first.mkdir()
    (first / PROVENANCE_FILE).write_text(Provenance(plan=plan, machine=machine_facts()).model_dump_json())

    test = write_reproduction(plan, first, 'X"""\nimport evil', tmp_path / "repro")

    assert test.parent == tmp_path / "repro"
    imported = {alias.name for node in ast.walk(ast.parse(test.read_text())) if isinstance(node, ast.Import)
                for alias in node.names}  # fmt: skip
    assert imported == {"pytest"}
