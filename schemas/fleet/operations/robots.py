"""Robots: machines that are registered with fleets."""

from typing import Annotated, Literal

from pydantic import Field

from ...wire.base import Shape, ShapeName, optional
from ...wire.common import Architecture, Arn, Filters, Name, PaginationToken, TagMap, Timestamp, text
from ...wire.operation_shape import (
    EXISTS,
    INTERNAL,
    INVALID,
    LIMIT,
    NOT_FOUND,
    READ_ERRORS,
    THROTTLED,
    OperationShape,
    deprecated,
)

Id = Annotated[str, ShapeName("Id"), text(1, 1224)]
RobotStatus = Annotated[
    Literal["Available", "Registered", "PendingNewDeployment", "Deploying", "Failed", "InSync", "NoResponse"],
    ShapeName("RobotStatus"),
]
FleetMaxResults = Annotated[int, ShapeName("MaxResults"), Field(ge=1, le=200)]
"""Entries per page of the lists of fleets, robots and deployment jobs."""


class CreateRobotRequest(Shape):
    """Makes a robot known."""

    name: Name = Field(description="Its name, unlike that of any other robot.")
    architecture: Architecture = Field(description="Its processor; applications need a source for it.")
    greengrassGroupId: Id = Field(description="Greengrass group of the robot; kept, and used for nothing.")
    tags: TagMap | None = optional("Tags for the robot.")


class CreateRobotResponse(Shape):
    """The robot that was made."""

    arn: Arn | None = optional("ARN of the robot.")
    name: Name | None = optional("Its name.")
    createdAt: Timestamp | None = optional("When it was made.")
    greengrassGroupId: Id | None = optional("Its Greengrass group.")
    architecture: Architecture | None = optional("Its processor.")
    tags: TagMap | None = optional("Its tags.")


class DescribeRobotRequest(Shape):
    """Asks for one robot."""

    robot: Arn = Field(description="ARN of the robot.")


class DescribeRobotResponse(Shape):
    """One robot."""

    arn: Arn | None = optional("ARN of the robot.")
    name: Name | None = optional("Its name.")
    fleetArn: Arn | None = optional("ARN of its fleet; absent: it is in none.")
    status: RobotStatus | None = optional("Whether it is in a fleet, and what is deployed.")
    greengrassGroupId: Id | None = optional("Its Greengrass group.")
    createdAt: Timestamp | None = optional("When it was made.")
    architecture: Architecture | None = optional("Its processor.")
    lastDeploymentJob: Arn | None = optional("ARN of the last deployment that was meant for it.")
    lastDeploymentTime: Timestamp | None = optional("When that deployment was requested.")
    tags: TagMap | None = optional("Its tags.")


class ListRobotsRequest(Shape):
    """Asks for robots, newest first."""

    nextToken: PaginationToken | None = optional("Token of the page before, to go on after it.")
    maxResults: FleetMaxResults | None = optional("Entries per page; absent: 200.")
    filters: Filters | None = optional("`status` or `fleetName`; absent: all robots.")


class Robot(Shape):
    """One robot in a list."""

    arn: Arn | None = optional("ARN of the robot.")
    name: Name | None = optional("Its name.")
    fleetArn: Arn | None = optional("ARN of its fleet; absent: it is in none.")
    status: RobotStatus | None = optional("Whether it is in a fleet, and what is deployed.")
    greenGrassGroupId: Id | None = optional("Its Greengrass group; with a capital G here, and only here.")
    createdAt: Timestamp | None = optional("When it was made.")
    architecture: Architecture | None = optional("Its processor.")
    lastDeploymentJob: Arn | None = optional("ARN of the last deployment that was meant for it.")
    lastDeploymentTime: Timestamp | None = optional("When that deployment was requested.")


Robots = Annotated[list[Robot], ShapeName("Robots", 0, 1000)]


class ListRobotsResponse(Shape):
    """A page of robots."""

    robots: Robots | None = optional("Robots, newest first.")
    nextToken: PaginationToken | None = optional("Token of the next page; absent on the last.")


class DeleteRobotRequest(Shape):
    """Removes a robot."""

    robot: Arn = Field(description="ARN of the robot.")


class DeleteRobotResponse(Shape):
    """The robot is gone."""


class RegisterRobotRequest(Shape):
    """Puts a robot into a fleet."""

    fleet: Arn = Field(description="ARN of the fleet.")
    robot: Arn = Field(description="ARN of the robot; it must not be in another fleet.")


class RegisterRobotResponse(Shape):
    """The robot is in the fleet."""

    fleet: Arn | None = optional("ARN of the fleet.")
    robot: Arn | None = optional("ARN of the robot.")


class DeregisterRobotRequest(Shape):
    """Takes a robot out of its fleet."""

    fleet: Arn = Field(description="ARN of the fleet.")
    robot: Arn = Field(description="ARN of the robot.")


class DeregisterRobotResponse(Shape):
    """The robot is in no fleet."""

    fleet: Arn | None = optional("ARN of the fleet it was in.")
    robot: Arn | None = optional("ARN of the robot.")


OPERATIONS = deprecated(
    OperationShape(
        CreateRobotRequest, (INVALID, INTERNAL, THROTTLED, LIMIT, EXISTS), "Makes a robot known under a name."
    ),
    OperationShape(DescribeRobotRequest, READ_ERRORS, "Says what a robot is and which fleet it is in."),
    OperationShape(ListRobotsRequest, READ_ERRORS, "Lists robots, newest first."),
    OperationShape(DeleteRobotRequest, (INVALID, INTERNAL, THROTTLED), "Removes a robot, if it is there."),
    OperationShape(
        RegisterRobotRequest, (INVALID, INTERNAL, THROTTLED, LIMIT, NOT_FOUND), "Puts a robot into a fleet."
    ),
    OperationShape(DeregisterRobotRequest, READ_ERRORS, "Takes a robot out of its fleet."),
)
