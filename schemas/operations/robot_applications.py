"""Robot applications: what drives the robot."""

from typing import Annotated

from pydantic import Field

from ..wire.base import Shape, ShapeName, optional
from ..wire.common import Arn, LastUpdatedAt, Name, PaginationToken, TagMap, Version
from .applications import (
    ApplicationContent,
    ApplicationListRequest,
    ApplicationRevision,
    ApplicationSelection,
    ApplicationUpdate,
    ImageDigest,
    NewApplicationVersion,
    RobotSoftwareSuite,
    application_operations,
)


class CreateRobotApplicationRequest(ApplicationContent):
    """Request for a robot application."""

    name: Name = Field(description="Its name, unlike that of any other robot application.")
    tags: TagMap | None = optional("Tags for the application.")


class CreateRobotApplicationResponse(ApplicationRevision):
    """The application that was made."""

    tags: TagMap | None = optional("Its tags.")


class CreateRobotApplicationVersionRequest(NewApplicationVersion):
    """Request for a numbered version of a robot application: what it is now."""


class CreateRobotApplicationVersionResponse(ApplicationRevision):
    """The version that was made."""


class DescribeRobotApplicationRequest(ApplicationSelection):
    """Asks for one robot application, as it is now or one version of it."""


class DescribeRobotApplicationResponse(ApplicationRevision):
    """One robot application, or one version of it."""

    tags: TagMap | None = optional("Tags of the application; all its versions share them.")
    imageDigest: ImageDigest | None = optional("Digest of its container image, where known.")


class ListRobotApplicationsRequest(ApplicationListRequest):
    """Asks for robot applications, newest first."""


class RobotApplicationSummary(Shape):
    """One robot application, or one version of it, in a list."""

    name: Name | None = optional("Its name.")
    arn: Arn | None = optional("ARN of the application, of all its versions.")
    version: Version | None = optional("Number of the version; `$LATEST` is what it is now.")
    lastUpdatedAt: LastUpdatedAt | None = optional("When it was last changed.")
    robotSoftwareSuite: RobotSoftwareSuite | None = optional("The robot software it is written for.")


class ListRobotApplicationsResponse(Shape):
    """A page of robot applications."""

    robotApplicationSummaries: (
        Annotated[list[RobotApplicationSummary], ShapeName("RobotApplicationSummaries", 0, 100)] | None
    ) = optional("Robot applications, newest first.")
    nextToken: PaginationToken | None = optional("Token of the next page; absent on the last.")


class UpdateRobotApplicationRequest(ApplicationUpdate):
    """Makes a robot application what the request says, whatever it was; its name and versions stay."""


class UpdateRobotApplicationResponse(ApplicationRevision):
    """The application as it is now."""


class DeleteRobotApplicationRequest(ApplicationSelection):
    """Removes a robot application with all its versions, or one version of it."""


class DeleteRobotApplicationResponse(Shape):
    """Nothing: what was to be removed is not there any more."""


OPERATIONS = application_operations(
    "robot",
    create=CreateRobotApplicationRequest,
    create_version=CreateRobotApplicationVersionRequest,
    describe=DescribeRobotApplicationRequest,
    list_page=ListRobotApplicationsRequest,
    update=UpdateRobotApplicationRequest,
    delete=DeleteRobotApplicationRequest,
)
