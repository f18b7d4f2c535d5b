"""The documents of worlds, and of the templates and jobs that worlds come from and go into."""

from pydantic import ConfigDict, Field

from ..wire.base import optional
from .base import Changes, Document, FailureChanges, Part


class StoredPlace(Part):
    """Place of a folder of files in the object store."""

    bucket: str = Field(description="Bucket.")
    prefix: str = Field(description="Prefix of all keys of its files; its last part names the content or run.")

    @property
    def last_part(self) -> str:
        """Last part of the prefix, which names the content or run."""
        return self.prefix.rpartition("/")[2]


class WorldDocument(Document):
    """A world."""

    template: str | None = optional("ARN of the template it was generated from.")
    bundle: StoredPlace | None = optional("Place of its bundle.")
    reused_from: str | None = optional("ARN of the world whose bundle it shares; absent: it was generated.")
    description_key: str | None = optional(
        "Key of its description in the bundle's bucket; worlds of early releases have none."
    )


class TemplateBody(Changes):
    """The members that a template's body decides."""

    version: str = Field(description="The body's version.")
    template_body: str = Field(description="The body as text, as it was given.")


class WorldTemplateDocument(TemplateBody, Document):
    """A world template."""

    client_request_token: str | None = optional("Token of the request that created it.")


class StoredWorldCount(Part):
    """How many worlds are requested."""

    floorplan_count: int = Field(description="Number of different floor plans.")
    interior_count_per_floorplan: int = Field(description="Number of furnished worlds for each of them.")

    @property
    def total(self) -> int:
        """How many worlds that are."""
        return self.floorplan_count * self.interior_count_per_floorplan


class WorldGenerationRequest(Part):
    """The request as the caller sent it; members that nothing here needs are kept as they are."""

    model_config = ConfigDict(extra="allow")

    template: str = Field(description="ARN of the template.")
    world_count: StoredWorldCount = Field(description="How many worlds.")
    world_tags: dict[str, str] | None = optional("Tags for every world.")
    client_request_token: str | None = optional("The request's token.")


class WorldFailureCount(Part):
    """Worlds that failed for one reason."""

    failure_code: str = Field(description="The reason's code.")
    sample_failure_reason: str = Field(description="The reason in words, of one of them.")
    failure_count: int = Field(description="How many worlds.")


class WorldFailures(Part):
    """Worlds that failed, summed up by code."""

    total_failure_count: int = Field(default=0, description="How many.")
    failures: list[WorldFailureCount] = Field(default=[], description="Failures by code, the most frequent first.")


class WorldGenerationProgress(FailureChanges):
    """Members that are recorded while a world generation job runs, and when it ends."""

    failures: WorldFailures | None = optional("Worlds that failed so far.")
    made_when_taken: int = Field(
        default=0, description="How many worlds there were when a job worker last took it over."
    )
    succeeded_worlds: list[str] | None = optional("ARNs of the worlds it made; absent until it ends.")


class WorldGenerationJobDocument(WorldGenerationProgress, Document):
    """A world generation job."""

    request: WorldGenerationRequest = Field(description="The request.")
    template_body: str = Field(description="The template's body when the job was created.")
    seed: int = Field(description="Seed that the worlds' seeds are drawn from.")
    reuse: bool = Field(default=False, description="Whether worlds that are there already are not generated again.")


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
