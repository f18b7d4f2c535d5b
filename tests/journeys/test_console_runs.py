"""Runs that visitors of the console order, in real processes that are killed."""

import json
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.processes import wait_for

from prefect_robomaker.deployments.spec_runs.spec_runs import SpecRuns, Standing, StepStanding
from prefect_robomaker.schemas.reports.run_record import Order, RunRecord
from prefect_robomaker.tasks.service.service import Service

pytestmark = [pytest.mark.slow, pytest.mark.deep]
RUN = "long-20260302T010000000"


def process_of(runs: SpecRuns) -> int | None:
    """The process of the run that goes on: a child of ours."""
    for path in Path("/proc").glob("[0-9]*"):
        try:
            command, stat = (path / "cmdline").read_bytes(), (path / "stat").read_text()
        except OSError:
            continue
        if b"ordered_run" in command and int(stat.rpartition(")")[2].split()[1]) == os.getpid():
            return int(path.name)
    return None


@pytest.mark.timeout(900)
def test_a_run_whose_process_is_killed_goes_on_where_it_was(
    service: Service, order: Callable[..., dict[str, Any]], prefect_server: str, tmp_path: Path
) -> None:
    requests = [order({"DURATION_S": duration}) for duration in ("0.1", "4", "0.1")]
    batch = {"createSimulationJobRequests": requests, "batchPolicy": {"maxConcurrency": 1}}
    application = {"name": "late", "robotSoftwareSuite": {"name": "General"}}
    watcher = service.catalog.find("robot-application", "watcher")
    assert watcher is not None
    source = watcher.document["sources"][0]
    application["sources"] = [{"s3Bucket": source["s3Bucket"], "s3Key": source["s3Key"]}]
    steps = {
        "application": {"operation": "CreateRobotApplication", "input": application},  # a second one is refused
        "drive": {"operation": "StartSimulationJobBatch", "input": batch, "needs": ["application"]},
    }
    text = json.dumps({"version": 1, "name": "long", "steps": steps})
    variables = {"ROBOMAKER_HOME": str(service.settings.home), "PREFECT_API_URL": prefect_server}
    runs = SpecRuns(service.settings.home, {**variables, "PREFECT_HOME": str(tmp_path / "prefect")})
    standing = Standing(name="long", steps=[StepStanding(name="drive", operation="StartSimulationJobBatch")])
    runs.begin(Order(run_id=RUN, text=text, filename="long.yaml", spec_path="long.yaml", command=["true"]), standing)

    def statuses() -> list[str]:
        return [job.status for job in reversed(service.catalog.list("simulation-job").resources)]

    wait_for(lambda: statuses() == ["Completed", "Running"], "the second job", timeout_s=120)
    process = process_of(runs)
    assert process is not None
    os.kill(process, signal.SIGKILL)
    wait_for(lambda: not runs.is_going(RUN), "its death")
    before = service.catalog.list("simulation-job").resources

    assert runs.take_up(RUN)
    folder = service.settings.home / "runs" / RUN
    wait_for(lambda: (folder / "run.json").is_file() and not runs.is_going(RUN), "its end", timeout_s=240)

    record = RunRecord.model_validate_json((folder / "run.json").read_text())
    assert (record.state, [step.status for step in record.steps]) == ("succeeded", ["Completed"] * 2), record.steps
    assert statuses() == ["Completed"] * 3
    assert service.catalog.get(before[-1].arn) == before[-1]  # the first was not run again
    assert len(service.catalog.list("simulation-job-batch").resources) == 1
    assert not {"order.json", "answers.jsonl", "running.lock"} & {path.name for path in folder.iterdir()}
