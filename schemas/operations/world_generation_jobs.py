"""Operations on world generation jobs, which generate a number of worlds from one template."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ..wire.base import Shape, ShapeName, optional
from ..wire.common import (
    AnsweredArns,
    Arn,
    ClientRequestToken,
    Filters,
    GenericString,
    JobReference,
    PageRequest,
    PaginationToken,
    Seed,
    Timestamp,
)
from ..wire.operation_shape import CREATE_EXPORT_ERRORS, LIMIT, LIST_ERRORS, READ_ERRORS, OperationShape
from ..wire.tags import TagMap

WorldGenerationJobStatus = Annotated[
    Literal["Pending", "Running", "Completed", "Failed", "PartialFailed", "Canceling", "Canceled"],
    ShapeName("WorldGenerationJobStatus"),
]
WorldGenerationJobErrorCode = Annotated[
    Literal[
        "InternalServiceError",
        "LimitExceeded",
        "ResourceNotFound",
        "RequestThrottled",
        "InvalidInput",
        "AllWorldGenerationFailed",
    ],
    ShapeName("WorldGenerationJobErrorCode"),
]
Diversity = Annotated[int, ShapeName("Diversity"), Field(ge=0, le=1)]
FloorplanCount = Annotated[int, ShapeName("FloorplanCount"), Field(ge=1)]
InteriorCountPerFloorplan = Annotated[int, ShapeName("InteriorCountPerFloorplan"), Field(ge=1)]
_MAX_COUNT = 2**31 - 1  # what the wire's whole numbers hold


def too_many_worlds(floorplans: int, interiors: int, most: int) -> str | None:
    """Explains why a world generation job exceeds the limit on its number of worlds; `None` if it does not.

    Args:
        floorplans: Number of floor plans.
        interiors: Number of worlds for each floor plan.
        most: Maximum number of worlds of one job.
    """
    total = floorplans * interiors
    if total <= most:
        return None
    return (
        f"{floorplans} floor plans with {interiors} interiors each are {total} worlds; a job may make at most {most} "
        "(ROBOMAKER_MAX_WORLDS_PER_JOB)"
    )


class WorldCount(Shape):
    """Number of worlds to generate: floor plans times interiors for each.

    A job that asks for too many, 50 by default, fails.
    """

    floorplanCount: FloorplanCount | None = optional(
        "Number of floor plans, which differ as long as there are others that are good enough."
    )
    interiorCountPerFloorplan: InteriorCountPerFloorplan | None = optional(
        "Number of differently furnished worlds for each floor plan."
    )

    @model_validator(mode="after")
    def _both(self) -> Self:
        if self.floorplanCount is None or self.interiorCountPerFloorplan is None:
            raise ValueError("floorplanCount and interiorCountPerFloorplan both have to be given, each at least 1")
        if max(self.floorplanCount, self.interiorCountPerFloorplan) > _MAX_COUNT:
            raise ValueError(
                f"floorplanCount is {self.floorplanCount} and interiorCountPerFloorplan "
                f"{self.interiorCountPerFloorplan}; each may be at most {_MAX_COUNT}"
            )
        return self


class CreateWorldGenerationJobRequest(Shape):
    """Request of `CreateWorldGenerationJob`: generates worlds from a world template."""

    clientRequestToken: ClientRequestToken | None = optional(
        "Makes the call repeatable: the same token and request give the same job."
    )
    template: Arn = Field(description="ARN of the template to generate from.")
    worldCount: WorldCount = Field(description="How many worlds.")
    tags: TagMap | None = optional("Tags for the job.")
    worldTags: TagMap | None = optional("Tags for every world it generates.")
    seed: Seed | None = optional("Extension: the same seed, template and generator give the same worlds.")
    diversity: Diversity | None = optional(
        "Extension: 1, the default: floor plans differ as long as there are others, each missing one wish at most that "
        "the best one grants; 0: each is the best one, its rooms a little longer or shorter."
    )


class CreateWorldGenerationJobResponse(Shape):
    """Response of `CreateWorldGenerationJob`: the accepted world generation job."""

    arn: Arn | None = optional("ARN of the job.")
    status: WorldGenerationJobStatus | None = optional("Status of the job.")
    createdAt: Timestamp | None = optional("When it was accepted.")
    failureCode: WorldGenerationJobErrorCode | None = optional("Why it failed; absent if not.")
    clientRequestToken: ClientRequestToken | None = optional("The request's token.")
    template: Arn | None = optional("ARN of the template.")
    worldCount: WorldCount | None = optional("How many worlds were requested.")
    tags: TagMap | None = optional("The job's tags.")
    worldTags: TagMap | None = optional("Tags of the worlds it generates.")


class DescribeWorldGenerationJobRequest(JobReference):
    """Request of `DescribeWorldGenerationJob`: names the world generation job to describe."""


class WorldFailure(Shape):
    """Number of worlds of a generation job that failed for the same reason, with its code and an example."""

    failureCode: WorldGenerationJobErrorCode | None = optional("The reason's code.")
    sampleFailureReason: GenericString | None = optional("The reason in words, of one of them.")
    failureCount: int | None = optional("How many worlds.")


WorldFailures = Annotated[list[WorldFailure], ShapeName("WorldFailures", 0, 100)]


class FailureSummary(Shape):
    """Failed worlds of a generation job, with their total number, grouped by reason."""

    totalFailureCount: int | None = optional("How many worlds failed.")
    failures: WorldFailures | None = optional("Failed worlds by reason.")


class FinishedWorldsSummary(Shape):
    """Finished worlds of a generation job, succeeded and failed; it grows while the job runs."""

    finishedCount: int | None = optional("Succeeded and failed worlds together.")
    succeededWorlds: AnsweredArns | None = optional("ARNs of the worlds that can be used.")
    failureSummary: FailureSummary | None = optional("The others.")
    planCount: int | None = optional(
        "Extension: number of different plans among the worlds made: rooms that touch on other sides, other doors, or "
        "an outline with more or fewer corners, however they are turned and mirrored."
    )


class DescribeWorldGenerationJobResponse(CreateWorldGenerationJobResponse):
    """Response of `DescribeWorldGenerationJob`: one world generation job."""

    failureReason: GenericString | None = optional("Why it failed, in words.")
    finishedWorldsSummary: FinishedWorldsSummary | None = optional("How many worlds were made, and which failed.")


class ListWorldGenerationJobsRequest(PageRequest):
    """Request of `ListWorldGenerationJobs`: asks for a page of world generation jobs, newest first."""

    filters: Filters | None = optional("Filter by `status` or `templateId`, the template's id; absent: all jobs.")


class WorldGenerationJobSummary(Shape):
    """Summary of a world generation job, as `ListWorldGenerationJobs` shows it."""

    arn: Arn | None = optional("ARN of the job.")
    template: Arn | None = optional("ARN of the template.")
    createdAt: Timestamp | None = optional("When it was accepted.")
    status: WorldGenerationJobStatus | None = optional("Status of the job.")
    worldCount: WorldCount | None = optional("How many worlds were requested.")
    succeededWorldCount: int | None = optional("How many worlds it has made.")
    failedWorldCount: int | None = optional("How many worlds failed.")


WorldGenerationJobSummaries = Annotated[
    list[WorldGenerationJobSummary], ShapeName("WorldGenerationJobSummaries", 0, 100)
]


class ListWorldGenerationJobsResponse(Shape):
    """Response of `ListWorldGenerationJobs`: one page of world generation jobs."""

    worldGenerationJobSummaries: WorldGenerationJobSummaries = Field(description="Jobs, newest first.")
    nextToken: PaginationToken | None = optional("Token of the next page; absent on the last.")


class CancelWorldGenerationJobRequest(JobReference):
    """Request of `CancelWorldGenerationJob`: names the world generation job to cancel."""


class CancelWorldGenerationJobResponse(Shape):
    """Response of `CancelWorldGenerationJob`: empty; the job is cancelled, or ended before."""


OPERATIONS = (
    OperationShape(
        CreateWorldGenerationJobRequest,
        (*CREATE_EXPORT_ERRORS, LIMIT),
        "Generates worlds from a template.",
        is_job=True,
    ),
    OperationShape(
        DescribeWorldGenerationJobRequest,
        READ_ERRORS,
        "Says how far a world generation job is and which worlds it made.",
    ),
    OperationShape(ListWorldGenerationJobsRequest, LIST_ERRORS, "Lists world generation jobs, newest first."),
    OperationShape(
        CancelWorldGenerationJobRequest, READ_ERRORS, "Cancels a world generation job; the worlds it has made stay."
    ),
)
