"""The documents of worlds, and of the templates and jobs that worlds come from and go into."""

from pydantic import ConfigDict, Field

from ..wire.base import optional
from .document_base import Changes, Document, FailureChanges, Part


class StoredPlace(Part):
    """Bucket and key prefix of a folder of files in the object store."""

    bucket: str = Field(description="Bucket.")
    prefix: str = Field(description="Prefix of all keys of its files; its last part names the content or run.")

    @property
    def last_part(self) -> str:
        """Last part of the key prefix: a content hash or the id of a run."""
        return self.prefix.rpartition("/")[2]


class WorldDocument(Document):
    """Catalog document of a world: its files in the object store, and the template it was generated from."""

    template: str | None = optional("ARN of the template it was generated from.")
    template_name: str | None = optional(
        "Name that the template had then, of which the world's name is made; absent: it had none, or an early release "
        "made the world."
    )
    plan: str | None = optional("Key of its plan; equal for equal plans. Absent in worlds of early releases.")
    bundle: StoredPlace | None = optional("Place of its bundle.")
    reused_from: str | None = optional("ARN of the world whose bundle it shares; absent: it was generated.")
    description_key: str | None = optional(
        "Key of its description in the bundle's bucket; worlds of early releases have none."
    )


class TemplateBody(Changes):
    """The part of a world template's document that changes when its body (the JSON description) is replaced."""

    version: str = Field(description="The body's version.")
    template_body: str = Field(description="The body as text, as it was given.")


class WorldTemplateDocument(TemplateBody, Document):
    """Catalog document of a world template, from which worlds are generated."""

    client_request_token: str | None = optional("Token of the request that created it.")


class StoredWorldCount(Part):
    """Requested size of a world generation job: number of floor plans, and of interiors for each floor plan."""

    floorplan_count: int = Field(description="Number of different floor plans.")
    interior_count_per_floorplan: int = Field(description="Number of furnished worlds for each of them.")

    @property
    def total(self) -> int:
        """Number of worlds in all: floor plans times interiors for each."""
        return self.floorplan_count * self.interior_count_per_floorplan


class WorldGenerationRequest(Part):
    """Request of a world generation job as the caller sent it; members that no code here reads are stored unchanged."""

    model_config = ConfigDict(extra="allow")

    template: str = Field(description="ARN of the template.")
    world_count: StoredWorldCount = Field(description="How many worlds.")
    world_tags: dict[str, str] | None = optional("Tags for every world.")
    client_request_token: str | None = optional("The request's token.")
    diversity: int = Field(default=1, description="0: all floor plans are the best one; 1: they differ.")


class WorldFailureCount(Part):
    """Number of worlds of a generation job that failed for the same reason, with the failure code."""

    failure_code: str = Field(description="The reason's code.")
    sample_failure_reason: str = Field(description="The reason in words, of one of them.")
    failure_count: int = Field(description="How many worlds.")


class WorldFailures(Part):
    """Summary of the failed worlds of a generation job, counted by failure code."""

    total_failure_count: int = Field(default=0, description="How many.")
    failures: list[WorldFailureCount] = Field(default=[], description="Failures by code, the most frequent first.")


class WorldGenerationProgress(FailureChanges):
    """Update to a world generation job's document that is written while the job runs and when it ends."""

    failures: WorldFailures | None = optional("Worlds that failed so far.")
    made_when_taken: int = Field(
        default=0, description="How many worlds there were when a job worker last took it over."
    )
    succeeded_worlds: list[str] | None = optional("ARNs of the worlds it made; absent until it ends.")
    plan_count: int | None = optional("Number of different plans among them; absent until it ends.")


class WorldGenerationJobDocument(WorldGenerationProgress, Document):
    """Catalog document of a world generation job: its request and progress."""

    request: WorldGenerationRequest = Field(description="The request.")
    template_body: str = Field(description="The template's body when the job was created.")
    template_name: str | None = optional("The template's name when the job was created; absent: it had none.")
    seed: int = Field(description="Seed that the worlds' seeds are drawn from.")
    reuse: bool = Field(default=False, description="Whether worlds that are there already are not generated again.")


class ArchiveLocation(Part):
    """Bucket and key prefix under which a world export job stores its archive, under the request's member names."""

    s3_bucket: str = Field(description="Bucket.")
    s3_prefix: str | None = optional("Prefix of its key.")


class WorldExportRequest(Part):
    """Request of a world export job as the caller sent it; members that no code here reads are stored unchanged."""

    model_config = ConfigDict(extra="allow")

    worlds: list[str] = Field(description="ARNs of the worlds.")
    output_location: ArchiveLocation = Field(description="Location of the archive.")
    iam_role: str = Field(description="ARN of the role.")
    client_request_token: str | None = optional("The request's token.")


class WorldExportProgress(FailureChanges):
    """Update to a world export job's document that is written while the job runs and when it ends."""

    started: bool = Field(default=False, description="Whether it began, so that there may be an archive.")


class WorldExportJobDocument(WorldExportProgress, Document):
    """Catalog document of a world export job, which packs worlds into an archive: its request and progress."""

    request: WorldExportRequest = Field(description="The request.")
