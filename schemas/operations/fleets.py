"""Fleets: groups of robots that applications are deployed to."""

from typing import Annotated

from pydantic import Field

from ..wire.base import Shape, ShapeName
from ..wire.common import Arn, Filters, Name, PaginationToken, TagMap, Timestamp
from ..wire.operation_shape import INTERNAL, INVALID, LIMIT, READ_ERRORS, THROTTLED, OperationShape
from .deployment_jobs import DeploymentStatus
from .robots import FleetMaxResults, Robots


class CreateFleetRequest(Shape):
    """Makes a fleet without robots."""

    name: Name = Field(description="Its name; several fleets may have the same.")
    tags: TagMap | None = Field(default=None, description="Tags for the fleet.")


class CreateFleetResponse(Shape):
    """The fleet that was made."""

    arn: Arn | None = Field(default=None, description="ARN of the fleet.")
    name: Name | None = Field(default=None, description="Its name.")
    createdAt: Timestamp | None = Field(default=None, description="When it was made.")
    tags: TagMap | None = Field(default=None, description="Its tags.")


class DescribeFleetRequest(Shape):
    """Asks for one fleet."""

    fleet: Arn = Field(description="ARN of the fleet.")


class DescribeFleetResponse(Shape):
    """One fleet, with its robots."""

    name: Name | None = Field(default=None, description="Its name.")
    arn: Arn | None = Field(default=None, description="ARN of the fleet.")
    robots: Robots | None = Field(default=None, description="Its robots, newest first.")
    createdAt: Timestamp | None = Field(default=None, description="When it was made.")
    lastDeploymentStatus: DeploymentStatus | None = Field(default=None, description="How its last deployment stands.")
    lastDeploymentJob: Arn | None = Field(default=None, description="ARN of its last deployment; absent: none yet.")
    lastDeploymentTime: Timestamp | None = Field(default=None, description="When its last deployment was requested.")
    tags: TagMap | None = Field(default=None, description="Its tags.")


class ListFleetsRequest(Shape):
    """Asks for fleets, newest first."""

    nextToken: PaginationToken | None = Field(default=None, description="Token of the page before, to go on after it.")
    maxResults: FleetMaxResults | None = Field(default=None, description="Entries per page; absent: 200.")
    filters: Filters | None = Field(default=None, description="`name`; absent: all fleets.")


class Fleet(Shape):
    """One fleet in a list."""

    name: Name | None = Field(default=None, description="Its name.")
    arn: Arn | None = Field(default=None, description="ARN of the fleet.")
    createdAt: Timestamp | None = Field(default=None, description="When it was made.")
    lastDeploymentStatus: DeploymentStatus | None = Field(default=None, description="How its last deployment stands.")
    lastDeploymentJob: Arn | None = Field(default=None, description="ARN of its last deployment; absent: none yet.")
    lastDeploymentTime: Timestamp | None = Field(default=None, description="When its last deployment was requested.")


Fleets = Annotated[list[Fleet], ShapeName("Fleets", 0, 200)]


class ListFleetsResponse(Shape):
    """A page of fleets."""

    fleetDetails: Fleets | None = Field(default=None, description="Fleets, newest first.")
    nextToken: PaginationToken | None = Field(default=None, description="Token of the next page; absent on the last.")


class DeleteFleetRequest(Shape):
    """Removes a fleet; its robots stay, in no fleet."""

    fleet: Arn = Field(description="ARN of the fleet.")


class DeleteFleetResponse(Shape):
    """The fleet is gone."""


OPERATIONS = (
    OperationShape(
        "CreateFleet",
        CreateFleetRequest,
        CreateFleetResponse,
        (INVALID, INTERNAL, THROTTLED, LIMIT),
        "Makes a fleet that robots can be registered with.",
        deprecated=True,
    ),
    OperationShape(
        "DescribeFleet",
        DescribeFleetRequest,
        DescribeFleetResponse,
        READ_ERRORS,
        "Says which robots a fleet has and how its last deployment stands.",
        deprecated=True,
    ),
    OperationShape(
        "ListFleets",
        ListFleetsRequest,
        ListFleetsResponse,
        READ_ERRORS,
        "Lists fleets, newest first.",
        result_key="fleetDetails",
        deprecated=True,
    ),
    OperationShape(
        "DeleteFleet",
        DeleteFleetRequest,
        DeleteFleetResponse,
        (INVALID, INTERNAL, THROTTLED),
        "Removes a fleet, if it is there, and deregisters its robots.",
        deprecated=True,
    ),
)
