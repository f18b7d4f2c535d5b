"""Operations on physical robots, which can be registered with fleets."""

from typing import Annotated, Literal

from pydantic import Field

from ...wire.base import Shape, ShapeName, optional
from ...wire.common import Architecture, Arn, Filters, Name, PageRequest, PaginationToken, Timestamp, text
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
from ...wire.tags import TagMap

Id = Annotated[str, ShapeName("Id"), text(1, 1224)]
RobotStatus = Annotated[
    Literal["Available", "Registered", "PendingNewDeployment", "Deploying", "Failed", "InSync", "NoResponse"],
    ShapeName("RobotStatus"),
]
FleetMaxResults = Annotated[int, ShapeName("MaxResults"), Field(ge=1, le=200)]
"""Maximum number of entries per page in lists of fleets, robots and deployment jobs."""


class CreateRobotRequest(Shape):
    """Request of `CreateRobot`: registers a physical robot by name."""

    name: Name = Field(description="Its name, unlike that of any other robot.")
    architecture: Architecture = Field(description="Its processor; applications need a source for it.")
    greengrassGroupId: Id = Field(description="Greengrass group of the robot; kept, and used for nothing.")
    tags: TagMap | None = optional("Tags for the robot.")


class CreateRobotResponse(Shape):
    """Response of `CreateRobot`: the robot that was registered."""

    arn: Arn | None = optional("ARN of the robot.")
    name: Name | None = optional("Its name.")
    createdAt: Timestamp | None = optional("When it was made.")
    greengrassGroupId: Id | None = optional("Its Greengrass group.")
    architecture: Architecture | None = optional("Its processor.")
    tags: TagMap | None = optional("Its tags.")


class DescribeRobotRequest(Shape):
    """Request of `DescribeRobot`: names the robot to describe."""

    robot: Arn = Field(description="ARN of the robot.")


class DescribeRobotResponse(Shape):
    """Response of `DescribeRobot`: one robot with its fleet, status and last deployment."""

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


class ListRobotsRequest(PageRequest):
    """Request of `ListRobots`: asks for a page of robots, newest first."""

    maxResults: FleetMaxResults | None = optional("Entries per page; absent: 200.")
    filters: Filters | None = optional("`status` or `fleetName`; absent: all robots.")


class Robot(Shape):
    """Summary of a physical robot, as the responses of `ListRobots` and `DescribeFleet` show it."""

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
    """Response of `ListRobots`: one page of robots."""

    robots: Robots | None = optional("Robots, newest first.")
    nextToken: PaginationToken | None = optional("Token of the next page; absent on the last.")


class DeleteRobotRequest(Shape):
    """Request of `DeleteRobot`: names the robot to delete."""

    robot: Arn = Field(description="ARN of the robot.")


class DeleteRobotResponse(Shape):
    """Response of `DeleteRobot`: empty, the robot is deleted."""


class RegisterRobotRequest(Shape):
    """Request of `RegisterRobot`: adds a robot to a fleet."""

    fleet: Arn = Field(description="ARN of the fleet.")
    robot: Arn = Field(description="ARN of the robot; it must not be in another fleet.")


class RegisterRobotResponse(Shape):
    """Response of `RegisterRobot`: the robot and the fleet that it was added to."""

    fleet: Arn | None = optional("ARN of the fleet.")
    robot: Arn | None = optional("ARN of the robot.")


class DeregisterRobotRequest(Shape):
    """Request of `DeregisterRobot`: removes a robot from its fleet."""

    fleet: Arn = Field(description="ARN of the fleet.")
    robot: Arn = Field(description="ARN of the robot.")


class DeregisterRobotResponse(Shape):
    """Response of `DeregisterRobot`: the robot and the fleet that it was removed from."""

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
