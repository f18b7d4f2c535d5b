"""Catalog document of an application, and of a numbered version of one."""

from pydantic import ConfigDict, Field

from ..wire.base import optional
from .document_base import Document, Json, Part


class StoredSource(Part):
    """An application's archive as the catalog stores it: bucket, key, processor architecture and ETag."""

    model_config = ConfigDict(extra="allow")

    s3_bucket: str = Field(description="Name of the archive's bucket.")
    s3_key: str = Field(description="Key of the archive.")
    architecture: str | None = optional("Processor architecture of the archive's programs; absent: any.")
    etag: str = Field(description="ETag of the archive when the application or its version was created.")


class StoredEnvironment(Part):
    """The installed Python package or container image of an application without archives, as the catalog stores it."""

    uri: str = Field(description="`python://package.module`, or the name of the container image.")


class ApplicationDocument(Document):
    """Catalog document of a robot or simulation application: its current content, or one numbered version of it."""

    sources: list[StoredSource] | None = optional("Archives of the application; absent: it has none.")
    environment: StoredEnvironment | None = optional(
        "Package or container image instead of archives; absent: the application has archives."
    )
    robot_software_suite: Json | None = optional("Robot software (such as ROS) that the application uses.")
    simulation_software_suite: Json | None = optional("Simulator that the application uses.")
    rendering_engine: Json | None = optional("Rendering engine that the application uses.")
    image_digest: str | None = optional("Digest of the container image, if known.")
    version: str = Field(description="`$LATEST`, or the number of the version.")
    revision_id: str = Field(description="Id that changes with each change of the application.")
    last_number: int | None = optional("Number of the last version; counted by the catalog.")
