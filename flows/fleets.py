"""Flows: fleets: groups of robots that applications are deployed to."""

from typing import Any

from ..schemas.operations.robots import FleetMaxResults
from ..schemas.wire.common import Arn, Filters, Name, PaginationToken, TagMap
from .steps import operation_flow, read, record, validate


@operation_flow
def CreateFleet(*, name: Name, tags: TagMap | None = None) -> dict[str, Any]:
    """Makes a fleet that robots can be registered with."""
    return record("CreateFleet", validate("CreateFleet", locals()))


@operation_flow
def DescribeFleet(*, fleet: Arn) -> dict[str, Any]:
    """Says which robots a fleet has and how its last deployment stands."""
    return read("DescribeFleet", locals())


@operation_flow
def ListFleets(
    *,
    nextToken: PaginationToken | None = None,
    maxResults: FleetMaxResults | None = None,
    filters: Filters | None = None,
) -> dict[str, Any]:
    """Lists fleets, newest first."""
    return read("ListFleets", locals())


@operation_flow
def DeleteFleet(*, fleet: Arn) -> dict[str, Any]:
    """Removes a fleet, if it is there, and deregisters its robots."""
    return record("DeleteFleet", validate("DeleteFleet", locals()))
