"""run and report: real runs against the test run's Prefect server."""

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from helpers.night_records import make_night

from prefect_robomaker.deployments.cli.commands.specifications.run import again
from prefect_robomaker.deployments.cli.grammar import build_parser
from prefect_robomaker.flows import pipelines
from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.tasks.inspection.pipeline_parts import RunInterrupted

QUICK = """\
version: 1
name: quick
steps:
  template: {operation: CreateWorldTemplate, input: {name: flat, templateBody: {Version: "1"}}}
  body: {operation: GetWorldTemplateBody, input: {template: "${{ template.arn }}"}}
"""
FAILING = """\
version: 1
name: failing
steps:
  world: {operation: DescribeWorld, input: {world: "arn:aws:robomaker:us-east-1:000000000000:world/none"}}
  after: {operation: ListWorlds, needs: [world]}
"""
MAIN = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main"]


@pytest.fixture
def run(home: Path, prefect_server: str):
    """Runs the command in a process of its own: Prefect reads its settings once."""
    environ = {**os.environ, "ROBOMAKER_HOME": str(home), "PREFECT_API_URL": prefect_server, "CI": "true"}

    def start(*words: object) -> subprocess.CompletedProcess[str]:
        command = [*MAIN, *map(str, words)]
        return subprocess.run(command, env=environ, capture_output=True, text=True, check=False, timeout=290)

    return start


def test_a_run_says_what_happened_and_where_things_are(run, robomaker, spec, home: Path, tmp_path: Path) -> None:
    path, copy = spec(QUICK), tmp_path / "copy.html"
    ended = run("run", path, "--name", "renamed", "--report", copy)
    assert ended.returncode == 0, ended.stderr
    (folder,) = (home / "runs").iterdir()
    assert "renamed: succeeded after" in ended.stdout
    assert f"report   {copy}\n" in ended.stdout
    assert f"record   {folder}/run.json\n" in ended.stdout
    assert f"again    robomaker run {path} --name renamed --report {copy}\n" in ended.stdout
    assert copy.read_text().startswith("<!")
    assert "template: started CreateWorldTemplate" in ended.stderr
    assert "body: Completed after" in ended.stderr
    assert "Traceback" not in ended.stderr
    assert "prefect" not in ended.stderr.lower()

    again = robomaker("report")
    assert (again.code, again.out) == (0, f"{folder}/report.html\n")
    assert robomaker("report", folder.name).out == again.out
    unknown = robomaker("report", "other")
    assert unknown.code == 2
    assert f"the latest are {folder.name}" in unknown.err


@pytest.mark.deep
def test_a_run_says_how_far_off_its_forecast_was(robomaker_at_server, spec) -> None:
    path = spec(QUICK)
    planned = robomaker_at_server("plan", path, "--probe", "--price-per-hour", "0.5")
    assert planned.code == 0, planned.err
    assert "forecast for 1 machine, backend local:" in planned.out
    assert "  cost       0.0" in planned.out
    ended = robomaker_at_server("run", path)
    assert re.search(r"^forecast [\d.]+ s, took [\d.]+ s \(", ended.out, re.MULTILINE), ended.out


def test_a_step_that_fails_ends_the_run_with_3(robomaker_at_server, spec) -> None:
    ended = robomaker_at_server("run", spec(FAILING), "-o", "json")
    assert ended.code == 3, ended.err
    record = RunRecord.model_validate_json(ended.out)
    assert [(step.name, step.status) for step in record.steps] == [("world", "Failed"), ("after", "Skipped")]
    assert (record.state, record.exit_code, record.schema_version) == ("broken", 3, 2)
    assert "ResourceNotFoundException" in (record.steps[0].error or "")


def test_a_wrong_specification_runs_nothing(robomaker, spec, home: Path) -> None:
    ended = robomaker("run", spec(QUICK.replace("flat", "{}")))
    assert ended.code == 2
    assert "spec.yaml:4:" in ended.err
    assert not (home / "runs").exists()


def test_options_are_checked_before_anything_runs(robomaker, spec, home: Path) -> None:
    path = spec(QUICK)
    for options, expected in [
        (("--name", "no good"), "--name is 'no good'"),
        (("--seed", "-1"), "--seed is -1"),
        (("--seed", str(2**63)), f"--seed is {2**63}; it has to be a whole number from 0 to {2**63 - 1}"),
        (("--seed", "x"), "invalid int value: 'x'"),
        (("--report", "/nowhere/report.html"), "--report is /nowhere/report.html"),
    ]:
        ended = robomaker("run", path, *options)
        assert ended.code == 2
        assert expected in ended.err
    assert not home.exists()


def test_without_runs_report_says_how_to_make_one(robomaker) -> None:
    ended = robomaker("report")
    assert ended.code == 2
    assert "there are no runs in" in ended.err


@pytest.mark.parametrize(
    ("backend", "said"),
    [
        ("slurm", "ROBOMAKER_BACKEND is 'slurm'"),
        ("dask:head", "ROBOMAKER_BACKEND is 'dask:head'; after dask: there has"),
    ],
)
def test_a_backend_that_is_none_is_refused_before_anything_starts(
    robomaker, spec, home: Path, backend: str, said: str
) -> None:
    outcome = robomaker("run", spec(QUICK), "--backend", backend)

    assert outcome.code == 2
    assert said in outcome.err
    assert not home.exists()


def test_the_command_that_does_the_same_again_names_the_backend() -> None:
    arguments = build_parser().parse_args(["run", "spec.yaml", "--backend", "dask:tcp://head:8786"])

    assert again(arguments, {}) == ["robomaker", "run", "spec.yaml", "--backend", "dask:tcp://head:8786"]


@pytest.mark.parametrize(("letters", "code"), [("P", 0), ("F", 130), ("C", 130)])
def test_ctrl_c_after_the_last_step_of_a_run_that_succeeded_stopped_nothing(
    robomaker_at_server: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, letters: str, code: int
) -> None:
    """Its JUnit file has no error, so the exit code is 0."""
    night = make_night(letters, runs=tmp_path)
    if letters == "C":
        night = night.model_copy(update={"state": "canceled", "exit_code": 4})

    def run_spec(*_: Any, **__: Any) -> RunRecord:
        raise RunInterrupted(night)

    monkeypatch.setattr(pipelines, "run_spec", run_spec)
    spec = tmp_path / "s.yaml"
    spec.write_text("version: 1\nname: nightly\nsteps:\n  worlds: {operation: ListWorlds}\n")
    assert robomaker_at_server("run", spec).code == code
