"""World generation jobs: so many worlds from one template."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from .base import Shape
from .common import Arn, ClientRequestToken, GenericString, Seed, TagMap, Timestamp
from .operation_shape import CREATE_EXPORT_ERRORS, LIMIT, READ_ERRORS, OperationShape

WorldGenerationJobStatus = Literal[
    "Pending", "Running", "Completed", "Failed", "PartialFailed", "Canceling", "Canceled"
]
WorldGenerationJobErrorCode = Literal[
    "InternalServiceError",
    "LimitExceeded",
    "ResourceNotFound",
    "RequestThrottled",
    "InvalidInput",
    "AllWorldGenerationFailed",
]
FloorplanCount = Annotated[int, Field(ge=1)]
InteriorCountPerFloorplan = Annotated[int, Field(ge=1)]
MAX_WORLDS = 50
"""Worlds that one job may make."""


class WorldCount(Shape):
    """How many worlds: the product of both numbers. A job may make 1 to 50."""

    floorplanCount: FloorplanCount | None = Field(default=None, description="Number of different floor plans.")
    interiorCountPerFloorplan: InteriorCountPerFloorplan | None = Field(
        default=None, description="Number of differently furnished worlds for each floor plan."
    )

    @model_validator(mode="after")
    def _both(self) -> Self:
        if self.floorplanCount is None or self.interiorCountPerFloorplan is None:
            raise ValueError("floorplanCount and interiorCountPerFloorplan both have to be given, each at least 1")
        if (total := self.floorplanCount * self.interiorCountPerFloorplan) > MAX_WORLDS:
            raise ValueError(
                f"{self.floorplanCount} floor plans with {self.interiorCountPerFloorplan} interiors each are {total} "
                f"worlds; a job may make at most {MAX_WORLDS}"
            )
        return self


class CreateWorldGenerationJobRequest(Shape):
    """Orders worlds."""

    clientRequestToken: ClientRequestToken | None = Field(
        default=None, description="Makes the call repeatable: the same token and request give the same job."
    )
    template: Arn = Field(description="ARN of the template to generate from.")
    worldCount: WorldCount = Field(description="How many worlds.")
    tags: TagMap | None = Field(default=None, description="Tags for the job.")
    worldTags: TagMap | None = Field(default=None, description="Tags for every world it generates.")
    seed: Seed | None = Field(
        default=None, description="Extension: the same seed, template and generator give the same worlds."
    )


class CreateWorldGenerationJobResponse(Shape):
    """The job as it was accepted."""

    arn: Arn | None = Field(default=None, description="ARN of the job.")
    status: WorldGenerationJobStatus | None = Field(default=None, description="Where the job is in its life.")
    createdAt: Timestamp | None = Field(default=None, description="When it was accepted.")
    failureCode: WorldGenerationJobErrorCode | None = Field(default=None, description="Why it failed; absent if not.")
    clientRequestToken: ClientRequestToken | None = Field(default=None, description="The request's token.")
    template: Arn | None = Field(default=None, description="ARN of the template.")
    worldCount: WorldCount | None = Field(default=None, description="How many worlds were ordered.")
    tags: TagMap | None = Field(default=None, description="The job's tags.")
    worldTags: TagMap | None = Field(default=None, description="Tags of the worlds it generates.")


class DescribeWorldGenerationJobRequest(Shape):
    """Asks for one job."""

    job: Arn = Field(description="ARN of the job.")


class WorldFailure(Shape):
    """Worlds that failed for one reason."""

    failureCode: WorldGenerationJobErrorCode | None = Field(default=None, description="The reason's code.")
    sampleFailureReason: GenericString | None = Field(default=None, description="The reason in words, of one of them.")
    failureCount: int | None = Field(default=None, description="How many worlds.")


class FailureSummary(Shape):
    """Worlds that failed."""

    totalFailureCount: int | None = Field(default=None, description="How many worlds failed.")
    failures: Annotated[list[WorldFailure], Field(max_length=100)] | None = Field(
        default=None, description="By reason."
    )


class FinishedWorldsSummary(Shape):
    """Worlds that are finished, well or badly; grows while the job runs."""

    finishedCount: int | None = Field(default=None, description="Succeeded and failed worlds together.")
    succeededWorlds: list[Arn] | None = Field(default=None, description="ARNs of the worlds that can be used.")
    failureSummary: FailureSummary | None = Field(default=None, description="The others.")


class DescribeWorldGenerationJobResponse(CreateWorldGenerationJobResponse):
    """One job."""

    failureReason: GenericString | None = Field(default=None, description="Why it failed, in words.")
    finishedWorldsSummary: FinishedWorldsSummary | None = Field(default=None, description="What became of the worlds.")


OPERATIONS = (
    OperationShape(
        "CreateWorldGenerationJob",
        CreateWorldGenerationJobRequest,
        CreateWorldGenerationJobResponse,
        (*CREATE_EXPORT_ERRORS, LIMIT),
        "Generates worlds from a template.",
        is_job=True,
    ),
    OperationShape(
        "DescribeWorldGenerationJob",
        DescribeWorldGenerationJobRequest,
        DescribeWorldGenerationJobResponse,
        READ_ERRORS,
        "Says how far a world generation job is and which worlds it made.",
    ),
)
