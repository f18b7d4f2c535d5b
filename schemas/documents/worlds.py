"""Catalog documents of worlds, and of their templates, generation jobs and export jobs."""

from pydantic import ConfigDict, Field

from ..wire.base import optional
from .document_base import Changes, Document, FailureChanges, Part


class StoredPlace(Part):
    """Bucket and key prefix of a folder of files in the object store."""

    bucket: str = Field(description="Name of the bucket.")
    prefix: str = Field(description="Prefix of the files' keys; its last part is a content hash or a run id.")

    @property
    def last_part(self) -> str:
        """Last part of the key prefix: a content hash or the id of a run."""
        return self.prefix.rpartition("/")[2]


class WorldDocument(Document):
    """Catalog document of a world: its files in the object store, and the template it was generated from."""

    name: str | None = optional("Name that an import gave the world; absent: it is called by its template, or its id.")
    template: str | None = optional("ARN of the template from which the world was generated.")
    template_name: str | None = optional(
        "Name that the template had then, of which the world's name is made; absent: it had none, or an early release "
        "made the world."
    )
    plan: str | None = optional(
        "Key of the world's floor plan; equal for equal plans. Absent in worlds of early releases."
    )
    bundle: StoredPlace | None = optional("Place of the world's files in the object store.")
    reused_from: str | None = optional("ARN of the world whose files are shared; absent: the world has its own.")
    description_key: str | None = optional("Key of the world's description; worlds of early releases have none.")


class TemplateBody(Changes):
    """The part of a world template's document that changes when its body (the JSON description) is replaced."""

    version: str = Field(description="Version of the template body.")
    template_body: str = Field(description="Body as the JSON text that was given.")


class WorldTemplateDocument(TemplateBody, Document):
    """Catalog document of a world template, from which worlds are generated."""

    client_request_token: str | None = optional("Client token of the request that created the template.")


class StoredWorldCount(Part):
    """Requested size of a world generation job: number of floor plans, and of interiors for each floor plan."""

    floorplan_count: int = Field(description="Number of different floor plans.")
    interior_count_per_floorplan: int = Field(description="Number of furnished worlds for each floor plan.")

    @property
    def total(self) -> int:
        """Number of worlds in all: floor plans times interiors for each."""
        return self.floorplan_count * self.interior_count_per_floorplan


class WorldGenerationRequest(Part):
    """Request of a world generation job as the caller sent it; members that no code here reads are stored unchanged."""

    model_config = ConfigDict(extra="allow")

    template: str = Field(description="ARN of the template.")
    world_count: StoredWorldCount = Field(description="Number of worlds to generate.")
    world_tags: dict[str, str] | None = optional("Tags for every world.")
    client_request_token: str | None = optional("Client token of the request.")
    diversity: int = Field(
        default=1, description="Variety of the floor plans, from 0 (all are the best one) to 1 (they differ)."
    )


class WorldFailureCount(Part):
    """Number of worlds of a generation job that failed for the same reason, with the failure code."""

    failure_code: str = Field(description="Failure code.")
    sample_failure_reason: str = Field(description="Reason of one of the failures, as text.")
    failure_count: int = Field(description="Number of worlds that failed with this code.")


class WorldFailures(Part):
    """Summary of the failed worlds of a generation job, counted by failure code."""

    total_failure_count: int = Field(default=0, description="Number of failed worlds.")
    failures: list[WorldFailureCount] = Field(default=[], description="Failures by code, the most frequent first.")


class WorldGenerationProgress(FailureChanges):
    """Update to a world generation job's document that is written while the job runs and when it ends."""

    failures: WorldFailures | None = optional("Worlds that failed so far, by reason.")
    made_when_taken: int = Field(
        default=0, description="Number of worlds that existed when a job worker last took the job over."
    )
    succeeded_worlds: list[str] | None = optional("ARNs of the generated worlds; absent until the job ends.")
    plan_count: int | None = optional("Number of different floor plans among the worlds; absent until the job ends.")


class WorldGenerationJobDocument(WorldGenerationProgress, Document):
    """Catalog document of a world generation job: its request and progress."""

    request: WorldGenerationRequest = Field(description="Request of the job.")
    template_body: str = Field(description="Body of the template when the job was created.")
    template_name: str | None = optional("The template's name when the job was created; absent: it had none.")
    seed: int = Field(description="Random seed from which the worlds' seeds are derived.")
    reuse: bool = Field(default=False, description="Whether existing worlds with the same inputs are reused.")


class ArchiveLocation(Part):
    """Bucket and key prefix under which a world export job stores its archive, under the request's member names."""

    s3_bucket: str = Field(description="Name of the bucket.")
    s3_prefix: str | None = optional("Prefix of the archive's key.")


class WorldExportRequest(Part):
    """Request of a world export job as the caller sent it; members that no code here reads are stored unchanged."""

    model_config = ConfigDict(extra="allow")

    worlds: list[str] = Field(description="ARNs of the worlds to export.")
    output_location: ArchiveLocation = Field(description="Location of the archive in the object store.")
    iam_role: str = Field(description="ARN of the role with which the archive is written.")
    client_request_token: str | None = optional("Client token of the request.")


class WorldExportProgress(FailureChanges):
    """Update to a world export job's document that is written while the job runs and when it ends."""

    started: bool = Field(default=False, description="Whether writing has begun, so that there may be an archive.")


class WorldExportJobDocument(WorldExportProgress, Document):
    """Catalog document of a world export job, which packs worlds into an archive: its request and progress."""

    request: WorldExportRequest = Field(description="Request of the job.")
