"""Handlers of operations on world export jobs, which pack worlds into one archive."""

from collections.abc import Sequence
from typing import Any

from ...schemas.documents.worlds import WorldExportJobDocument, WorldExportRequest
from ...schemas.operations.world_export_jobs import (
    CancelWorldExportJobRequest,
    CreateWorldExportJobRequest,
    DescribeWorldExportJobRequest,
    ListWorldExportJobsRequest,
)
from ...schemas.wire.errors import (
    InvalidParameterException,
)
from ..catalog import ClientToken, Resource
from ..execution.leases.leased_runs import run_under_lease
from ..jobs.world_jobs import cancel_world_job, run_export
from ..service.service import Service
from ..simulations.outputs.output_places import check_output_location
from .registry import Answer, operation, page_of

KIND = "world-export-job"
_ORIGINS = ("generationJobId", "templateId")
"""Names of catalog labels that an export job takes over from its worlds."""


def perform_world_export_job(arn: str, service: Service) -> None:
    """Runs a world export job: packs its worlds into an archive, stores it, and sets the job's final status.

    Blocks until the job has ended, also if another process runs it.
    """
    run_under_lease(arn, KIND, service, lambda lease: run_export(lease, service))


@operation("CreateWorldExportJob", perform=perform_world_export_job)
def create_world_export_job(request: CreateWorldExportJobRequest, service: Service) -> Answer:
    """Handles `CreateWorldExportJob`: stores an export job for existing worlds, and returns its description.

    A request with a known client token returns the job that it has stored before. The job is not run here.
    """
    token = ClientToken.of("CreateWorldExportJob", request)
    answer = _described(service.find_by_client_token(token) or _stored(request, token, service))
    del answer["worlds"], answer["failureReason"]
    return answer


def _stored(request: CreateWorldExportJobRequest, token: ClientToken | None, service: Service) -> Resource:
    if request.outputLocation.s3Bucket is None:
        raise InvalidParameterException("outputLocation.s3Bucket: has to be given; the archive is put there")
    check_output_location(request.outputLocation.to_wire())
    worlds = [service.catalog.get(world, kind="world") for world in request.worlds]
    return service.store_job(
        KIND,
        "export",
        WorldExportJobDocument(request=WorldExportRequest.model_validate(request.to_wire())),
        tags=request.tags,
        token=token,
        labels={origin: _labels(worlds, origin) for origin in _ORIGINS},
    )


def _labels(worlds: Sequence[Resource], key: str) -> list[str]:
    return list(dict.fromkeys(value for world in worlds for value in world.labels.get(key, ())))


@operation("ListWorldExportJobs")
def list_world_export_jobs(request: ListWorldExportJobsRequest, service: Service) -> Answer:
    """Handles `ListWorldExportJobs`: returns a page of export jobs, newest first, and a token for the next page."""
    page = page_of(request, KIND, service, "status", *_ORIGINS)
    return {"worldExportJobSummaries": [_summary(job) for job in page.resources], "nextToken": page.next_token}


@operation("CancelWorldExportJob")
def cancel_world_export_job(request: CancelWorldExportJobRequest, service: Service) -> Answer:
    """Handles `CancelWorldExportJob`: cancels an export job; no archive is left.

    A running job is cancelled as soon as its job worker notices. Cancelling one that has ended changes nothing and
    succeeds.
    """
    cancel_world_job(request.job, KIND, service, lambda lease: run_export(lease, service))
    return {}


@operation("DescribeWorldExportJob")
def describe_world_export_job(request: DescribeWorldExportJobRequest, service: Service) -> Answer:
    """Handles `DescribeWorldExportJob`: returns the description of an export job."""
    return _described(service.catalog.get(request.job, kind=KIND))


def _summary(job: Resource) -> dict[str, Any]:
    described = _described(job)
    return {member: described[member] for member in ("arn", "status", "createdAt", "worlds", "outputLocation")}


def _described(job: Resource) -> dict[str, Any]:
    document = WorldExportJobDocument.of(job)
    request = document.request
    return {
        "arn": job.arn,
        "status": job.status,
        "createdAt": job.created_at,
        "failureCode": document.failure_code,
        "failureReason": document.failure_reason,
        "clientRequestToken": request.client_request_token,
        "worlds": request.worlds,
        "outputLocation": request.output_location.to_json(),
        "iamRole": request.iam_role,
        "tags": dict(job.tags),
    }
