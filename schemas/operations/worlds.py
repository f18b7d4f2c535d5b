"""Operations on worlds, which generation jobs create."""

from typing import Annotated

from pydantic import Field

from ..wire.base import Shape, ShapeName, optional
from ..wire.common import (
    AnsweredArns,
    Arn,
    Filters,
    Json,
    PageRequest,
    PaginationToken,
    Timestamp,
    WorldArn,
    WorldArns,
)
from ..wire.operation_shape import LIST_ERRORS, READ_ERRORS, OperationShape
from ..wire.tags import TagMap


class DescribeWorldRequest(Shape):
    """Request of `DescribeWorld`: names the simulation world to describe."""

    world: WorldArn = Field(description="ARN of the world.")


class DescribeWorldResponse(Shape):
    """Response of `DescribeWorld`: one generated simulation world."""

    arn: Arn | None = optional("ARN of the world.")
    generationJob: Arn | None = optional("ARN of the job that generated it.")
    template: Arn | None = optional("ARN of the template it was generated from.")
    createdAt: Timestamp | None = optional("When it was finished.")
    tags: TagMap | None = optional("Its tags: the job's `worldTags`, and later changes.")
    worldDescriptionBody: Json | None = optional(
        "JSON text that describes the world: plan, doors, furniture, seeds and what was proven of it."
    )


class ListWorldsRequest(PageRequest):
    """Request of `ListWorlds`: asks for a page of worlds, newest first."""

    filters: Filters | None = optional(
        "Filter by `generationJobId` or `templateId`, the id of what the worlds came from, or by `status`, "
        "which is `Active` for every world; absent: all worlds."
    )


class WorldSummary(Shape):
    """Summary of a simulation world, as `ListWorlds` shows it."""

    arn: Arn | None = optional("ARN of the world.")
    createdAt: Timestamp | None = optional("When it was finished.")
    generationJob: Arn | None = optional("ARN of the job that generated it.")
    template: Arn | None = optional("ARN of the template it was generated from.")


WorldSummaries = Annotated[list[WorldSummary], ShapeName("WorldSummaries")]


class ListWorldsResponse(Shape):
    """Response of `ListWorlds`: one page of worlds."""

    worldSummaries: WorldSummaries | None = optional("Worlds, newest first.")
    nextToken: PaginationToken | None = optional("Token of the next page; absent on the last.")


class BatchDeleteWorldsRequest(Shape):
    """Request of `BatchDeleteWorlds`: names the worlds to delete."""

    worlds: WorldArns = Field(description="ARNs of the worlds, 1 to 100.")


class BatchDeleteWorldsResponse(Shape):
    """Response of `BatchDeleteWorlds`: the worlds that could not be deleted."""

    unprocessedWorlds: AnsweredArns | None = optional("ARNs of the worlds that do not exist or could not be deleted.")


OPERATIONS = (
    OperationShape(DescribeWorldRequest, READ_ERRORS, "Says what a world holds."),
    OperationShape(ListWorldsRequest, LIST_ERRORS, "Lists worlds, newest first."),
    OperationShape(BatchDeleteWorldsRequest, LIST_ERRORS, "Deletes worlds, with what is stored of them."),
)
