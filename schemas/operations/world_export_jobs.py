"""Operations on world export jobs, which pack worlds into one archive in the object store."""

from typing import Annotated, Literal

from pydantic import Field

from ..wire.base import Shape, ShapeName, optional
from ..wire.common import (
    AnsweredArns,
    Arn,
    ClientRequestToken,
    Filters,
    GenericString,
    IamRole,
    JobReference,
    OutputLocation,
    PageRequest,
    PaginationToken,
    Timestamp,
    WorldArns,
)
from ..wire.operation_shape import CREATE_EXPORT_ERRORS, LIST_ERRORS, READ_ERRORS, OperationShape
from ..wire.tags import TagMap

WorldExportJobStatus = Annotated[
    Literal["Pending", "Running", "Completed", "Failed", "Canceling", "Canceled"], ShapeName("WorldExportJobStatus")
]
WorldExportJobErrorCode = Annotated[
    Literal[
        "InternalServiceError", "LimitExceeded", "ResourceNotFound", "RequestThrottled", "InvalidInput", "AccessDenied"
    ],
    ShapeName("WorldExportJobErrorCode"),
]


class CreateWorldExportJobRequest(Shape):
    """Request of `CreateWorldExportJob`: packs worlds into an archive in the object store."""

    clientRequestToken: ClientRequestToken | None = optional(
        "Makes the call repeatable: the same token and request give the same job."
    )
    worlds: WorldArns = Field(description="ARNs of the worlds that go into the archive, 1 to 100.")
    outputLocation: OutputLocation = Field(description="Location of the archive.")
    iamRole: IamRole = Field(description="ARN of the role whose rights the job uses to write.")
    tags: TagMap | None = optional("Tags for the job.")


class CreateWorldExportJobResponse(Shape):
    """Response of `CreateWorldExportJob`: the accepted world export job."""

    arn: Arn | None = optional("ARN of the job.")
    status: WorldExportJobStatus | None = optional("Status of the job.")
    createdAt: Timestamp | None = optional("When it was accepted.")
    failureCode: WorldExportJobErrorCode | None = optional("Why it failed; absent if not.")
    clientRequestToken: ClientRequestToken | None = optional("The request's token.")
    outputLocation: OutputLocation | None = optional("Location of the archive.")
    iamRole: IamRole | None = optional("ARN of the role the job uses.")
    tags: TagMap | None = optional("The job's tags.")


class DescribeWorldExportJobRequest(JobReference):
    """Request of `DescribeWorldExportJob`: names the world export job to describe."""


class DescribeWorldExportJobResponse(CreateWorldExportJobResponse):
    """Response of `DescribeWorldExportJob`: one world export job."""

    failureReason: GenericString | None = optional("Why it failed, in words.")
    worlds: AnsweredArns | None = optional("ARNs of the worlds in the archive.")


class ListWorldExportJobsRequest(PageRequest):
    """Request of `ListWorldExportJobs`: asks for a page of world export jobs, newest first."""

    filters: Filters | None = optional(
        "Filter by `status`, or by `generationJobId` or `templateId`, the id of what one of a job's worlds "
        "came from; absent: all jobs."
    )


class WorldExportJobSummary(Shape):
    """Summary of a world export job, as `ListWorldExportJobs` shows it."""

    arn: Arn | None = optional("ARN of the job.")
    status: WorldExportJobStatus | None = optional("Status of the job.")
    createdAt: Timestamp | None = optional("When it was accepted.")
    worlds: AnsweredArns | None = optional("ARNs of the worlds in the archive.")
    outputLocation: OutputLocation | None = optional("Location of the archive.")


WorldExportJobSummaries = Annotated[list[WorldExportJobSummary], ShapeName("WorldExportJobSummaries", 0, 100)]


class ListWorldExportJobsResponse(Shape):
    """Response of `ListWorldExportJobs`: one page of world export jobs."""

    worldExportJobSummaries: WorldExportJobSummaries = Field(description="Jobs, newest first.")
    nextToken: PaginationToken | None = optional("Token of the next page; absent on the last.")


class CancelWorldExportJobRequest(JobReference):
    """Request of `CancelWorldExportJob`: names the world export job to cancel."""


class CancelWorldExportJobResponse(Shape):
    """Response of `CancelWorldExportJob`: empty; the job is cancelled, or ended before."""


OPERATIONS = (
    OperationShape(
        CreateWorldExportJobRequest,
        CREATE_EXPORT_ERRORS,
        "Packs worlds into an archive in the object store.",
        is_job=True,
    ),
    OperationShape(DescribeWorldExportJobRequest, READ_ERRORS, "Says how far a world export job is."),
    OperationShape(ListWorldExportJobsRequest, LIST_ERRORS, "Lists world export jobs, newest first."),
    OperationShape(CancelWorldExportJobRequest, READ_ERRORS, "Cancels a world export job; it leaves no archive."),
)
