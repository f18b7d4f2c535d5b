import time
from collections.abc import Callable
from datetime import timedelta
from typing import Any

import pytest

from prefect_robomaker.flows.operation import call, registry
from prefect_robomaker.tasks.service import Progress, Service

Order = Callable[..., dict[str, Any]]


@pytest.fixture
def run_batch(service: Service, prefect_server: str) -> Callable[..., dict[str, Any]]:
    """Runs a batch to its end and returns its description."""

    def run(requests: list[dict[str, Any]], watcher: Callable[[Progress], None] | None = None, **policy: Any) -> Any:
        request = {"createSimulationJobRequests": requests, "batchPolicy": policy}
        batch = call("StartSimulationJobBatch", request, service)
        watched = service.watched_by(watcher) if watcher else service
        return registry()["StartSimulationJobBatch"].perform(batch["arn"], watched)

    return run


def active_at_once(service: Service, batch: dict[str, Any]) -> int:
    """The most jobs of a batch that ran at the same time, by their own records."""
    spans = []
    for job in batch["createdRequests"]:
        described = call("DescribeSimulationJob", {"job": job["arn"]}, service)
        start = described["lastStartedAt"]
        spans.append((start, start + timedelta(milliseconds=described["simulationTimeMillis"])))
    return max(sum(other[0] <= start < other[1] for other in spans) for start, _ in spans)


def test_a_batch_runs_all_requests_and_never_too_many_at_once(
    service: Service, order: Order, run_batch: Callable[..., dict[str, Any]]
) -> None:
    seen: list[Progress] = []

    batch = run_batch([order({"DURATION_S": "0.5"}) for _ in range(6)], seen.append, maxConcurrency=2)

    assert batch["status"] == "Completed"
    assert [job["status"] for job in batch["createdRequests"]] == ["Completed"] * 6
    assert batch["failedRequests"] == batch["pendingRequests"] == []
    assert active_at_once(service, batch) == 2
    assert seen[-1].total == 6
    assert seen[-1].counts["completed"] == 6


def test_requests_that_cannot_become_jobs_fail_and_the_others_run(
    order: Order, run_batch: Callable[..., dict[str, Any]]
) -> None:
    wrong = order(robotApplications=[{"application": "no-such-robot", "launchConfig": {}}])

    batch = run_batch([order(), wrong, order()], maxConcurrency=2)

    assert batch["status"] == "Completed"
    assert len(batch["createdRequests"]) == 2
    [failed] = batch["failedRequests"]
    assert failed["failureCode"] == "ResourceNotFound"
    assert "no-such-robot" in failed["failureReason"]
    assert failed["request"]["robotApplications"][0]["application"] == "no-such-robot"


def test_jobs_that_fail_do_not_fail_the_batch(order: Order, run_batch: Callable[..., dict[str, Any]]) -> None:
    batch = run_batch([order({"FAIL_AT_STEP": "1"}), order()], maxConcurrency=2)

    assert batch["status"] == "Completed"
    assert [job["status"] for job in batch["createdRequests"]] == ["Failed", "Completed"]


def test_the_timeout_ends_running_jobs_and_waiting_requests(
    service: Service, order: Order, run_batch: Callable[..., dict[str, Any]]
) -> None:
    started = time.monotonic()

    batch = run_batch([order({"DURATION_S": "60"}) for _ in range(3)], maxConcurrency=1, timeoutInSeconds=3)

    assert time.monotonic() - started < 30
    assert batch["status"] == "TimedOut"
    [created] = batch["createdRequests"]
    job = call("DescribeSimulationJob", {"job": created["arn"]}, service)
    assert (job["status"], job["failureCode"]) == ("Canceled", "BatchTimedOut")
    assert [failed["failureCode"] for failed in batch["failedRequests"]] == ["BatchTimedOut"] * 2
    assert batch["pendingRequests"] == []


def test_a_cancelled_batch_starts_nothing(service: Service, order: Order, prefect_server: str) -> None:
    batch = call("StartSimulationJobBatch", {"createSimulationJobRequests": [order()]}, service)
    service.catalog.request_cancel(batch["arn"])

    ended = registry()["StartSimulationJobBatch"].perform(batch["arn"], service)

    assert ended["status"] == "Canceled"
    assert ended["createdRequests"] == []
    assert ended["failedRequests"][0]["failureCode"] == "BatchCanceled"


def test_a_fresh_batch_lists_its_requests_as_pending(service: Service, order: Order) -> None:
    batch = call("StartSimulationJobBatch", {"createSimulationJobRequests": [order(), order()]}, service)

    assert batch["status"] == "Pending"
    assert len(batch["pendingRequests"]) == 2
    assert batch["createdRequests"] == batch["failedRequests"] == []
    assert batch["batchPolicy"] == {"timeoutInSeconds": 1_209_600, "maxConcurrency": 2}


def test_a_performer_that_takes_over_makes_no_job_twice(service: Service, order: Order, prefect_server: str) -> None:
    batch = call("StartSimulationJobBatch", {"createSimulationJobRequests": [order(), order()]}, service)
    perform = registry()["StartSimulationJobBatch"].perform
    # A performer that died after it had made the first job, and before anything else.
    from prefect_robomaker.flows.simulation_job_batches import BatchRun
    from prefect_robomaker.tasks.performing import perform_once

    perform_once(batch["arn"], "simulation-job-batch", service, lambda lease: BatchRun(lease, service).create_job(0))

    ended = perform(batch["arn"], service)

    assert ended["status"] == "Completed"
    assert len(ended["createdRequests"]) == 2
    assert len(service.catalog.list("simulation-job").resources) == 2
