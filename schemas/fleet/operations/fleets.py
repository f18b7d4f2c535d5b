"""Operations on fleets: groups of physical robots to which applications are deployed."""

from typing import Annotated

from pydantic import Field

from ...wire.base import Shape, ShapeName, optional
from ...wire.common import Arn, Filters, Name, PageRequest, PaginationToken, Timestamp
from ...wire.operation_shape import INTERNAL, INVALID, LIMIT, READ_ERRORS, THROTTLED, OperationShape, deprecated
from ...wire.tags import TagMap
from .deployment_jobs import DeploymentStatus
from .robots import FleetMaxResults, Robots


class CreateFleetRequest(Shape):
    """Request of `CreateFleet`: creates a fleet, a group of physical robots, without robots at first."""

    name: Name = Field(description="Its name; several fleets may have the same.")
    tags: TagMap | None = optional("Tags for the fleet.")


class CreateFleetResponse(Shape):
    """Response of `CreateFleet`: the fleet that was created."""

    arn: Arn | None = optional("ARN of the fleet.")
    name: Name | None = optional("Its name.")
    createdAt: Timestamp | None = optional("When it was made.")
    tags: TagMap | None = optional("Its tags.")


class DescribeFleetRequest(Shape):
    """Request of `DescribeFleet`: names the fleet to describe."""

    fleet: Arn = Field(description="ARN of the fleet.")


class DescribeFleetResponse(Shape):
    """Response of `DescribeFleet`: one fleet with its robots."""

    name: Name | None = optional("Its name.")
    arn: Arn | None = optional("ARN of the fleet.")
    robots: Robots | None = optional("Its robots, newest first.")
    createdAt: Timestamp | None = optional("When it was made.")
    lastDeploymentStatus: DeploymentStatus | None = optional("How its last deployment stands.")
    lastDeploymentJob: Arn | None = optional("ARN of its last deployment; absent: none yet.")
    lastDeploymentTime: Timestamp | None = optional("When its last deployment was requested.")
    tags: TagMap | None = optional("Its tags.")


class ListFleetsRequest(PageRequest):
    """Request of `ListFleets`: asks for a page of fleets, newest first."""

    maxResults: FleetMaxResults | None = optional("Entries per page; absent: 200.")
    filters: Filters | None = optional("`name`; absent: all fleets.")


class Fleet(Shape):
    """Summary of a fleet of robots, as the response of `ListFleets` shows it."""

    name: Name | None = optional("Its name.")
    arn: Arn | None = optional("ARN of the fleet.")
    createdAt: Timestamp | None = optional("When it was made.")
    lastDeploymentStatus: DeploymentStatus | None = optional("How its last deployment stands.")
    lastDeploymentJob: Arn | None = optional("ARN of its last deployment; absent: none yet.")
    lastDeploymentTime: Timestamp | None = optional("When its last deployment was requested.")


Fleets = Annotated[list[Fleet], ShapeName("Fleets", 0, 200)]


class ListFleetsResponse(Shape):
    """Response of `ListFleets`: one page of fleets."""

    fleetDetails: Fleets | None = optional("Fleets, newest first.")
    nextToken: PaginationToken | None = optional("Token of the next page; absent on the last.")


class DeleteFleetRequest(Shape):
    """Request of `DeleteFleet`: deletes a fleet; its robots stay registered and belong to no fleet."""

    fleet: Arn = Field(description="ARN of the fleet.")


class DeleteFleetResponse(Shape):
    """Response of `DeleteFleet`: empty, the fleet is deleted."""


OPERATIONS = deprecated(
    OperationShape(
        CreateFleetRequest, (INVALID, INTERNAL, THROTTLED, LIMIT), "Makes a fleet that robots can be registered with."
    ),
    OperationShape(
        DescribeFleetRequest, READ_ERRORS, "Says which robots a fleet has and how its last deployment stands."
    ),
    OperationShape(ListFleetsRequest, READ_ERRORS, "Lists fleets, newest first."),
    OperationShape(
        DeleteFleetRequest,
        (INVALID, INTERNAL, THROTTLED),
        "Removes a fleet, if it is there, and deregisters its robots.",
    ),
)
