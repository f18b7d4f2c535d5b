"""Flows: worlds: what generation jobs leave behind."""

from typing import Any

from ..schemas.wire.common import Arn, Arns, Filters, MaxResults, PaginationToken
from .steps import operation_flow, read, record, validate


@operation_flow
def DescribeWorld(*, world: Arn) -> dict[str, Any]:
    """Says what a world holds."""
    return read("DescribeWorld", locals())


@operation_flow
def ListWorlds(
    *, nextToken: PaginationToken | None = None, maxResults: MaxResults | None = None, filters: Filters | None = None
) -> dict[str, Any]:
    """Lists worlds, newest first."""
    return read("ListWorlds", locals())


@operation_flow
def BatchDeleteWorlds(*, worlds: Arns) -> dict[str, Any]:
    """Deletes worlds, with what is stored of them."""
    return record("BatchDeleteWorlds", validate("BatchDeleteWorlds", locals()))
