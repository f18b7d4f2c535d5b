"""A step of axes, run for real: rows say their cells, values are compared in pairs, and nothing else is one."""

import json
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from helpers.command_here import Command
from helpers.paths import REPOSITORY

from prefect_robomaker.schemas.reports.report import ReportSummary
from prefect_robomaker.schemas.reports.run_record import RunRecord

BUNDLE = REPOSITORY / "deployments" / "specs" / "examples" / "cartpole_bundle"
SUITE = {"name": "General"}

pytestmark = pytest.mark.deep


def spec(request: dict[str, Any], **axes: Any) -> dict[str, Any]:
    value = {
        "maxJobDurationInSeconds": 60,
        "robotApplications": [
            {"application": "agent", "launchConfig": {"environmentVariables": {"GAIN": "${{ gain }}"}}}
        ],
        "simulationApplications": [
            {"application": "arena", "launchConfig": {"environmentVariables": {"TIME_LIMIT_S": "2"}}}
        ],
        **request,
    }
    arena = {
        "name": "arena", "environment": {"uri": "python://my_cartpole.arena"}, "robotSoftwareSuite": SUITE,
        "simulationSoftwareSuite": {"name": "SimulationRuntime"},
    }  # fmt: skip
    agent = {"name": "agent", "environment": {"uri": "python://my_cartpole.agent"}, "robotSoftwareSuite": SUITE}
    requests = {"axes": {"gain": {"values": ["1", "-1"]}}, **axes, "value": value}
    balance = {"createSimulationJobRequests": requests, "batchPolicy": {"maxConcurrency": 2}}
    steps = {
        "arena": {"operation": "CreateSimulationApplication", "input": arena, "ifExists": "reuse"},
        "agent": {"operation": "CreateRobotApplication", "input": agent, "ifExists": "reuse"},
        "balance": {"operation": "StartSimulationJobBatch", "needs": ["arena", "agent"], "input": balance},
    }
    return {"version": 1, "name": "gains", "steps": steps}


@pytest.fixture
def robomaker(robomaker_at_server: Command, monkeypatch: pytest.MonkeyPatch) -> Command:
    """Runs the command where the robot can be imported: by itself, and by the processes that it starts."""
    monkeypatch.setenv("PYTHONPATH", str(BUNDLE))
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    monkeypatch.syspath_prepend(str(BUNDLE))
    return robomaker_at_server


def carried_out(robomaker: Command, folder: Path, written: dict[str, Any]) -> tuple[RunRecord, ReportSummary]:
    path = folder / "gains.yaml"
    path.write_text(json.dumps(written))
    record = RunRecord.model_validate_json(robomaker("run", path, "-o", "json").out)
    return record, ReportSummary.model_validate_json(robomaker("report", record.run_id, "-o", "json").out)


def test_a_worse_gain_is_found_within_one_run(robomaker: Command, tmp_path: Path) -> None:
    record, summary = carried_out(robomaker, tmp_path, spec({}, seeds=12))

    assert [(job.axes, job.inputs and job.inputs.seed) for job in record.jobs] == [
        ({"gain": gain}, seed) for gain in ("1", "-1") for seed in range(12)
    ]
    rows = pq.read_table(record.run_dir / "results.parquet").select(["axis.gain", "seed", "outcome"]).to_pylist()
    assert [(row["axis.gain"], row["outcome"]) for row in rows] == [("1", "passed")] * 12 + [("-1", "failed")] * 12
    [axis] = summary.axes
    assert [(share.name, share.rate) for share in axis.shares] == [("1", 1.0), ("-1", 0.0)]
    [found] = axis.comparisons
    assert (found.answer, found.pairs, found.unpaired, found.same_states) == ("worse", 12, 0, False)
    assert summary.why is not None
    assert [claim.region for group in summary.why.groups for claim in group.claims] == ["gain = -1"]
    assert [(each.axis, each.answer.partition(",")[0]) for each in summary.effects] == [("gain", "changes failures")]
    page = (record.run_dir / "report.html").read_text()
    assert "passes less often" in page
    assert "-1 instead of 1" in page
    assert "What depends on which axis" in page


def test_trials_of_jobs_are_the_pairs(robomaker: Command, tmp_path: Path) -> None:
    record, summary = carried_out(robomaker, tmp_path, spec({"trials": {"seeds": 5, "record_failed": 0}}, seeds=2))

    seeds = pq.read_table(record.run_dir / "results.parquet")["seed"].to_pylist()
    assert seeds == [*range(10), *range(10)]
    [found] = summary.axes[0].comparisons
    assert (found.answer, found.pairs, found.unpaired) == ("worse", 10, 0)
