"""Flows: robots: machines that are registered with fleets."""

from typing import Any

from ..schemas.operations.robots import FleetMaxResults, Id
from ..schemas.wire.common import Architecture, Arn, Filters, Name, PaginationToken, TagMap
from .steps import operation_flow, read, record, validate


@operation_flow
def CreateRobot(
    *, name: Name, architecture: Architecture, greengrassGroupId: Id, tags: TagMap | None = None
) -> dict[str, Any]:
    """Makes a robot known under a name."""
    return record("CreateRobot", validate("CreateRobot", locals()))


@operation_flow
def DescribeRobot(*, robot: Arn) -> dict[str, Any]:
    """Says what a robot is and which fleet it is in."""
    return read("DescribeRobot", locals())


@operation_flow
def ListRobots(
    *,
    nextToken: PaginationToken | None = None,
    maxResults: FleetMaxResults | None = None,
    filters: Filters | None = None,
) -> dict[str, Any]:
    """Lists robots, newest first."""
    return read("ListRobots", locals())


@operation_flow
def DeleteRobot(*, robot: Arn) -> dict[str, Any]:
    """Removes a robot, if it is there."""
    return record("DeleteRobot", validate("DeleteRobot", locals()))


@operation_flow
def RegisterRobot(*, fleet: Arn, robot: Arn) -> dict[str, Any]:
    """Puts a robot into a fleet."""
    return record("RegisterRobot", validate("RegisterRobot", locals()))


@operation_flow
def DeregisterRobot(*, fleet: Arn, robot: Arn) -> dict[str, Any]:
    """Takes a robot out of its fleet."""
    return record("DeregisterRobot", validate("DeregisterRobot", locals()))
