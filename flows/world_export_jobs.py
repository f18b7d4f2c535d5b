"""Flows: world export jobs: worlds packed into one archive."""

from typing import Any

from ..schemas.wire.common import (
    Arn,
    Arns,
    ClientRequestToken,
    Filters,
    IamRole,
    MaxResults,
    OutputLocation,
    PaginationToken,
    TagMap,
)
from .steps import carry_out, operation_flow, order, perform_flow, read, record, validate


@operation_flow
def CreateWorldExportJob(
    *,
    worlds: Arns,
    outputLocation: OutputLocation,
    iamRole: IamRole,
    clientRequestToken: ClientRequestToken | None = None,
    tags: TagMap | None = None,
) -> dict[str, Any]:
    """Packs worlds into an archive in the object store."""
    return order("CreateWorldExportJob", locals())


@perform_flow
def PerformWorldExportJob(arn: str) -> dict[str, Any]:
    """Carries the job of an ARN, made by CreateWorldExportJob, to its end."""
    return carry_out("CreateWorldExportJob", arn)


@operation_flow
def DescribeWorldExportJob(*, job: Arn) -> dict[str, Any]:
    """Says how far a world export job is."""
    return read("DescribeWorldExportJob", locals())


@operation_flow
def ListWorldExportJobs(
    *, nextToken: PaginationToken | None = None, maxResults: MaxResults | None = None, filters: Filters | None = None
) -> dict[str, Any]:
    """Lists world export jobs, newest first."""
    return read("ListWorldExportJobs", locals())


@operation_flow
def CancelWorldExportJob(*, job: Arn) -> dict[str, Any]:
    """Cancels a world export job; it leaves no archive."""
    return record("CancelWorldExportJob", validate("CancelWorldExportJob", locals()))
