"""The test that a reproduction comes with."""

import ast
from collections.abc import Callable
from pathlib import Path

import pytest

from prefect_robomaker.schemas.runs.plan import Requirement, RunPlan
from prefect_robomaker.schemas.runs.provenance import PROVENANCE_FILE, Provenance
from prefect_robomaker.tasks.runtime.replay.repro import missed_names, write_reproduction
from prefect_robomaker.tasks.runtime.states.provenance import machine_facts


def first_of(plan: RunPlan, folder: Path) -> Path:
    folder.mkdir()
    (folder / PROVENANCE_FILE).write_text(Provenance(plan=plan, machine=machine_facts()).model_dump_json())
    return folder


def test_a_folder_is_whole_or_not_there(make_plan: Callable[..., RunPlan], tmp_path: Path) -> None:
    plan = make_plan(simulation_application=None, robot_application=None, world_dir=tmp_path / "world")
    first, folder = first_of(plan, tmp_path / "outputs"), tmp_path / "made" / "repro"
    with pytest.raises(FileNotFoundError):  # the world cannot be copied
        write_reproduction(plan, first, None, folder)
    assert list(folder.parent.iterdir()) == []

    (tmp_path / "world").mkdir()
    (tmp_path / "world" / "world.xml").touch()
    assert write_reproduction(plan, first, None, folder).exists()
    assert sorted(path.name for path in folder.iterdir()) == ["first", "plan.json", "test_repro_sim_7.py", "world"]
    assert list(folder.parent.iterdir()) == [folder]


def test_what_is_in_a_folder_stays(make_plan: Callable[..., RunPlan], tmp_path: Path) -> None:
    plan = make_plan(simulation_application=None, robot_application=None)
    first, folder = first_of(plan, tmp_path / "outputs"), tmp_path / "repro"
    folder.mkdir()
    (folder / "first").write_text("mine")
    with pytest.raises(FileExistsError, match="has first already; name another folder"):
        write_reproduction(plan, first, None, folder)
    assert [(path.name, path.read_text()) for path in folder.iterdir()] == [("first", "mine")]


def test_what_a_run_says_of_itself_is_no_code(make_plan: Callable[..., RunPlan], tmp_path: Path) -> None:
    """Outputs may come from anybody."""
    names = {"job_id": 'sim-1/../../x"""\nimport evil\n"""', "run_id": 'r\\"""; import evil; """'}
    plan = make_plan(simulation_application=None, robot_application=None, **names)
    first = first_of(plan, tmp_path / "first")

    test = write_reproduction(plan, first, 'X"""\nimport evil', tmp_path / "repro")

    assert test.parent == tmp_path / "repro"
    imported = {alias.name for node in ast.walk(ast.parse(test.read_text())) if isinstance(node, ast.Import)
                for alias in node.names}  # fmt: skip
    assert imported == {"pytest"}


def test_what_is_switched_off_is_no_reason() -> None:
    off = Requirement(name="rooms_visited", kind="off", satisfied=False, detail="", counts=False)
    trials = Requirement(name="trials", satisfied=False, detail="1 of 2 trials did not pass: 0")
    polite = Requirement(name="polite", kind="clearance", satisfied=False, detail="met in 1 of 2 trials", counts=False)
    late = Requirement(name="late", kind="goal", satisfied=False, detail="")
    assert missed_names([off, late]) == ["late"]
    assert missed_names([trials, off, polite]) == ["trials", "polite"], "entries of trials count in the trials"
