"""World export jobs: worlds packed into one archive."""

import logging
from typing import Any

from ..schemas.common import shorten
from ..schemas.errors import (
    BucketNotFoundError,
    InvalidParameterException,
    ObjectNotFoundError,
    ResourceNotFoundException,
    StorageAccessDeniedError,
)
from ..schemas.world_export_jobs import (
    CreateWorldExportJobRequest,
    CreateWorldExportJobResponse,
    DescribeWorldExportJobRequest,
    DescribeWorldExportJobResponse,
)
from ..tasks.catalog import ClientToken, Resource
from ..tasks.performing import Lease, perform_once
from ..tasks.service import Progress, Service
from ..tasks.uploads import check_output_location
from .operation import flows_of, operation

KIND = "world-export-job"
_INTERNAL = "InternalServiceError"

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
    for world in request.worlds:
        service.catalog.get(world, kind="world")
    return service.store_job(
        KIND,
        "export",
        {"request": request.to_wire()},
        tags=request.tags,
        token=token,
    )


@operation("DescribeWorldExportJob")
def describe_world_export_job(
    request: DescribeWorldExportJobRequest, service: Service
) -> DescribeWorldExportJobResponse:
    """Tells how an export job stands."""
    return DescribeWorldExportJobResponse.model_validate(_described(service.catalog.get(request.job, kind=KIND)))


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
    from ..tasks.world_export import export_worlds

    if lease.job.status == "Pending":
        lease.transition("start")
    if lease.job.status == "Canceling" or service.catalog.cancel_requested(lease.job.arn):
        if lease.job.status != "Canceling":
            lease.transition("cancel")
        lease.transition("canceled")
        return
    total = len(lease.job.document["request"]["worlds"])
    try:
        with service.activated():
            export_worlds(lease.job)
    except Exception as error:  # the job has to end whatever breaks
        code = _failure_code(error)
        if code == _INTERNAL:
            _logger.exception("world export job %s broke", lease.job.arn)
        lease.transition("fail", failureCode=code, failureReason=shorten(str(error) or type(error).__name__))
        service.report_progress(Progress({"failed": total}, total))
        return
    lease.transition("complete")
    service.report_progress(Progress({"exported": total}, total))


def _failure_code(error: Exception) -> str:
    if isinstance(error, StorageAccessDeniedError):
        return "AccessDenied"
    if isinstance(error, ResourceNotFoundException | BucketNotFoundError | ObjectNotFoundError):
        return "ResourceNotFound"
    return _INTERNAL


def __getattr__(name: str) -> Any:
    return flows_of(__name__)(name)
