"""What a client of `robomaker serve` waits for, while nothing, sleepers, or real simulations run beside it."""

import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.endpoint_process import Serve, Served
from helpers.processes import wait_for
from helpers.small_flat import ROLE

from prefect_robomaker.tasks.service.service import Service

CALLS = 60
SUBMISSIONS = 8


def _percentiles(samples_s: list[float]) -> str:
    ordered = sorted(samples_s)
    p95 = ordered[round(0.95 * (len(ordered) - 1))]
    return f"p50 {statistics.median(ordered) * 1e3:.1f} ms, p95 {p95 * 1e3:.1f} ms, most {ordered[-1] * 1e3:.1f} ms"


def _create_many(served: Served, request: dict[str, Any]) -> list[float]:
    durations = []
    for _ in range(CALLS):
        began = time.perf_counter()
        served.call("CreateSimulationJob", request)
        durations.append(time.perf_counter() - began)
        time.sleep(0.05)
    return durations


def _submit_to_running(served: Served, request: dict[str, Any]) -> list[float]:
    durations = []
    for _ in range(SUBMISSIONS):
        began = time.perf_counter()
        arn = served.call("CreateSimulationJob", request)["arn"]
        while served.call("DescribeSimulationJob", {"job": arn})["status"] in ("Pending", "Preparing"):
            time.sleep(0.01)
        durations.append(time.perf_counter() - began)
        wait_for(
            lambda arn=arn: served.call("DescribeSimulationJob", {"job": arn})["status"] == "Completed", "the job's end"
        )
    return durations


def _start(served: Served, requests: list[dict[str, Any]]) -> str:
    batch = {"createSimulationJobRequests": requests, "batchPolicy": {"maxConcurrency": 2}}
    arn = served.call("StartSimulationJobBatch", batch)["arn"]

    def runs() -> bool:
        created = served.call("DescribeSimulationJobBatch", {"batch": arn})["createdRequests"]
        return any(job["status"] == "Running" for job in created)

    wait_for(runs, "a running job")
    return arn


def _cancel(service: Service, served: Served, arn: str) -> None:
    service.catalog.request_cancel(arn)
    ended = ("Canceled", "Completed")
    wait_for(lambda: served.call("DescribeSimulationJobBatch", {"batch": arn})["status"] in ended, "the batch's end")


@pytest.mark.benchmark
@pytest.mark.timeout(900)
def test_calls_while_a_batch_runs(
    serve: Serve,
    service: Service,
    order: Callable[..., dict[str, Any]],
    generate: Callable[..., dict[str, Any]],
    prefect_server: str,
    tmp_path: Path,
) -> None:
    (world,) = generate()["finishedWorldsSummary"]["succeededWorlds"]
    drive = {
        "maxJobDurationInSeconds": 300,
        "iamRole": ROLE,
        "robotApplications": [{"application": "scout", "launchConfig": {}}],
        "simulationApplications": [
            {"application": "indoor-navigation", "launchConfig": {}, "worldConfigs": [{"world": world}]}
        ],
    }
    (tmp_path / "drive.json").write_text(json.dumps(drive))
    quick = order({"DURATION_S": "0.1"})
    results = {}
    # Jobs that the calls make wait: single jobs do not run while the batch has the machine.
    with serve("--max-jobs", "1", PREFECT_API_URL=prefect_server) as served:
        served.wait_until_ready()
        waited = _submit_to_running(served, quick)
        results["submit to Running, quiet"] = f"first {waited[0]:.2f} s, then p50 {statistics.median(waited[1:]):.2f} s"
        blocker = served.call("CreateSimulationJob", order({"DURATION_S": "600"}, maxJobDurationInSeconds=700))["arn"]
        results["CreateSimulationJob, quiet"] = _percentiles(_create_many(served, quick))
        for name, request in (("sleepers", order({"DURATION_S": "1"})), ("indoor-navigation", drive)):
            batch = _start(served, [request] * 40)
            results[f"CreateSimulationJob, a batch of {name}"] = _percentiles(_create_many(served, quick))
            _cancel(service, served, batch)
        service.catalog.request_cancel(blocker)
    for name, result in results.items():
        print(f"\n{name}: {result}", end="")
    print()
