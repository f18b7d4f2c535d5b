"""Specifications that vary worlds and drive a robot through each variation."""

import json
import re
from pathlib import Path

import pytest
from helpers.command_here import Command, Outcome
from helpers.paths import REPOSITORY

from prefect_robomaker.schemas.reports.run_record import RunRecord

pytestmark = [pytest.mark.deep, pytest.mark.usefixtures("known_worlds")]
PAGE = (REPOSITORY / "docs" / "world-import.md").read_text()
EXAMPLE = re.findall(r"^```yaml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)[-1]


def run_of(robomaker_at_server: Command, folder: Path, text: str) -> tuple[Outcome, RunRecord]:
    spec = folder / "robustness.yaml"
    spec.write_text(text)
    ended = robomaker_at_server("run", spec, "-o", "json")
    return ended, RunRecord.model_validate_json(ended.out)


def test_the_example_of_the_page_drives_through_every_variation(robomaker_at_server: Command, tmp_path: Path) -> None:
    ended, record = run_of(robomaker_at_server, tmp_path, EXAMPLE)
    steps = {step.name: step for step in record.steps}
    assert [step.status for step in record.steps] == ["Completed"] * 4, ended.err
    [world] = steps["worlds"].output["finishedWorldsSummary"]["succeededWorlds"]
    varied = steps["variations"].output
    assert [each["arn"] for each in varied["variedWorlds"]] == varied["worlds"]
    assert {each["world"] for each in varied["variedWorlds"]} == {world}
    assert [each["changes"][0].split(":")[0] for each in varied["variedWorlds"]] == [
        "light world", "door door-1", "door door-1",
    ]  # fmt: skip
    assert [job.status for job in record.jobs] == ["Completed"] * 4
    assert len({job.world for job in record.jobs}) == 4

    shown = json.loads(robomaker_at_server("world", "show", varied["worlds"][1], "-o", "json").out)
    assert shown["variation"]["of_world"] == world
    assert [change["after"] for change in shown["variation"]["changes"]] == ["0 % open"]


def test_a_world_that_lacks_what_is_to_differ_fails_the_step_and_is_named(
    robomaker_at_server: Command, tmp_path: Path
) -> None:
    ended, record = run_of(robomaker_at_server, tmp_path, EXAMPLE.replace("door-1: 40", "door-9: 40"))
    assert [step.status for step in record.steps] == ["Completed", "Completed", "Failed", "Skipped"]
    [world] = record.steps[1].output["finishedWorldsSummary"]["succeededWorlds"]
    assert record.steps[2].error is not None
    assert f"variations[2] of world {world}: the world has no door 'door-9'" in record.steps[2].error
    assert ended.code == 3
