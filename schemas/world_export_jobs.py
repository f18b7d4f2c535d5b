"""World export jobs: worlds packed into one archive in the object store."""

from typing import Literal

from pydantic import Field

from .base import Shape
from .common import Arn, Arns, ClientRequestToken, GenericString, IamRole, OutputLocation, TagMap, Timestamp
from .operation_shape import CREATE_EXPORT_ERRORS, READ_ERRORS, OperationShape

WorldExportJobStatus = Literal["Pending", "Running", "Completed", "Failed", "Canceling", "Canceled"]
WorldExportJobErrorCode = Literal[
    "InternalServiceError", "LimitExceeded", "ResourceNotFound", "RequestThrottled", "InvalidInput", "AccessDenied"
]


class CreateWorldExportJobRequest(Shape):
    """Orders an archive of worlds."""

    clientRequestToken: ClientRequestToken | None = Field(
        default=None, description="Makes the call repeatable: the same token and request give the same job."
    )
    worlds: Arns = Field(description="ARNs of the worlds that go into the archive, 1 to 100.")
    outputLocation: OutputLocation = Field(description="Where the archive is put.")
    iamRole: IamRole = Field(description="ARN of the role whose rights the job uses to write.")
    tags: TagMap | None = Field(default=None, description="Tags for the job.")


class CreateWorldExportJobResponse(Shape):
    """The job as it was accepted."""

    arn: Arn | None = Field(default=None, description="ARN of the job.")
    status: WorldExportJobStatus | None = Field(default=None, description="Where the job is in its life.")
    createdAt: Timestamp | None = Field(default=None, description="When it was accepted.")
    failureCode: WorldExportJobErrorCode | None = Field(default=None, description="Why it failed; absent if not.")
    clientRequestToken: ClientRequestToken | None = Field(default=None, description="The request's token.")
    outputLocation: OutputLocation | None = Field(default=None, description="Where the archive is put.")
    iamRole: IamRole | None = Field(default=None, description="ARN of the role the job uses.")
    tags: TagMap | None = Field(default=None, description="The job's tags.")


class DescribeWorldExportJobRequest(Shape):
    """Asks for one job."""

    job: Arn = Field(description="ARN of the job.")


class DescribeWorldExportJobResponse(CreateWorldExportJobResponse):
    """One job."""

    failureReason: GenericString | None = Field(default=None, description="Why it failed, in words.")
    worlds: list[Arn] | None = Field(default=None, description="ARNs of the worlds in the archive.")


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
)
