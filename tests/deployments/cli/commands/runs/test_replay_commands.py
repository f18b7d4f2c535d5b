"""`robomaker verify` and `robomaker repro`: what they print, and their exit codes."""

import json
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest
from helpers.paths import BUNDLES
from helpers.swing_fixtures import outputs_of

from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service


@pytest.fixture
def home(service: Service) -> Path:
    """The data home of the service that jobs are run with."""
    return service.settings.home


def test_verify_says_bit_identical(robomaker: Any, swing: Any) -> None:
    shown = robomaker("verify", swing()["name"])
    assert (shown.code, shown.out, shown.err) == (0, "bit-identical: 5 states over 4.000 s\n", "")


@pytest.fixture
def driven(swing: Any) -> dict[str, Any]:
    """A job whose robot is a program."""
    code = (
        "from prefect_robomaker.tasks.runtime.agents.agent_client import connect\n"
        "with connect() as simulation:\n"
        "    simulation.run(lambda step: [0.1])\n"
    )
    return swing(robot={"launchConfig": {"command": ["python3", "-c", code]}})


def test_repro_says_that_a_robot_program_is_not_run(robomaker: Any, driven: dict[str, Any], tmp_path: Path) -> None:
    shown = robomaker("repro", driven["arn"], "--no-video", "--to", tmp_path / "repro")
    said = "The rerun ended with verdict PASS, as the run did"
    assert shown.out.startswith(f"{said}; with the recorded actions, the robot's program was not run.\n")


def test_verify_runs_a_robot_program_again_if_it_is_told_to(robomaker: Any, driven: dict[str, Any]) -> None:
    said = "bit-identical: 5 states over 4.000 s; "
    assert (
        robomaker("verify", driven["arn"]).out == said + "with the recorded actions, the robot's program was not run\n"
    )
    shown = robomaker("verify", driven["arn"], "--run-program")
    assert (shown.code, shown.out) == (0, said + "the robot's program was run again\n")


def test_verify_says_when_and_where_it_diverged(robomaker: Any, swing: Any) -> None:
    shown = robomaker("verify", swing(DRIFT_AT="60")["arn"], "-o", "json")
    answer = json.loads(shown.out)
    assert (shown.code, answer["answer"]) == (1, "diverged")
    assert answer["divergence"]["time_s"] == pytest.approx(2.0)
    assert answer["divergence"]["joint"] in ("shoulder", "elbow")
    assert answer["digest"] != answer["digest_again"]


def test_verify_says_why_not(robomaker: Any, swing: Any, service: Service) -> None:
    path = outputs_of(service, swing()) / "provenance.json"
    path.write_text(path.read_text().replace('"numpy": "', '"numpy": "0.'))
    shown = robomaker("verify", path.parent)
    assert shown.code == 3
    assert shown.out.startswith("not comparable: numpy is 0.")
    missing = robomaker("verify", "sim-000000000000")
    assert missing.code != 0
    assert "sim-000000000000" in missing.err


def test_repro_says_what_to_run(robomaker: Any, swing: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    job = swing(LIMIT="0.5")
    monkeypatch.chdir(tmp_path)
    shown = robomaker("repro", job["arn"], "--no-video")
    test = tmp_path / f"repro-{job['name']}" / f"test_repro_{job['name'].replace('-', '_')}.py"
    assert shown.code == 0
    assert shown.out.splitlines() == [
        "The rerun ended with verdict FAIL (low), as the run did.",
        f"Run it again: python -m pytest {test}",
    ]
    assert test.is_file()
    again = robomaker("repro", job["arn"], "--to", test.parent)
    assert (again.code, again.out) == (2, "")
    assert "holds a reproduction already; name another folder" in again.err


def test_repro_says_which_module_is_not_found_and_how_to_give_its_folder(
    robomaker: Any, swing: Any, service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It said that the rerun failed, that this is not how the run ended, and that the application is another one."""
    folder = tmp_path / "own"
    shutil.copytree(BUNDLES / "swinger" / "swinger", folder / "own_arm")
    path = [*sys.path]
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setenv("PYTHONPATH", str(folder))
    own = {"name": "own", "environment": {"uri": "python://own_arm"}, "robotSoftwareSuite": {"name": "General"}}
    call("CreateRobotApplication", own, service)
    job = swing(robot={"application": "own", "launchConfig": {"launchFile": "make_agent"}})
    monkeypatch.delenv("PYTHONPATH")
    monkeypatch.setattr(sys, "path", path)

    shown = robomaker("repro", job["arn"], "--no-video", "--to", tmp_path / "repro")

    assert shown.code == 2
    assert "the Python module own_arm of the robot application own is not found; install it, or name" in shown.err
    assert "PYTHONPATH=FOLDER robomaker repro" in shown.err
    assert not (tmp_path / "repro").exists()
