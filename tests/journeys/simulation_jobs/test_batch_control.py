"""Listing and cancelling simulation job batches."""

import threading
from collections.abc import Callable
from typing import Any

import pytest
from helpers.job_worker_process import AwaitStatus
from helpers.processes import wait_for, working_below
from helpers.small_flat import ROLE

from prefect_robomaker.schemas.wire.errors import InvalidParameterException, ResourceNotFoundException
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.execution.leases.leased_runs import run_under_lease
from prefect_robomaker.tasks.jobs.batch_runs import BatchRun
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service

Order = Callable[..., dict[str, Any]]
KIND = "simulation-job-batch"
LONG = {"DURATION_S": "200"}


def plain(**members: Any) -> dict[str, Any]:
    """A request for a job of an application that is always there."""
    config = {"application": "indoor-navigation", "launchConfig": {}}
    return {"maxJobDurationInSeconds": 60, "simulationApplications": [config], **members}


def start(service: Service, *requests: dict[str, Any], **members: Any) -> str:
    """Stores a batch; returns its ARN."""
    return call("StartSimulationJobBatch", {"createSimulationJobRequests": list(requests), **members}, service)["arn"]


def describe(service: Service, arn: str) -> dict[str, Any]:
    return call("DescribeSimulationJobBatch", {"batch": arn}, service)


def make_job(service: Service, batch: str, index: int) -> None:
    """Turns one request of a batch into a job, and leaves it to others."""
    run_under_lease(batch, KIND, service, lambda lease: BatchRun(lease, service).create_job(index))


def test_a_list_counts_what_became_of_the_requests(service: Service) -> None:
    wrong = plain(simulationApplications=[{"application": "no-such", "launchConfig": {}}])
    first = start(service, plain(), wrong, plain())
    make_job(service, first, 0)
    second = start(service, wrong, plain())
    call("CancelSimulationJobBatch", {"batch": second}, service)

    summaries = call("ListSimulationJobBatches", {}, service)["simulationJobBatchSummaries"]

    assert [(entry["arn"], entry["status"]) for entry in summaries] == [(second, "Canceled"), (first, "Pending")]
    counts = ("createdRequestCount", "pendingRequestCount", "failedRequestCount")
    assert [[entry[count] for count in counts] for entry in summaries] == [[0, 0, 2], [1, 2, 0]]
    described = describe(service, first)
    assert summaries[1]["createdAt"] == described["createdAt"]
    assert summaries[1]["lastUpdatedAt"] == described["lastUpdatedAt"]
    answer = call("ListSimulationJobBatches", {"filters": [{"name": "status", "values": ["Pending"]}]}, service)
    assert [entry["arn"] for entry in answer["simulationJobBatchSummaries"]] == [first]
    with pytest.raises(InvalidParameterException, match="'name' is not known; known are status"):
        call("ListSimulationJobBatches", {"filters": [{"name": "name", "values": ["x"]}]}, service)


def test_pages_of_batches_follow_one_another(service: Service) -> None:
    arns = [start(service, plain()) for _ in range(3)]

    page = call("ListSimulationJobBatches", {"maxResults": 2}, service)
    rest = call("ListSimulationJobBatches", {"maxResults": 2, "nextToken": page["nextToken"]}, service)

    both = page["simulationJobBatchSummaries"] + rest["simulationJobBatchSummaries"]
    assert [entry["arn"] for entry in both] == arns[::-1]
    assert "nextToken" not in rest


def test_a_batch_without_a_job_worker_ends_at_once_with_its_jobs(service: Service) -> None:
    arn = start(service, plain(), plain(), plain())
    make_job(service, arn, 0)
    [job] = describe(service, arn)["createdRequests"]

    assert call("CancelSimulationJobBatch", {"batch": arn}, service) == {}

    batch = describe(service, arn)
    assert batch["status"] == "Canceled"
    assert [entry["status"] for entry in batch["createdRequests"]] == ["Canceled"]
    assert batch["pendingRequests"] == []
    assert [entry["failureCode"] for entry in batch["failedRequests"]] == ["BatchCanceled"] * 2
    assert all(entry["failureReason"] and entry["failedAt"] for entry in batch["failedRequests"])
    assert call("DescribeSimulationJob", {"job": job["arn"]}, service)["failureCode"] == "BatchCanceled"
    assert call("CancelSimulationJobBatch", {"batch": arn}, service) == {}
    assert describe(service, arn) == batch


def test_a_batch_that_is_performed_cancels_its_jobs_and_requests(
    service: Service, order: Order, prefect_server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    arn = start(service, *[order(LONG) for _ in range(3)], batchPolicy={"maxConcurrency": 2})
    seen: list[str] = []
    transition = service.catalog.transition

    def noted(resource: str, event: str, **options: Any) -> Resource:
        """Notes each status of the batch: it may be `Canceling` for too short a time to be met by looking."""
        changed = transition(resource, event, **options)
        if resource == arn:
            seen.append(changed.status)
        return changed

    monkeypatch.setattr(service.catalog, "transition", noted)

    def running() -> bool:
        created = describe(service, arn)["createdRequests"]
        return [job["status"] for job in created] == ["Running", "Running"]

    def cancel() -> None:
        wait_for(running, "two running jobs")
        call("CancelSimulationJobBatch", {"batch": arn}, service)

    canceller = threading.Thread(target=cancel)
    canceller.start()
    batch = registry()["StartSimulationJobBatch"].perform(arn, service)
    canceller.join()

    assert "Canceling" in seen
    assert not working_below(service.settings.home)
    assert batch["status"] == "Canceled"
    assert [job["status"] for job in batch["createdRequests"]] == ["Canceled", "Canceled"]
    assert [entry["failureCode"] for entry in batch["failedRequests"]] == ["BatchCanceled"]


def test_a_job_that_somebody_else_performs_is_cancelled_with_its_batch(
    service: Service, order: Order, await_status: AwaitStatus
) -> None:
    arn = start(service, order(LONG, maxJobDurationInSeconds=600), order())
    make_job(service, arn, 0)
    [created] = describe(service, arn)["createdRequests"]
    worker = threading.Thread(target=perform_job, args=(created["arn"], service), daemon=True)
    worker.start()
    await_status(created["arn"], "Running")
    call("CancelSimulationJobBatch", {"batch": arn}, service)
    assert describe(service, arn)["status"] == "Canceling"
    await_status(created["arn"], "Canceled")
    worker.join(200)
    assert not worker.is_alive()

    call("CancelSimulationJobBatch", {"batch": arn}, service)  # no job worker holds the batch: this call ends it

    assert describe(service, arn)["status"] == "Canceled"


def test_a_request_without_a_role_becomes_a_job(service: Service) -> None:
    arn = start(service, plain(useDefaultApplications=True), plain(iamRole=ROLE, outputLocation={}))
    make_job(service, arn, 0)
    make_job(service, arn, 1)

    [first, second] = describe(service, arn)["createdRequests"]

    assert "iamRole" not in call("DescribeSimulationJob", {"job": first["arn"]}, service)
    assert call("DescribeSimulationJob", {"job": second["arn"]}, service)["iamRole"] == ROLE


def test_a_batch_of_a_thousand_requests_is_stored_described_and_cancelled(service: Service) -> None:
    arn = start(service, *[plain(tags={"number": str(number)}) for number in range(1000)])
    batch = describe(service, arn)
    assert [request["tags"]["number"] for request in batch["pendingRequests"]] == [str(n) for n in range(1000)]
    call("CancelSimulationJobBatch", {"batch": arn}, service)
    assert len(describe(service, arn)["failedRequests"]) == 1000


@pytest.mark.parametrize("operation", ["CancelSimulationJobBatch", "DescribeSimulationJobBatch"])
def test_a_batch_that_does_not_exist_is_not_found(service: Service, operation: str) -> None:
    with pytest.raises(ResourceNotFoundException, match="batch-000000000000"):
        call(operation, {"batch": service.arn(KIND, "batch-000000000000")}, service)


@pytest.mark.parametrize(
    ("event", "code", "status"), [("cancel", "BatchCanceled", "Canceled"), ("time_out", "BatchTimedOut", "TimedOut")]
)
def test_a_batch_that_was_being_stopped_when_its_worker_died_is_ended(
    service: Service, prefect_server: str, event: str, code: str, status: str
) -> None:
    arn = start(service, plain(), plain())
    service.catalog.transition(arn, "start")
    make_job(service, arn, 0)
    service.catalog.transition(arn, event)

    ended = registry()["StartSimulationJobBatch"].perform(arn, service)

    assert ended["status"] == status
    assert [job["status"] for job in ended["createdRequests"]] == ["Canceled"]
    assert [failed["failureCode"] for failed in ended["failedRequests"]] == [code]
    [job] = ended["createdRequests"]
    assert call("DescribeSimulationJob", {"job": job["arn"]}, service)["failureCode"] == code
