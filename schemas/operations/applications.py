"""Shapes that robot applications and simulation applications share: sources, environments and versions."""

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from ..wire.base import Shape, ShapeName, optional
from ..wire.common import (
    ApplicationReference,
    Architecture,
    Arn,
    Filters,
    LastUpdatedAt,
    MaxResults,
    Name,
    PaginationToken,
    S3Bucket,
    S3Etag,
    S3Key,
    Version,
    exactly_one,
    text,
)
from ..wire.job_configs import Boolean
from ..wire.operation_shape import (
    CREATE_APPLICATION_ERRORS,
    CREATE_VERSION_ERRORS,
    DELETE_APPLICATION_ERRORS,
    LIST_ERRORS,
    READ_ERRORS,
    UPDATE_APPLICATION_ERRORS,
    OperationShape,
)

RobotSoftwareSuiteType = Annotated[Literal["ROS", "ROS2", "General"], ShapeName("RobotSoftwareSuiteType")]
RobotSoftwareSuiteVersionType = Annotated[
    Literal["Kinetic", "Melodic", "Dashing", "Foxy"], ShapeName("RobotSoftwareSuiteVersionType")
]
RepositoryUrl = Annotated[str, ShapeName("RepositoryUrl"), text(1, 1024)]
RevisionId = Annotated[str, ShapeName("RevisionId"), text(1, 40, r"[a-zA-Z0-9_.\-]*")]
ImageDigest = Annotated[str, ShapeName("ImageDigest"), text(0, 72, "[Ss][Hh][Aa]256:[0-9a-fA-F]{64}")]
VersionQualifier = Annotated[str, ShapeName("VersionQualifier"), text(1, 255, "ALL")]
S3Etags = Annotated[list[S3Etag], ShapeName("S3Etags")]


class RobotSoftwareSuite(Shape):
    """Name and version of the robot software (such as ROS) that a robot application is written for."""

    name: RobotSoftwareSuiteType | None = optional("The suite; `General` for anything.")
    version: RobotSoftwareSuiteVersionType | None = optional("Its distribution.")


class SourceConfig(Shape):
    """Location of an archive with an application's files, as a request gives it."""

    s3Bucket: S3Bucket | None = optional("Bucket of the archive.")
    s3Key: S3Key | None = optional("Key of the archive: .tar, .tar.gz or .zip.")
    architecture: Architecture | None = optional("Processor it was built for.")


class Source(SourceConfig):
    """Location and ETag of an application's archive, as a response reports it."""

    etag: S3Etag | None = optional("Identifies the content it had.")


class Environment(Shape):
    """The Python package or container image of an application that has no archives."""

    uri: RepositoryUrl | None = optional("`python://package.module` for an installed package, or a container image.")


def _whole(sources: list[SourceConfig]) -> list[SourceConfig]:
    for index, source in enumerate(sources):
        if source.s3Bucket is None or source.s3Key is None:
            raise ValueError(f"source {index} needs both s3Bucket and s3Key")
    return sources


SourceConfigs = Annotated[list[SourceConfig], ShapeName("SourceConfigs"), AfterValidator(_whole)]
Sources = Annotated[list[Source], ShapeName("Sources")]


class ApplicationContent(Shape):
    """Members that requests to create or update an application share: its archives, environment and software suite."""

    sources: SourceConfigs | None = optional("Archives with its files, one per architecture.")
    robotSoftwareSuite: RobotSoftwareSuite = Field(description="The robot software it is written for.")
    environment: Environment | None = optional("Package or image of the application, instead of archives.")

    @model_validator(mode="after")
    def _one_content(self) -> Self:
        exactly_one(("sources", "environment"), (self.sources or None, self.environment and self.environment.uri))
        return self


class ApplicationRevision(Shape):
    """Members that responses about an application share: name, version, archives, environment and revision id."""

    arn: Arn | None = optional("ARN of the application, of all its versions.")
    name: Name | None = optional("Its name.")
    version: Version | None = optional("Number of the version; `$LATEST` is what it is now.")
    sources: Sources | None = optional("Archives with its files.")
    robotSoftwareSuite: RobotSoftwareSuite | None = optional("The robot software it is written for.")
    lastUpdatedAt: LastUpdatedAt | None = optional("When it was last changed.")
    revisionId: RevisionId | None = optional("Changes with every change of the application.")
    environment: Environment | None = optional("Package or image of the application, instead of archives.")


class ApplicationUpdate(ApplicationContent):
    """Members that the requests to update a robot application and a simulation application share."""

    application: ApplicationReference = Field(description="ARN or name of the application.")
    currentRevisionId: RevisionId | None = optional(
        "Revision that is to be changed; nothing is changed if it is another by now."
    )


class NewApplicationVersion(Shape):
    """Members of requests that save an application's current content as a numbered, unchangeable version."""

    application: ApplicationReference = Field(description="ARN or name of the application.")
    currentRevisionId: RevisionId | None = optional(
        "Revision that is to be kept; nothing is kept if it is another by now."
    )
    s3Etags: S3Etags | None = optional(
        "ETags that its archives are meant to have, in any order; nothing is kept otherwise."
    )
    imageDigest: ImageDigest | None = optional(
        "Digest that its container image is meant to have; nothing is kept otherwise."
    )


class ApplicationSelection(Shape):
    """Members of requests that name an application, or one version of it."""

    application: ApplicationReference = Field(description="ARN or name of the application.")
    applicationVersion: Version | None = optional("A version's number, or `$LATEST`.")


class ApplicationListRequest(Shape):
    """Members of requests that list applications: filters, page size and version qualifier."""

    versionQualifier: VersionQualifier | None = optional(
        "`ALL` for every version; absent: each application as it is now."
    )
    nextToken: PaginationToken | None = optional("Token of the page before, to go on after it.")
    maxResults: MaxResults | None = optional("Entries per page; absent: 100.")
    filters: Filters | None = optional("Filter by `name`; absent: all applications.")
    builtIn: Boolean | None = optional("Extension: `true` lists built-in applications, too.")


def application_operations(
    role: str,
    *,
    create: type[Shape],
    create_version: type[Shape],
    describe: type[Shape],
    list_page: type[Shape],
    update: type[Shape],
    delete: type[Shape],
) -> tuple[OperationShape, ...]:
    """Returns the six API operations on applications of one kind (robot or simulation).

    Args:
        role: `robot` or `simulation`.
        create: Request to register an application; the response class is found by its name.
        create_version: Request to save the current content as a numbered version.
        describe: Request to describe an application.
        list_page: Request to list applications.
        update: Request to replace an application's content.
        delete: Request to delete an application.
    """
    words = f"{role} application"
    return (
        OperationShape(create, CREATE_APPLICATION_ERRORS, f"Makes a {words} known under a name."),
        OperationShape(create_version, CREATE_VERSION_ERRORS, f"Keeps a {words} as it is now under a number."),
        OperationShape(describe, READ_ERRORS, f"Says what a {words}, or a version of it, is made of."),
        OperationShape(list_page, LIST_ERRORS, f"Lists {words}s, newest first."),
        OperationShape(update, UPDATE_APPLICATION_ERRORS, f"Makes a {words} something else, under the same name."),
        OperationShape(delete, DELETE_APPLICATION_ERRORS, f"Removes a {words}, or one version of it."),
    )
