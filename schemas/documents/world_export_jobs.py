"""The document of a world export job."""

from pydantic import ConfigDict, Field

from ..wire.base import optional
from .base import Document, FailureChanges, Part


class ArchiveLocation(Part):
    """Location of the archive in the object store, by the names of the request."""

    s3_bucket: str = Field(description="Bucket.")
    s3_prefix: str | None = optional("Prefix of its key.")


class WorldExportRequest(Part):
    """The request as the caller sent it; members that nothing here needs are kept as they are."""

    model_config = ConfigDict(extra="allow")

    worlds: list[str] = Field(description="ARNs of the worlds.")
    output_location: ArchiveLocation = Field(description="Location of the archive.")
    iam_role: str = Field(description="ARN of the role.")
    client_request_token: str | None = optional("The request's token.")


class WorldExportProgress(FailureChanges):
    """Members that are recorded while a world export job runs, and when it ends."""

    started: bool = Field(default=False, description="Whether it began, so that there may be an archive.")


class WorldExportJobDocument(WorldExportProgress, Document):
    """A world export job."""

    request: WorldExportRequest = Field(description="The request.")
