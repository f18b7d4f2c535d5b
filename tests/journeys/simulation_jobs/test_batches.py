import threading
import time
from collections.abc import Callable
from datetime import timedelta
from typing import Any

import pytest

from prefect_robomaker.schemas.documents.simulation_jobs import BatchProgress, FailedRequest
from prefect_robomaker.schemas.lifecycles import ACTIVE
from prefect_robomaker.schemas.wire.errors import InternalServerException
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.execution.leases.leased_runs import run_under_lease
from prefect_robomaker.tasks.jobs import batch_runs
from prefect_robomaker.tasks.jobs.batch_runs import BatchRun
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Progress, Service

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

    batch = run_batch([order({"DURATION_S": "0.5"}) for _ in range(4)], seen.append, maxConcurrency=2)

    assert batch["status"] == "Completed"
    assert [job["status"] for job in batch["createdRequests"]] == ["Completed"] * 4
    assert batch["failedRequests"] == batch["pendingRequests"] == []
    assert active_at_once(service, batch) == 2
    assert seen[-1].total == 4
    assert seen[-1].counts == {"no verdict": 4}
    assert {sum(progress.counts.values()) for progress in seen} == {4}


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


def test_stored_requests_that_an_older_release_took_are_read_and_the_others_run(
    service: Service, order: Order, prefect_server: str
) -> None:
    request = {"createSimulationJobRequests": [order(), order(), order()], "batchPolicy": {"maxConcurrency": 2}}
    arn = call("StartSimulationJobBatch", request, service)["arn"]
    stored = service.catalog.get(arn).document["request"]
    requests = stored["createSimulationJobRequests"]
    # Trials of programs were once refused only when their job was prepared.
    requests[1]["trials"] = {"seeds": 3}
    requests[1]["simulationApplications"][0]["launchConfig"] |= {"command": ["bin/arena"]}
    service.catalog.update(arn, lambda document: {**document, "request": stored})

    batch = registry()["StartSimulationJobBatch"].perform(arn, service)

    assert batch["status"] == "Completed"
    assert [job["status"] for job in batch["createdRequests"]] == ["Completed", "Failed", "Completed"]
    # One that could not even become a job is told as it was stored.
    failed = {"1": FailedRequest(failure_code="InvalidInput", failure_reason="", failed_at="2026-01-01T00:00:00+00:00")}
    service.catalog.update(arn, BatchProgress(failed=failed, failed_count=1))
    [told] = call("DescribeSimulationJobBatch", {"batch": arn}, service)["failedRequests"]
    assert told["request"]["trials"]["seeds"] == 3


def test_jobs_that_fail_do_not_fail_the_batch(order: Order, run_batch: Callable[..., dict[str, Any]]) -> None:
    batch = run_batch([order({"FAIL_AT_STEP": "1"}), order()], maxConcurrency=2)

    assert batch["status"] == "Completed"
    assert [job["status"] for job in batch["createdRequests"]] == ["Failed", "Completed"]


def test_the_timeout_ends_running_jobs_and_waiting_requests(
    service: Service, order: Order, run_batch: Callable[..., dict[str, Any]]
) -> None:
    batch = run_batch(
        [order({"DURATION_S": "600"}, maxJobDurationInSeconds=600) for _ in range(3)],
        maxConcurrency=1,
        timeoutInSeconds=12,
    )

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


def test_a_worker_that_takes_over_makes_no_job_twice(service: Service, order: Order, prefect_server: str) -> None:
    batch = call("StartSimulationJobBatch", {"createSimulationJobRequests": [order(), order()]}, service)
    perform = registry()["StartSimulationJobBatch"].perform
    # A job worker that died after it had made the first job, and before anything else.
    run_under_lease(batch["arn"], "simulation-job-batch", service, lambda lease: BatchRun(lease, service).create_job(0))

    ended = perform(batch["arn"], service)

    assert ended["status"] == "Completed"
    assert len(ended["createdRequests"]) == 2
    assert len(service.catalog.list("simulation-job").resources) == 2


def test_a_batch_is_completing_while_its_last_jobs_run(
    service: Service, order: Order, run_batch: Callable[..., dict[str, Any]]
) -> None:
    seen: list[tuple[str, bool]] = []
    ended = threading.Event()

    def look() -> None:
        while not ended.wait(0.05):
            for batch in service.catalog.list("simulation-job-batch").resources:
                active = any(is_active(job) for job in service.catalog.children(batch.arn, kind="simulation-job"))
                seen.append((batch.status, active))

    watcher = threading.Thread(target=look)
    watcher.start()
    batch = run_batch([order({"DURATION_S": "3"})], maxConcurrency=1)
    ended.set()
    watcher.join()

    assert batch["status"] == "Completed"
    assert ("Completing", True) in seen


def is_active(job: Resource) -> bool:
    return job.status in ACTIVE


def test_requests_that_are_all_refused_cost_no_task_run(
    order: Order, run_batch: Callable[..., dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(batch_runs, "run_tasks", lambda *_, **__: pytest.fail("a task run"))
    wrong = order(robotApplications=[{"application": "no-such-robot", "launchConfig": {}}])

    batch = run_batch([wrong] * 100, maxConcurrency=2)

    assert batch["status"] == "Completed"
    assert "failureCode" not in batch
    assert {failed["failureCode"] for failed in batch["failedRequests"]} == {"ResourceNotFound"}


def test_an_internal_fault_fails_the_batch_and_the_other_jobs_run(
    service: Service, order: Order, run_batch: Callable[..., dict[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    def break_down(*arguments: Any) -> None:
        raise InternalServerException("the data sources' server is upside down")

    monkeypatch.setattr("prefect_robomaker.tasks.simulations.stored_jobs.resolve_data_sources", break_down)
    batch = run_batch([order(), order()], maxConcurrency=1)

    assert (batch["status"], batch["failureCode"]) == ("Failed", "InternalServiceError")
    assert [failed["failureCode"] for failed in batch["failedRequests"]] == ["InternalServiceError"] * 2
    assert "upside down" in batch["failedRequests"][0]["failureReason"]


def test_a_batch_whose_time_was_up_before_anybody_performed_it_is_timed_out(
    service: Service, order: Order, prefect_server: str
) -> None:
    request = {"createSimulationJobRequests": [order(), order()], "batchPolicy": {"timeoutInSeconds": 1}}
    batch = call("StartSimulationJobBatch", request, service)
    time.sleep(1.1)

    ended = registry()["StartSimulationJobBatch"].perform(batch["arn"], service)

    assert ended["status"] == "TimedOut"
    assert [failed["failureCode"] for failed in ended["failedRequests"]] == ["BatchTimedOut"] * 2


def test_a_batch_that_is_timing_out_cannot_be_cancelled_any_more(
    service: Service, order: Order, prefect_server: str
) -> None:
    batch = call("StartSimulationJobBatch", {"createSimulationJobRequests": [order()]}, service)
    service.catalog.transition(batch["arn"], "time_out")
    service.catalog.request_cancel(batch["arn"])

    ended = registry()["StartSimulationJobBatch"].perform(batch["arn"], service)

    assert ended["status"] == "TimedOut"
    assert ended["failedRequests"][0]["failureCode"] == "BatchTimedOut"


def test_a_job_that_exists_already_does_not_fail_when_its_application_is_gone(
    service: Service, order: Order, prefect_server: str
) -> None:
    batch = call("StartSimulationJobBatch", {"createSimulationJobRequests": [order()]}, service)
    run_under_lease(batch["arn"], "simulation-job-batch", service, lambda lease: BatchRun(lease, service).create_job(0))
    robot = service.catalog.find("robot-application", "watcher")
    assert robot is not None
    service.catalog.delete(robot.arn)

    ended = registry()["StartSimulationJobBatch"].perform(batch["arn"], service)

    assert ended["failedRequests"] == []
    [job] = ended["createdRequests"]
    described = call("DescribeSimulationJob", {"job": job["arn"]}, service)
    assert (described["status"], described["failureCode"]) == ("Failed", "ResourceNotFound")


def test_a_batch_whose_jobs_end_outlives_any_number_of_dead_workers(
    service: Service, order: Order, prefect_server: str
) -> None:
    requests = [order(), order()]
    batch = call("StartSimulationJobBatch", {"createSimulationJobRequests": requests}, service)["arn"]
    run_under_lease(batch, "simulation-job-batch", service, lambda lease: BatchRun(lease, service).create_job(0))
    service.catalog.transition(batch, "start")
    [job] = service.catalog.children(batch, kind="simulation-job")
    call("CancelSimulationJob", {"job": job.arn}, service)
    for number in range(9):  # one more ends it
        assert service.catalog.claim(batch, f"dies-{number}", -1)

    ended = registry()["StartSimulationJobBatch"].perform(batch, service)

    assert ended["status"] == "Completed"
    assert service.catalog.lost_workers(batch) == 0
