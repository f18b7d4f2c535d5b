"""Robot applications: what drives the robot. Also the shapes that both kinds of application share."""

from collections.abc import Sequence
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from .base import Shape
from .common import Architecture, Arn, Name, S3Bucket, S3Etag, S3Key, TagMap, Timestamp, Version, exactly_one, text
from .operation_shape import CREATE_APPLICATION_ERRORS, OperationShape

RobotSoftwareSuiteType = Literal["ROS", "ROS2", "General"]
RobotSoftwareSuiteVersionType = Literal["Kinetic", "Melodic", "Dashing", "Foxy"]
RepositoryUrl = Annotated[str, text(1, 1024)]
RevisionId = Annotated[str, text(1, 40, r"[a-zA-Z0-9_.\-]*")]


class RobotSoftwareSuite(Shape):
    """The software a robot application is written for."""

    name: RobotSoftwareSuiteType | None = Field(default=None, description="The suite; `General` for anything.")
    version: RobotSoftwareSuiteVersionType | None = Field(default=None, description="Its distribution.")


class SourceConfig(Shape):
    """An archive with an application's files."""

    s3Bucket: S3Bucket | None = Field(default=None, description="Bucket of the archive.")
    s3Key: S3Key | None = Field(default=None, description="Key of the archive: .tar, .tar.gz or .zip.")
    architecture: Architecture | None = Field(default=None, description="Processor it was built for.")


class Source(SourceConfig):
    """An archive with an application's files, as it was found."""

    etag: S3Etag | None = Field(default=None, description="Identifies the content it had.")


class Environment(Shape):
    """What an application runs in, where it is no archive."""

    uri: RepositoryUrl | None = Field(
        default=None, description="`python://package.module` for an installed package, or a container image."
    )


def _whole(sources: list[SourceConfig]) -> list[SourceConfig]:
    for index, source in enumerate(sources):
        if source.s3Bucket is None or source.s3Key is None:
            raise ValueError(f"source {index} needs both s3Bucket and s3Key")
    return sources


SourceConfigs = Annotated[list[SourceConfig], AfterValidator(_whole)]


def check_content(sources: Sequence[SourceConfig] | None, environment: Environment | None) -> None:
    """Checks that an application's content is given in exactly one way.

    Raises:
      ValueError: neither or both of `sources` and `environment` say something.
    """
    exactly_one(("sources", "environment"), (sources or None, environment and environment.uri))


class CreateRobotApplicationRequest(Shape):
    """Orders a robot application."""

    name: Name = Field(description="Its name, unlike that of any other robot application.")
    sources: SourceConfigs | None = Field(default=None, description="Archives with its files, one per architecture.")
    robotSoftwareSuite: RobotSoftwareSuite = Field(description="The software it is written for.")
    tags: TagMap | None = Field(default=None, description="Tags for the application.")
    environment: Environment | None = Field(default=None, description="Where it comes from, instead of archives.")

    @model_validator(mode="after")
    def _one_content(self) -> Self:
        check_content(self.sources, self.environment)
        return self


class CreateRobotApplicationResponse(Shape):
    """The application that was made."""

    arn: Arn | None = Field(default=None, description="ARN of the application, of all its versions.")
    name: Name | None = Field(default=None, description="Its name.")
    version: Version | None = Field(default=None, description="`$LATEST`.")
    sources: list[Source] | None = Field(default=None, description="Archives with its files.")
    robotSoftwareSuite: RobotSoftwareSuite | None = Field(default=None, description="The software it is written for.")
    lastUpdatedAt: Timestamp | None = Field(default=None, description="When it was last changed.")
    revisionId: RevisionId | None = Field(default=None, description="Changes with every change of the application.")
    tags: TagMap | None = Field(default=None, description="Its tags.")
    environment: Environment | None = Field(default=None, description="Where it comes from, instead of archives.")


OPERATIONS = (
    OperationShape(
        "CreateRobotApplication",
        CreateRobotApplicationRequest,
        CreateRobotApplicationResponse,
        CREATE_APPLICATION_ERRORS,
        "Makes a robot application known under a name.",
    ),
)
