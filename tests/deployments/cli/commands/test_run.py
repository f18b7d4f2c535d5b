"""run and report: real runs against the test run's Prefect server, and what is said at their ends."""

import json
import os
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.deployments.cli.output.browser import wanted
from prefect_robomaker.deployments.cli.output.durations import duration
from prefect_robomaker.deployments.cli.output.summary import summary_lines
from prefect_robomaker.schemas.reports.run_record import JobRecord, RunRecord, StepRecord

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
        return subprocess.run(command, env=environ, capture_output=True, text=True, check=False, timeout=120)

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


def test_a_step_that_fails_ends_the_run_with_3(run, spec) -> None:
    ended = run("run", spec(FAILING), "-o", "json")
    assert ended.returncode == 3, ended.stderr
    record = RunRecord.model_validate_json(ended.stdout)
    assert [(step.name, step.status) for step in record.steps] == [("world", "Failed"), ("after", "Skipped")]
    assert (record.state, record.exit_code, record.schema_version) == ("broken", 3, 1)
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


# The final block


def record(**changes: Any) -> RunRecord:
    began = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
    jobs = [
        JobRecord(
            label="sim-1", arn="arn:1", status="Completed", verdict="PASS", world="g/world-1", rooms_visited=4,
            rooms_total=4, duration_s=31, output_uri="file:///store/robomaker/quickstart/sim-1/run-1",
        ),
        JobRecord(
            label="sim-2", arn="arn:2", status="Failed", failure_code="RobotApplicationCrash",
            failure_reason="it crashed\nLast lines of logs/stderr.log:\nTraceback\nno x", output_uri="file:///store/robomaker/quickstart/sim-2/run-1",
        ),
        JobRecord(label="request 3", status="NotCreated", failure_code="InvalidInput", failure_reason="no role"),
    ]  # fmt: skip
    values: dict[str, Any] = {
        "run_id": "night-1",
        "name": "night",
        "spec_path": "night.yaml",
        "state": "broken",
        "exit_code": 3,
        "started_at": began,
        "ended_at": began + timedelta(seconds=185),
        "steps": [StepRecord(name="export", operation="CreateWorldExportJob", status="Failed", error="no bucket")],
        "jobs": jobs,
        "report_path": Path("/runs/night-1/report.html"),
        "run_dir": Path("/runs/night-1"),
    }
    return RunRecord.model_validate(values | changes)


def lines(shown: RunRecord) -> list[str]:
    command = ["robomaker", "run", "my spec.yaml"]
    return ["".join(text for text, _ in line) for line in summary_lines(shown, command)]


def test_what_jobs_had_to_do_without_is_said_once() -> None:
    wish = "no camera in the recording: ROBOMAKER_RECORD_CAMERA: there is no camera 'frnt'"
    first, second, third = record().jobs
    jobs = [first.model_copy(update={"remarks": [wish, "no video: no driver"]}), second, third]
    assert lines(record(jobs=jobs))[9:12] == [f"  sim-1: {wish}", "  sim-1: no video: no driver", ""]
    jobs[1] = second.model_copy(update={"remarks": [wish]})
    assert lines(record(jobs=jobs))[9:12] == [f"  2 jobs: {wish}", "  sim-1: no video: no driver", ""]


def test_the_final_block() -> None:
    assert lines(record()) == [
        "",
        "night: broken, 1 of 1 verdicts pass, 2 broke, after 3 min 05 s",
        "",
        "  ✗ export (CreateWorldExportJob): no bucket",
        "",
        "  job        verdict     world      rooms  time",
        "  sim-1      PASS        g/world-1  4/4    31 s",
        "  sim-2      Failed                              RobotApplicationCrash: it crashed; its log ends with: no x",
        "  request 3  NotCreated                          InvalidInput: no role",
        "",
        "  report   /runs/night-1/report.html",
        "  outputs  file:///store/robomaker/quickstart",
        "  record   /runs/night-1/run.json",
        "  again    robomaker run 'my spec.yaml'",
    ]


def test_the_final_block_of_a_run_without_jobs() -> None:
    shown = lines(record(jobs=[], steps=[], state="succeeded", exit_code=0))
    assert shown[1] == "night: succeeded after 3 min 05 s"
    assert not any("outputs" in line or "verdict" in line for line in shown)


def test_what_was_cut_short_has_no_verdict_and_long_reasons_are_cut() -> None:
    jobs = [
        JobRecord(label="sim-1", status="Canceled", verdict="NONE"),
        JobRecord(label="sim-2", status="Failed", failure_reason="it crashed: KeyError\nLast lines of x:\nKeyError"),
        JobRecord(label="sim-3", status="Failed", failure_reason="x" * 1000),
    ]
    shown = lines(record(jobs=jobs, steps=[]))
    assert shown[1] == "night: broken, 2 broke, 1 canceled, after 3 min 05 s"
    assert [line.split() for line in shown[4:6]] == [
        ["sim-1", "Canceled"],
        ["sim-2", "Failed", "it", "crashed:", "KeyError"],
    ]
    assert shown[6].endswith("xxx…")
    assert len(shown[6]) < 300


def test_a_large_batch_does_not_flood_the_terminal() -> None:
    jobs = [JobRecord(label=f"sim-{number}", status="Completed", verdict="PASS") for number in range(1000)]
    shown = lines(record(jobs=jobs))
    assert len(shown) < 60
    assert any("… and 960 more" in line for line in shown)


def test_records_survive_being_written() -> None:
    assert RunRecord.model_validate_json(record().model_dump_json(exclude_none=True)) == record()
    assert json.loads(record().model_dump_json())["started_at"] == "2026-01-02T03:04:05Z"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.04, "0.0 s"), (9.94, "9.9 s"), (9.96, "10 s"), (59.4, "59 s"), (59.6, "1 min"), (185, "3 min 05 s"),
     (3600, "1 h"), (7800, "2 h 10 min")],
)  # fmt: skip
def test_durations(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_a_browser_opens_only_for_somebody_at_a_desktop(monkeypatch) -> None:
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    assert wanted(None, {"DISPLAY": ":0"})
    assert not wanted(None, {})
    assert not wanted(None, {"DISPLAY": ":0", "SSH_CONNECTION": "x"})
    assert not wanted(None, {"DISPLAY": ":0", "CI": "true"})
    assert wanted(True, {})
    assert not wanted(False, {"DISPLAY": ":0"})
