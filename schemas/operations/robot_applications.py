"""Operations on robot applications: the programs that control a robot."""

from typing import Annotated

from pydantic import Field

from ..wire.base import Shape, ShapeName, optional
from ..wire.common import Arn, LastUpdatedAt, Name, PaginationToken, Version
from ..wire.tags import TagMap
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
    """Request of `CreateRobotApplication`: registers a robot application (the program that controls a robot)."""

    name: Name = Field(description="Its name, unlike that of any other robot application.")
    tags: TagMap | None = optional("Tags for the application.")


class CreateRobotApplicationResponse(ApplicationRevision):
    """Response of `CreateRobotApplication`: the application that was created."""

    tags: TagMap | None = optional("Its tags.")


class CreateRobotApplicationVersionRequest(NewApplicationVersion):
    """Request of `CreateRobotApplicationVersion`: saves a robot application's current content as a numbered version."""


class CreateRobotApplicationVersionResponse(ApplicationRevision):
    """Response of `CreateRobotApplicationVersion`: the numbered version that was created."""


class DescribeRobotApplicationRequest(ApplicationSelection):
    """Request of `DescribeRobotApplication`: names the robot application, or one version of it, to describe."""


class DescribeRobotApplicationResponse(ApplicationRevision):
    """Response of `DescribeRobotApplication`: one robot application, or one version of it."""

    tags: TagMap | None = optional("Tags of the application; all its versions share them.")
    imageDigest: ImageDigest | None = optional("Digest of its container image, where known.")


class ListRobotApplicationsRequest(ApplicationListRequest):
    """Request of `ListRobotApplications`: asks for a page of robot applications, newest first."""


class RobotApplicationSummary(Shape):
    """Summary of a robot application, or of one version of it, as `ListRobotApplications` shows it."""

    name: Name | None = optional("Its name.")
    arn: Arn | None = optional("ARN of the application, of all its versions.")
    version: Version | None = optional("Number of the version; `$LATEST` is what it is now.")
    lastUpdatedAt: LastUpdatedAt | None = optional("When it was last changed.")
    robotSoftwareSuite: RobotSoftwareSuite | None = optional("The robot software it is written for.")


class ListRobotApplicationsResponse(Shape):
    """Response of `ListRobotApplications`: one page of robot applications."""

    robotApplicationSummaries: (
        Annotated[list[RobotApplicationSummary], ShapeName("RobotApplicationSummaries", 0, 100)] | None
    ) = optional("Robot applications, newest first.")
    nextToken: PaginationToken | None = optional("Token of the next page; absent on the last.")


class UpdateRobotApplicationRequest(ApplicationUpdate):
    """Request of `UpdateRobotApplication`: replaces a robot application's whole content; its name and versions stay."""


class UpdateRobotApplicationResponse(ApplicationRevision):
    """Response of `UpdateRobotApplication`: the updated application."""


class DeleteRobotApplicationRequest(ApplicationSelection):
    """Request of `DeleteRobotApplication`: deletes a robot application with all its versions, or one version of it."""


class DeleteRobotApplicationResponse(Shape):
    """Response of `DeleteRobotApplication`: empty, the application or version is deleted."""


OPERATIONS = application_operations(
    "robot",
    create=CreateRobotApplicationRequest,
    create_version=CreateRobotApplicationVersionRequest,
    describe=DescribeRobotApplicationRequest,
    list_page=ListRobotApplicationsRequest,
    update=UpdateRobotApplicationRequest,
    delete=DeleteRobotApplicationRequest,
)
