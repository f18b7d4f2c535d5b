"""World export jobs: worlds packed into one archive."""

import logging
from collections.abc import Sequence
from typing import Any

from ..schemas.operations.world_export_jobs import (
    CancelWorldExportJobRequest,
    CancelWorldExportJobResponse,
    CreateWorldExportJobRequest,
    CreateWorldExportJobResponse,
    DescribeWorldExportJobRequest,
    DescribeWorldExportJobResponse,
    ListWorldExportJobsRequest,
    ListWorldExportJobsResponse,
)
from ..schemas.wire.common import shorten
from ..schemas.wire.errors import (
    BucketNotFoundError,
    InvalidParameterException,
    ObjectNotFoundError,
    ResourceNotFoundException,
    StorageAccessDeniedError,
    StorageError,
)
from ..tasks.catalog import ClientToken, Resource
from ..tasks.execution.claims import perform_once
from ..tasks.execution.leases import Lease
from ..tasks.service.service import Progress, Service
from ..tasks.simulations.outputs.locations import check_output_location
from ..tasks.worlds.jobs import archive_place, cancel_world_job, end_canceled, move_on
from .listing import page_of
from .operation import flows_of, operation

KIND = "world-export-job"
_INTERNAL = "InternalServiceError"
_ORIGINS = ("generationJobId", "templateId")
"""Labels of worlds that an export of theirs has too."""
_FILTERS = {"status": "status", **{origin: origin for origin in _ORIGINS}}

_logger = logging.getLogger(__name__)


def perform_world_export_job(arn: str, service: Service) -> None:
    """Packs the worlds, stores the archive and ends the job."""
    perform_once(arn, KIND, service, lambda lease: _export(lease, service))


@operation("CreateWorldExportJob", perform=perform_world_export_job, describe="DescribeWorldExportJob")
def create_world_export_job(request: CreateWorldExportJobRequest, service: Service) -> CreateWorldExportJobResponse:
    """Stores an export job for worlds that exist."""
    token = ClientToken.of("CreateWorldExportJob", request)
    answer = _described(service.made_before(token) or _stored(request, token, service))
    del answer["worlds"], answer["failureReason"]
    return CreateWorldExportJobResponse.model_validate(answer)


def _stored(request: CreateWorldExportJobRequest, token: ClientToken | None, service: Service) -> Resource:
    if request.outputLocation.s3Bucket is None:
        raise InvalidParameterException("outputLocation.s3Bucket: has to be given; the archive is put there")
    check_output_location(request.outputLocation.to_wire())
    worlds = [service.catalog.get(world, kind="world") for world in request.worlds]
    return service.store_job(
        KIND,
        "export",
        {"request": request.to_wire()},
        tags=request.tags,
        token=token,
        labels={origin: _labels(worlds, origin) for origin in _ORIGINS},
    )


def _labels(worlds: Sequence[Resource], key: str) -> list[str]:
    return list(dict.fromkeys(value for world in worlds for value in world.labels.get(key, ())))


@operation("ListWorldExportJobs")
def list_world_export_jobs(request: ListWorldExportJobsRequest, service: Service) -> ListWorldExportJobsResponse:
    """Lists export jobs, newest first."""
    page = page_of("ListWorldExportJobs", KIND, request, service, filters=_FILTERS, given=request.filters)
    return ListWorldExportJobsResponse.model_validate(
        {"worldExportJobSummaries": [_summary(job) for job in page.resources], "nextToken": page.next_token}
    )


@operation("CancelWorldExportJob")
def cancel_world_export_job(request: CancelWorldExportJobRequest, service: Service) -> CancelWorldExportJobResponse:
    """Has a job end as cancelled: soon by whoever performs it, at once if nobody does; there is no archive then.

    Cancelling a job that has ended changes nothing and succeeds.
    """
    cancel_world_job(request.job, KIND, service, lambda lease: _export(lease, service))
    return CancelWorldExportJobResponse()


@operation("DescribeWorldExportJob")
def describe_world_export_job(
    request: DescribeWorldExportJobRequest, service: Service
) -> DescribeWorldExportJobResponse:
    """Tells how an export job stands."""
    return DescribeWorldExportJobResponse.model_validate(_described(service.catalog.get(request.job, kind=KIND)))


def _summary(job: Resource) -> dict[str, Any]:
    described = _described(job)
    return {member: described[member] for member in ("arn", "status", "createdAt", "worlds", "outputLocation")}


def _described(job: Resource) -> dict[str, Any]:
    request = job.document["request"]
    return {
        "arn": job.arn,
        "status": job.status,
        "createdAt": job.created_at,
        "failureCode": job.document.get("failureCode"),
        "failureReason": job.document.get("failureReason"),
        "clientRequestToken": request.get("clientRequestToken"),
        "worlds": request["worlds"],
        "outputLocation": request["outputLocation"],
        "iamRole": request["iamRole"],
        "tags": dict(job.tags),
    }


def _export(lease: Lease, service: Service) -> None:
    if lease.job.status == "Pending" and not move_on(lease, "start", started=True):
        return
    if lease.job.status == "Canceling" or service.catalog.cancel_requested(lease.job.arn):
        _remove_archive(lease.job, service)
        end_canceled(lease)
        return
    total = len(lease.job.document["request"]["worlds"])
    try:
        stored = _stored_archive(lease, service)
    except Exception as error:  # the job has to end whatever breaks
        code = _failure_code(error)
        if code == _INTERNAL:
            _logger.exception("world export job %s broke", lease.job.arn)
        move_on(lease, "fail", failureCode=code, failureReason=shorten(str(error) or type(error).__name__))
        service.report_progress(Progress({"failed": total}, total))
        return
    if not stored:
        end_canceled(lease)
    elif move_on(lease, "complete"):
        service.report_progress(Progress({"exported": total}, total))
    else:  # cancelled at the very last moment
        _remove_archive(lease.job, service)


def _stored_archive(lease: Lease, service: Service) -> bool:
    """Whether the archive is stored; not if the job is cancelled, or performed by another."""
    from ..tasks.worlds.export import export_worlds

    with service.activated():
        return (
            export_worlds(lease.job, lambda: lease.lost or service.catalog.cancel_requested(lease.job.arn)) is not None
        )


def _remove_archive(job: Resource, service: Service) -> None:
    """Removes what a cancelled job has stored, also where its performer died just after that."""
    if not job.document.get("started"):
        return
    try:
        service.store.delete(*archive_place(job))
    except BucketNotFoundError:
        return
    except StorageError as error:
        _logger.warning("the archive of the cancelled job %s is left: %s", job.arn, error)


def _failure_code(error: Exception) -> str:
    if isinstance(error, StorageAccessDeniedError):
        return "AccessDenied"
    if isinstance(error, ResourceNotFoundException | BucketNotFoundError | ObjectNotFoundError):
        return "ResourceNotFound"
    return _INTERNAL


def __getattr__(name: str) -> Any:
    return flows_of(__name__)(name)
