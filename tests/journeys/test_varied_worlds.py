"""Specifications that vary worlds and drive a robot through each variation."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.paths import REPOSITORY

from prefect_robomaker.schemas.reports.run_record import RunRecord

pytestmark = pytest.mark.deep
PAGE = (REPOSITORY / "docs" / "world-import.md").read_text()
EXAMPLE = re.findall(r"^```yaml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)[-1]
Robomaker = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def robomaker(tmp_path: Path, prefect_server: str) -> Robomaker:
    """Runs the command in a process of its own."""
    variables = {"ROBOMAKER_HOME": str(tmp_path / "home"), "PREFECT_API_URL": prefect_server, "CI": "true"}

    def run(*words: object) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main", *map(str, words)]
        return subprocess.run(command, env={**os.environ, **variables}, capture_output=True, text=True, timeout=280)

    return run


def run_of(robomaker: Robomaker, folder: Path, text: str) -> tuple[subprocess.CompletedProcess[str], RunRecord]:
    spec = folder / "robustness.yaml"
    spec.write_text(text)
    ended = robomaker("run", spec, "-o", "json")
    return ended, RunRecord.model_validate_json(ended.stdout)


def test_the_example_of_the_page_drives_through_every_variation(robomaker: Robomaker, tmp_path: Path) -> None:
    ended, record = run_of(robomaker, tmp_path, EXAMPLE)
    steps = {step.name: step for step in record.steps}
    assert [step.status for step in record.steps] == ["Completed"] * 4, ended.stderr
    [world] = steps["worlds"].output["finishedWorldsSummary"]["succeededWorlds"]
    varied = steps["variations"].output
    assert [each["arn"] for each in varied["variedWorlds"]] == varied["worlds"]
    assert {each["world"] for each in varied["variedWorlds"]} == {world}
    assert [each["changes"][0].split(":")[0] for each in varied["variedWorlds"]] == [
        "light world", "door door-1", "door door-1",
    ]  # fmt: skip
    assert [job.status for job in record.jobs] == ["Completed"] * 4
    assert len({job.world for job in record.jobs}) == 4

    shown = json.loads(robomaker("world", "show", varied["worlds"][1], "-o", "json").stdout)
    assert shown["variation"]["of_world"] == world
    assert [change["after"] for change in shown["variation"]["changes"]] == ["0 % open"]


def test_a_world_that_lacks_what_is_to_differ_fails_the_step_and_is_named(robomaker: Robomaker, tmp_path: Path) -> None:
    ended, record = run_of(robomaker, tmp_path, EXAMPLE.replace("door-1: 40", "door-9: 40"))
    assert [step.status for step in record.steps] == ["Completed", "Completed", "Failed", "Skipped"]
    [world] = record.steps[1].output["finishedWorldsSummary"]["succeededWorlds"]
    assert record.steps[2].error is not None
    assert f"variations[2] of world {world}: the world has no door 'door-9'" in record.steps[2].error
    assert ended.returncode == 3
