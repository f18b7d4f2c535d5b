"""Handlers of operations on simulation job batches: many jobs, of which at most `maxConcurrency` run at once."""

from typing import Any

from ...schemas.documents.simulation_jobs import BatchCounts, SimulationJobBatchDocument, StoredBatchPolicy
from ...schemas.operations.registry import priority_of
from ...schemas.operations.simulation_job_batches import (
    CancelSimulationJobBatchRequest,
    DescribeSimulationJobBatchRequest,
    ListSimulationJobBatchesRequest,
    StartSimulationJobBatchRequest,
)
from ...schemas.runs.requirements import rooms_asked
from ..catalog import ClientToken, Resource
from ..execution.leases.leased_runs import run_if_unclaimed, run_under_lease
from ..jobs.batch_runs import BatchRun, jobs_by_request
from ..service.service import Service
from ..simulations.inputs.bundles import check_rooms
from ..simulations.planning.run_plans import world_arn
from .registry import Answer, operation, page_of
from .simulation_jobs import summary

KIND = "simulation-job-batch"
MAX_TIMEOUT_S = 1_209_600


def perform_simulation_job_batch(arn: str, service: Service) -> None:
    """Runs a simulation job batch: makes jobs of its requests, runs them, and sets the batch's final status.

    Blocks until the batch has ended, also if another process runs it.
    """
    run_under_lease(arn, KIND, service, lambda lease: BatchRun(lease, service).run())


@operation("StartSimulationJobBatch", perform=perform_simulation_job_batch)
def start_simulation_job_batch(request: StartSimulationJobBatchRequest, service: Service) -> Answer:
    """Handles `StartSimulationJobBatch`: stores a batch; its requests become jobs when the batch runs.

    Returns the description of the new batch, or of the one that a request with the same client token has stored. A
    limit that the request omits gets the default: the longest timeout, and this machine's number of jobs at once.
    """
    _check_rooms(request, service)
    policy = request.batchPolicy.to_wire() if request.batchPolicy else {}
    batch = service.store_job(
        KIND,
        "batch",
        SimulationJobBatchDocument(
            request=request.to_wire(),
            batch_policy=StoredBatchPolicy(
                timeout_in_seconds=policy.get("timeoutInSeconds", MAX_TIMEOUT_S),
                max_concurrency=policy.get("maxConcurrency", service.settings.max_jobs),
                priority=priority_of(request),
            ),
            failed={},
            request_count=len(request.createSimulationJobRequests),
            failed_count=0,
            spec_run=service.spec_run.run_id if service.spec_run else None,
            reuse=service.reuses,
            in_campaign=service.spec_run is not None and service.spec_run.in_campaign,
            mixed=service.spec_run is not None and service.spec_run.mixed,
        ),
        tags=request.tags,
        token=ClientToken.of("StartSimulationJobBatch", request),
    )
    answer = _described(batch, service)
    del answer["lastUpdatedAt"]
    return answer


@operation("DescribeSimulationJobBatch")
def describe_simulation_job_batch(request: DescribeSimulationJobBatchRequest, service: Service) -> Answer:
    """Handles `DescribeSimulationJobBatch`: returns the batch with its created, pending and failed requests."""
    batch = service.catalog.get(request.batch, kind=KIND)
    return _described(batch, service)


@operation("ListSimulationJobBatches")
def list_simulation_job_batches(request: ListSimulationJobBatchesRequest, service: Service) -> Answer:
    """Handles `ListSimulationJobBatches`: returns a page of batches with their numbers of requests by state."""
    page = page_of(request, KIND, service, "status", members=BatchCounts.members())
    created = service.catalog.count_each([batch.arn for batch in page.resources], "simulation-job")
    return {
        "simulationJobBatchSummaries": [_summary(batch, created.get(batch.arn, 0)) for batch in page.resources],
        "nextToken": page.next_token,
    }


@operation("CancelSimulationJobBatch")
def cancel_simulation_job_batch(request: CancelSimulationJobBatchRequest, service: Service) -> Answer:
    """Handles `CancelSimulationJobBatch`: cancels a batch and its jobs, at once or through its job worker.

    A running batch is cancelled as soon as its job worker notices. Cancelling one that has ended changes nothing and
    succeeds.
    """
    service.catalog.get(request.batch, kind=KIND)
    service.catalog.request_cancel(request.batch)
    run_if_unclaimed(request.batch, KIND, service, lambda lease: BatchRun(lease, service).end())
    return {}


def _check_rooms(request: StartSimulationJobBatchRequest, service: Service) -> None:
    """Raises an error for goals in rooms that do not exist.

    If the world itself is missing, its request fails later, as it does without goals.
    """
    requests = {
        index: (job_request, world)
        for index, job_request in enumerate(request.createSimulationJobRequests)
        if rooms_asked(job_request) and (world := world_arn(job_request.to_wire())) is not None
    }
    worlds = service.catalog.get_many({world for _, world in requests.values()})
    for index, (job_request, arn) in requests.items():
        if arn in worlds:
            check_rooms(job_request, worlds[arn], service, f"createSimulationJobRequests[{index}].")


def _summary(batch: Resource, created: int) -> dict[str, Any]:
    counts = BatchCounts.of_members(batch)
    return {
        "arn": batch.arn,
        "lastUpdatedAt": batch.updated_at,
        "createdAt": batch.created_at,
        "status": batch.status,
        "failedRequestCount": counts.failed_count,
        "pendingRequestCount": counts.request_count - counts.failed_count - created,
        "createdRequestCount": created,
    }


def _described(batch: Resource, service: Service) -> dict[str, Any]:
    document = SimulationJobBatchDocument.of(batch)
    requests, failed = document.requests, document.failed
    jobs = jobs_by_request(batch, service)
    return {
        "arn": batch.arn,
        "status": batch.status,
        "lastUpdatedAt": batch.updated_at,
        "createdAt": batch.created_at,
        "clientRequestToken": document.request.get("clientRequestToken"),
        "batchPolicy": document.batch_policy.to_json(),
        "failureCode": document.failure_code,
        "failureReason": document.failure_reason,
        "failedRequests": [
            {"request": requests[int(index)], **failure.to_json(), "failedAt": failure.time}
            for index, failure in sorted(failed.items(), key=lambda item: int(item[0]))
        ],
        "pendingRequests": [
            request for index, request in enumerate(requests) if index not in jobs and str(index) not in failed
        ],
        "createdRequests": [summary(job) for _, job in sorted(jobs.items())],
        "tags": dict(batch.tags),
    }
