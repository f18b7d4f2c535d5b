"""What a run costs that finds everything: CPU time of the command's process beyond that of a run with nothing to do."""

import json
import time
from pathlib import Path
from statistics import median
from typing import Any

import pytest
from helpers.small_flat import BODY, ROLE
from helpers.swing_fixtures import SUITE, upload_swinger

from prefect_robomaker.flows.pipelines import run_spec
from prefect_robomaker.schemas.reports.progress import ProgressEvent
from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.tasks.inspection.reuse_plans import plan_reuse
from prefect_robomaker.tasks.nights.wanted_runs import WantedRun
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

ROUNDS = 5
TEMPLATE = {"operation": "CreateWorldTemplate", "input": {"name": "flat", "templateBody": BODY}}
WORLDS = {
    "operation": "CreateWorldGenerationJob",
    "input": {
        "template": "${{ template.arn }}",
        "worldCount": {"floorplanCount": 2, "interiorCountPerFloorplan": 2},
        "seed": 7,
    },
}
DRIVE = {
    "maxJobDurationInSeconds": 300,
    "seed": 1,
    "robotApplications": [{"application": "scout", "launchConfig": {}}],
    "simulationApplications": [
        {"application": "indoor-navigation", "launchConfig": {}, "worldConfigs": [{"world": "${{ world }}"}]}
    ],
}
SWING = {
    "maxJobDurationInSeconds": 60,
    "iamRole": ROLE,
    "robotApplications": [
        {"application": "pusher", "launchConfig": {"packageName": "swinger", "launchFile": "make_agent"}}
    ],
    "simulationApplications": [
        {
            "application": "swing",
            "launchConfig": {
                "packageName": "swinger",
                "launchFile": "make_environment",
                "environmentVariables": {"TIME_LIMIT_S": "0.2"},
            },
        }
    ],
}


def batch(requests: Any) -> dict[str, Any]:
    return {
        "operation": "StartSimulationJobBatch",
        "input": {"createSimulationJobRequests": requests, "batchPolicy": {"maxConcurrency": 2}},
    }


FLATS = {
    "template": TEMPLATE,
    "worlds": WORLDS,
    "drive": batch({"forEach": "${{ worlds.finishedWorldsSummary.succeededWorlds }}", "as": "world", "value": DRIVE}),
}
SWINGS = {"swing": batch([{**SWING, "seed": seed} for seed in range(100)])}


def ignore(event: ProgressEvent) -> None:
    """Nobody watches."""


@pytest.mark.benchmark
@pytest.mark.timeout(1200)
@pytest.mark.parametrize(("what", "steps"), [("4 worlds, 4 jobs", FLATS), ("100 jobs", SWINGS)])
def test_a_run_that_finds_everything(
    what: str, steps: dict[str, Any], settings: Settings, service: Service, prefect_server: str, tmp_path: Path
) -> None:
    upload_swinger(service, tmp_path)
    source = [{"s3Bucket": "applications", "s3Key": "swinger.tar.gz"}]
    request = {"sources": source, "robotSoftwareSuite": SUITE}
    call("CreateRobotApplication", {"name": "pusher", **request}, service)
    runtime = {"name": "SimulationRuntime"}
    call("CreateSimulationApplication", {"name": "swing", **request, "simulationSoftwareSuite": runtime}, service)

    def spent(each: dict[str, Any], *, reuse: bool) -> tuple[float, float, RunRecord]:
        checked = load_spec(json.dumps({"version": 1, "name": "bench", "steps": each}), "bench.yaml")
        started, began = time.process_time(), time.perf_counter()
        record = run_spec(WantedRun(checked, "bench.yaml", reuse=reuse), settings, ignore)
        return time.process_time() - started, time.perf_counter() - began, record

    _, ran_s, first = spent(steps, reuse=False)
    assert first.exit_code == 0
    empty, full, wall = [], [], []
    for _ in range(ROUNDS):
        empty.append(spent({"template": TEMPLATE}, reuse=True)[0])
        cpu_s, wall_s, record = spent(steps, reuse=True)
        assert all(job.reused_from for job in record.jobs)
        assert len(record.jobs) == len(first.jobs)
        full.append(cpu_s)
        wall.append(wall_s)
    checked = load_spec(json.dumps({"version": 1, "name": "bench", "steps": steps}), "bench.yaml")
    started = time.process_time()
    parts = plan_reuse(checked, service)
    plan_s = time.process_time() - started

    assert all(part.reuse for each in parts.values() for part in each)
    print(
        f"\n{what}: first run {ran_s:.1f} s, with --reuse {median(wall):.1f} s; "
        f"CPU {median(full):.2f} s, of a run of one quick step {median(empty):.2f} s: "
        f"{median(full) - median(empty):.2f} s of work; plan --reuse {plan_s:.2f} s CPU"
    )
