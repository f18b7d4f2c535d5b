"""challenge: sabotaged robots in real simulations, what is told of them, and what is refused before anything runs."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.cartpole_spec import PACKAGE, poles
from helpers.paths import REPOSITORY

from prefect_robomaker.schemas.specs import sabotages
from prefect_robomaker.schemas.specs.sabotages import BUILT_IN, parse_sabotages
from prefect_robomaker.schemas.specs.yaml_nodes import parse
from prefect_robomaker.tasks.storage import pack_tar_gz

Command = Callable[..., Any]
WriteSpec = Callable[[str], Path]
PAGE = (REPOSITORY / "docs" / "challenges.md").read_text()


def shown_file(name: str) -> str:
    """A file that the page shows."""
    found = re.search(rf"<!-- file: {re.escape(name)} -->\n```yaml\n(.*?)```", PAGE, re.DOTALL)
    assert found is not None
    return found[1]


def without_times(text: str) -> list[str]:
    """Lines without times: other machines round otherwise, and robots come a little earlier or later."""
    return [re.sub(r" at [\d.]+ s", "", line.strip()) for line in text.splitlines() if line.strip()]


def test_one_sabotage_is_caught_and_one_is_missed(
    robomaker_at_server: Command, spec: WriteSpec, home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(PACKAGE))
    # Those that the environment has, and one that it has not: every one costs a job.
    monkeypatch.setattr(sabotages, "BUILT_IN", tuple(each for each in BUILT_IN if each.name == "blind"))
    (tmp_path / "own.yaml").write_text(
        "does nothing: {GAIN: '0'}\nheavier: {robot_mass: 1.05}\nas before: {GAIN: '1'}\nunreadable: {GAIN: much}\n"
    )
    path = spec(
        poles("seed: 2\n          tags: {sabotage: of mine}").replace('TIME_LIMIT_S: "0.5"', 'TIME_LIMIT_S: "4"')
    )

    ended = robomaker_at_server("challenge", path, "--jobs", "1", "--sabotages", tmp_path / "own.yaml")

    assert ended.code == 1, ended.err
    lines = {line.split("  ")[1]: line for line in ended.out.splitlines() if line.startswith("  ")}
    assert "2 of 4 sabotages caught, 1 of them only by what broke; 1 not applicable" in ended.out
    assert lines["unreadable"].endswith("broke the only job by a crash; no requirement caught it")
    assert lines["does nothing"].endswith("caught by the only job, first by upright")
    assert lines["heavier"].endswith("missed by the only job; nothing here would notice it")
    assert lines["as before"].endswith("had no effect in the only job")
    assert "not applicable: the environment (Cartpole) has no lidar" in lines["blind"]
    [run] = (home / "runs").iterdir()
    assert run.name.startswith("poles-challenge-")
    report = (run / "report.html").read_text()
    assert "Would it have been noticed?" in report
    assert "missed by the only job; nothing here would notice it" in report

    # The run is told again by its record, and is no night of the specification.
    again = robomaker_at_server("report", run.name, "--markdown", tmp_path / "report.md")
    assert again.code == 0, again.err
    assert "| `heavier` | `missed by the only job; nothing here would notice it` |" in (
        (tmp_path / "report.md").read_text()
    )
    assert (run / "report.html").read_text().count("Would it have been noticed?") == 1
    assert robomaker_at_server("history", "poles").code != 0
    # The names of its applications are free again.
    assert robomaker_at_server("call", "ListRobotApplications").out.count("agent") == 0


PROGRAM = """
import math
from prefect_robomaker.tasks.runtime.agents.agent_client import connect

with connect() as simulation:
    for step in simulation:
        sees = any(math.isfinite(each) for each in step.observation["scan"])
        simulation.act([0.3 if sees else 0.0, 0.0])
"""
"""Robot that drives straight on, in a process of its own, as long as its lidar sees anything."""
DRIVES = """
version: 1
name: straight-on
sabotages: {old tyres: {wheel_slip: 0.1}, asked to idle: {ROBOMAKER_SIM_TIME_LIMIT_S: "1"}}
steps:
  template:
    operation: CreateWorldTemplate
    input:
      name: flat
      templateBody:
        Buildings: [{Floors: [{Floorplan: {Rooms: [{Type: Living, Name: Living}, {Type: Bedroom, Name: Bedroom}]}}]}]
  worlds:
    operation: CreateWorldGenerationJob
    input: {template: "${{ template.arn }}", worldCount: {floorplanCount: 1, interiorCountPerFloorplan: 1}, seed: 7}
  robot:
    operation: CreateRobotApplication
    input:
      name: straight
      sources: [{s3Bucket: robomaker, s3Key: straight.tar.gz}]
      robotSoftwareSuite: {name: General}
  drive:
    operation: CreateSimulationJob
    needs: [robot]
    input:
      maxJobDurationInSeconds: 300
      iamRole: arn:aws:iam::000000000000:role/local
      seed: 1
      robotApplications: [{application: straight, launchConfig: {command: [python3, drive.py]}}]
      simulationApplications:
        - application: indoor-navigation
          launchConfig: {}
          worldConfigs: [{world: "${{ worlds.finishedWorldsSummary.succeededWorlds[0] }}"}]
      requirements:
        - {kind: goal, name: ahead, x: 0.4, y: 0, within_m: 0.1, by_s: 3, stop: true}
"""


@pytest.mark.deep
def test_a_robot_program_is_sabotaged_in_the_simulation_that_it_drives(
    robomaker_at_server: Command, spec: WriteSpec, home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted = ("idle", "blind", "late by 0.2 s", "left and right swapped")
    monkeypatch.setattr(sabotages, "BUILT_IN", tuple(each for each in BUILT_IN if each.name in wanted))
    (tmp_path / "bundle").mkdir()
    (tmp_path / "bundle" / "drive.py").write_text(PROGRAM)
    store = home / "objects" / "robomaker"
    store.mkdir(parents=True)
    pack_tar_gz(tmp_path / "bundle", store / "straight.tar.gz")

    ended = robomaker_at_server("challenge", spec(DRIVES))

    lines = {line.split("  ")[1]: line for line in ended.out.splitlines() if line.startswith("  ")}
    assert ended.code == 1, ended.err + ended.out
    assert "caught by the only job, first by ahead" in lines["idle"]
    assert "caught by the only job, first by ahead" in lines["blind"]
    assert lines["late by 0.2 s"].endswith("missed by the only job; nothing here would notice it")
    assert lines["left and right swapped"].endswith("had no effect in the only job"), "it never turns"
    assert lines["old tyres"].endswith("missed by the only job; nothing here would notice it")
    assert "caught by the only job, first by ahead" in lines["asked to idle"], "variables reach the run, too"


@pytest.mark.deep
def test_the_page_is_true(
    robomaker_at_server: Command, home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Scout in a generated flat: the page's requirements miss what it says, and with one more they catch it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "flat.yaml").write_text(shown_file("flat.yaml"))
    [shown] = re.findall(r"```console\n\$ robomaker (challenge .*)\n((?:.|\n)*?)```", PAGE)

    ended = robomaker_at_server(*shown[0].split())

    assert ended.code == 1, ended.err
    told = without_times(shown[1])
    assert len(told) == 10
    assert told == [line for line in without_times(ended.out) if line in told], ended.out


def test_the_file_that_the_page_shows_is_right() -> None:
    assert parse_sabotages(parse(shown_file("own.yaml"), "own.yaml"))


def test_sabotages_of_a_specification_are_checked_with_it(robomaker: Command, spec: WriteSpec) -> None:
    text = poles("seed: 1").replace("steps:", "sabotages:\n  slow: {motor_gian: 0.5}\nsteps:", 1)
    ended = robomaker("validate", spec(text))
    assert ended.code == 2
    assert ":4:10: sabotages.slow.motor_gian: there is no axis 'motor_gian'; did you mean 'motor_gain'?" in ended.err
    twice = spec(text.replace("motor_gian", "motor_gain"))
    own = twice.with_name("own.yaml")
    own.write_text("slow: {motor_gain: 0.2}\n")
    ended = robomaker("challenge", twice, "--sabotages", own)
    assert ended.code == 2
    assert "the specification has a sabotage 'slow' too; rename one" in ended.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--jobs", "0"), "--jobs is 0; a number from 1 would be right"),
        (
            ("--sabotages", "own.yaml"),
            "own.yaml:1:8: slow.motor_gian: there is no axis 'motor_gian'; did you mean 'motor_gain'?",
        ),
        (("--sabotages", "none.yaml"), "none.yaml: no such file or directory"),
    ],
)
def test_bad_words_are_refused_before_anything_runs(
    robomaker: Command,
    spec: WriteSpec,
    home: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: Any,
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.yaml").write_text("slow: {motor_gian: 0.5}\n")
    ended = robomaker("challenge", spec(poles("seed: 1")), *words)
    assert (ended.code, ended.out) == (2, "")
    assert said in ended.err
    assert not home.exists()


def test_a_specification_without_simulation_is_refused(robomaker: Command, spec: WriteSpec, home: Path) -> None:
    text = json.dumps({"version": 1, "name": "read", "steps": {"read": {"operation": "ListWorlds", "input": {}}}})
    ended = robomaker("challenge", spec(text))
    assert ended.code == 2
    assert "steps: no step runs simulation jobs, so that there is no robot to sabotage" in ended.err
    assert not home.exists()
