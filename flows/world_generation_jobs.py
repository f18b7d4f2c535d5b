"""Flows: world generation jobs: worlds from a template, several processes at a time."""

from typing import Any

from ..schemas.operations.world_generation_jobs import WorldCount
from ..schemas.wire.common import Arn, ClientRequestToken, Filters, MaxResults, PaginationToken, Seed, TagMap
from .steps import carry_out, operation_flow, order, perform_flow, read, record, validate


@operation_flow
def CreateWorldGenerationJob(
    *,
    template: Arn,
    worldCount: WorldCount,
    clientRequestToken: ClientRequestToken | None = None,
    tags: TagMap | None = None,
    worldTags: TagMap | None = None,
    seed: Seed | None = None,
) -> dict[str, Any]:
    """Generates worlds from a template."""
    return order("CreateWorldGenerationJob", locals())


@perform_flow
def PerformWorldGenerationJob(arn: str) -> dict[str, Any]:
    """Carries the job of an ARN, made by CreateWorldGenerationJob, to its end."""
    return carry_out("CreateWorldGenerationJob", arn)


@operation_flow
def DescribeWorldGenerationJob(*, job: Arn) -> dict[str, Any]:
    """Says how far a world generation job is and which worlds it made."""
    return read("DescribeWorldGenerationJob", locals())


@operation_flow
def ListWorldGenerationJobs(
    *, nextToken: PaginationToken | None = None, maxResults: MaxResults | None = None, filters: Filters | None = None
) -> dict[str, Any]:
    """Lists world generation jobs, newest first."""
    return read("ListWorldGenerationJobs", locals())


@operation_flow
def CancelWorldGenerationJob(*, job: Arn) -> dict[str, Any]:
    """Cancels a world generation job; the worlds it has made stay."""
    return record("CancelWorldGenerationJob", validate("CancelWorldGenerationJob", locals()))
