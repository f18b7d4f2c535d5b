"""World export jobs: worlds packed into one archive in the object store."""

from typing import Annotated, Literal

from pydantic import Field

from ..wire.base import Shape, ShapeName
from ..wire.common import (
    AnsweredArns,
    Arn,
    Arns,
    ClientRequestToken,
    Filters,
    GenericString,
    IamRole,
    MaxResults,
    OutputLocation,
    PaginationToken,
    TagMap,
    Timestamp,
)
from ..wire.operation_shape import CREATE_EXPORT_ERRORS, LIST_ERRORS, READ_ERRORS, OperationShape

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
    """Request for an archive of worlds."""

    clientRequestToken: ClientRequestToken | None = Field(
        default=None, description="Makes the call repeatable: the same token and request give the same job."
    )
    worlds: Arns = Field(description="ARNs of the worlds that go into the archive, 1 to 100.")
    outputLocation: OutputLocation = Field(description="Location of the archive.")
    iamRole: IamRole = Field(description="ARN of the role whose rights the job uses to write.")
    tags: TagMap | None = Field(default=None, description="Tags for the job.")


class CreateWorldExportJobResponse(Shape):
    """The job as it was accepted."""

    arn: Arn | None = Field(default=None, description="ARN of the job.")
    status: WorldExportJobStatus | None = Field(default=None, description="Status of the job.")
    createdAt: Timestamp | None = Field(default=None, description="When it was accepted.")
    failureCode: WorldExportJobErrorCode | None = Field(default=None, description="Why it failed; absent if not.")
    clientRequestToken: ClientRequestToken | None = Field(default=None, description="The request's token.")
    outputLocation: OutputLocation | None = Field(default=None, description="Location of the archive.")
    iamRole: IamRole | None = Field(default=None, description="ARN of the role the job uses.")
    tags: TagMap | None = Field(default=None, description="The job's tags.")


class DescribeWorldExportJobRequest(Shape):
    """Asks for one job."""

    job: Arn = Field(description="ARN of the job.")


class DescribeWorldExportJobResponse(CreateWorldExportJobResponse):
    """One job."""

    failureReason: GenericString | None = Field(default=None, description="Why it failed, in words.")
    worlds: AnsweredArns | None = Field(default=None, description="ARNs of the worlds in the archive.")


class ListWorldExportJobsRequest(Shape):
    """Asks for export jobs, newest first."""

    nextToken: PaginationToken | None = Field(default=None, description="Token of the page before, to go on after it.")
    maxResults: MaxResults | None = Field(default=None, description="Entries per page; absent: 100.")
    filters: Filters | None = Field(
        default=None,
        description="Filter by `status`, or by `generationJobId` or `templateId`, the id of what one of a job's worlds "
        "came from; absent: all jobs.",
    )


class WorldExportJobSummary(Shape):
    """One export job in a list."""

    arn: Arn | None = Field(default=None, description="ARN of the job.")
    status: WorldExportJobStatus | None = Field(default=None, description="Status of the job.")
    createdAt: Timestamp | None = Field(default=None, description="When it was accepted.")
    worlds: AnsweredArns | None = Field(default=None, description="ARNs of the worlds in the archive.")
    outputLocation: OutputLocation | None = Field(default=None, description="Location of the archive.")


WorldExportJobSummaries = Annotated[list[WorldExportJobSummary], ShapeName("WorldExportJobSummaries", 0, 100)]


class ListWorldExportJobsResponse(Shape):
    """A page of export jobs."""

    worldExportJobSummaries: WorldExportJobSummaries = Field(description="Jobs, newest first.")
    nextToken: PaginationToken | None = Field(default=None, description="Token of the next page; absent on the last.")


class CancelWorldExportJobRequest(Shape):
    """Names the job to cancel."""

    job: Arn = Field(description="ARN of the job.")


class CancelWorldExportJobResponse(Shape):
    """Empty: the job is cancelled, or has ended before."""


OPERATIONS = (
    OperationShape(
        "CreateWorldExportJob",
        CreateWorldExportJobRequest,
        CreateWorldExportJobResponse,
        CREATE_EXPORT_ERRORS,
        "Packs worlds into an archive in the object store.",
        is_job=True,
    ),
    OperationShape(
        "DescribeWorldExportJob",
        DescribeWorldExportJobRequest,
        DescribeWorldExportJobResponse,
        READ_ERRORS,
        "Says how far a world export job is.",
    ),
    OperationShape(
        "ListWorldExportJobs",
        ListWorldExportJobsRequest,
        ListWorldExportJobsResponse,
        LIST_ERRORS,
        "Lists world export jobs, newest first.",
        result_key="worldExportJobSummaries",
    ),
    OperationShape(
        "CancelWorldExportJob",
        CancelWorldExportJobRequest,
        CancelWorldExportJobResponse,
        READ_ERRORS,
        "Cancels a world export job; it leaves no archive.",
    ),
)
