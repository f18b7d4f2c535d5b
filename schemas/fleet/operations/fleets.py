"""Fleets: groups of robots that applications are deployed to."""

from typing import Annotated

from pydantic import Field

from ...wire.base import Shape, ShapeName, optional
from ...wire.common import Arn, Filters, Name, PaginationToken, TagMap, Timestamp
from ...wire.operation_shape import INTERNAL, INVALID, LIMIT, READ_ERRORS, THROTTLED, OperationShape, deprecated
from .deployment_jobs import DeploymentStatus
from .robots import FleetMaxResults, Robots


class CreateFleetRequest(Shape):
    """Makes a fleet without robots."""

    name: Name = Field(description="Its name; several fleets may have the same.")
    tags: TagMap | None = optional("Tags for the fleet.")


class CreateFleetResponse(Shape):
    """The fleet that was made."""

    arn: Arn | None = optional("ARN of the fleet.")
    name: Name | None = optional("Its name.")
    createdAt: Timestamp | None = optional("When it was made.")
    tags: TagMap | None = optional("Its tags.")


class DescribeFleetRequest(Shape):
    """Asks for one fleet."""

    fleet: Arn = Field(description="ARN of the fleet.")


class DescribeFleetResponse(Shape):
    """One fleet, with its robots."""

    name: Name | None = optional("Its name.")
    arn: Arn | None = optional("ARN of the fleet.")
    robots: Robots | None = optional("Its robots, newest first.")
    createdAt: Timestamp | None = optional("When it was made.")
    lastDeploymentStatus: DeploymentStatus | None = optional("How its last deployment stands.")
    lastDeploymentJob: Arn | None = optional("ARN of its last deployment; absent: none yet.")
    lastDeploymentTime: Timestamp | None = optional("When its last deployment was requested.")
    tags: TagMap | None = optional("Its tags.")


class ListFleetsRequest(Shape):
    """Asks for fleets, newest first."""

    nextToken: PaginationToken | None = optional("Token of the page before, to go on after it.")
    maxResults: FleetMaxResults | None = optional("Entries per page; absent: 200.")
    filters: Filters | None = optional("`name`; absent: all fleets.")


class Fleet(Shape):
    """One fleet in a list."""

    name: Name | None = optional("Its name.")
    arn: Arn | None = optional("ARN of the fleet.")
    createdAt: Timestamp | None = optional("When it was made.")
    lastDeploymentStatus: DeploymentStatus | None = optional("How its last deployment stands.")
    lastDeploymentJob: Arn | None = optional("ARN of its last deployment; absent: none yet.")
    lastDeploymentTime: Timestamp | None = optional("When its last deployment was requested.")


Fleets = Annotated[list[Fleet], ShapeName("Fleets", 0, 200)]


class ListFleetsResponse(Shape):
    """A page of fleets."""

    fleetDetails: Fleets | None = optional("Fleets, newest first.")
    nextToken: PaginationToken | None = optional("Token of the next page; absent on the last.")


class DeleteFleetRequest(Shape):
    """Removes a fleet; its robots stay, in no fleet."""

    fleet: Arn = Field(description="ARN of the fleet.")


class DeleteFleetResponse(Shape):
    """The fleet is gone."""


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
