"""The document of a simulation job batch. It may have hundreds of requests: they are kept as they are, unchecked."""

from datetime import datetime

from pydantic import Field

from ..wire.base import optional
from .base import Brief, Changes, Document, FailureChanges, Json, Part


class StoredBatchPolicy(Part):
    """How a batch is run, with the defaults that held when it was created."""

    timeout_in_seconds: int = Field(description="Seconds after which it stops.")
    max_concurrency: int = Field(description="How many of its jobs run at once.")
    priority: int | None = optional("On each machine jobs of batches with a higher one begin first; absent: 0.")


class FailedRequest(Part):
    """A request that never becomes a job."""

    failure_code: str = Field(description="Why, a failure code of the service.")
    failure_reason: str = Field(description="The same in words.")
    failed_at: str = Field(description="When that was found out.")

    @property
    def time(self) -> datetime:
        """When that was found out."""
        return datetime.fromisoformat(self.failed_at)


class BatchCounts(Changes):
    """Counts that lists read instead of the whole batch."""

    request_count: int = Field(description="How many requests it has.")
    failed_count: int = Field(default=0, description="How many of them never become jobs.")


class BatchProgress(FailureChanges):
    """Members that are recorded while a batch runs, and when it ends."""

    failed: dict[str, FailedRequest] = Field(default={}, description="Requests that never become jobs, by place.")
    failed_count: int = Field(default=0, description="How many those are.")
    concurrency: int | None = optional(
        "How many of its jobs may be held at once by the job workers of a backend, right now."
    )
    ended_when_taken: int = Field(
        default=0, description="How many of its jobs had ended when a job worker last took it over."
    )
    verdicts: dict[str, int] | None = optional(
        "How many of its jobs that are Completed have which verdict; absent until it ends."
    )


class BatchInBrief(FailureChanges, Brief):
    """Members of a batch that the console reads."""

    request_count: int = Field(description="How many requests it has.")
    failed: dict[str, FailedRequest] = Field(default={}, description="Requests that never become jobs, by place.")
    batch_policy: StoredBatchPolicy = Field(description="How it is run.")
    verdicts: dict[str, int] | None = optional(
        "How many of its jobs that are Completed have which verdict; absent until it ends."
    )
    spec_run: str | None = optional("Id of the run of a specification that ordered it.")


class SimulationJobBatchDocument(BatchProgress, BatchCounts, Document):
    """A simulation job batch."""

    request: Json = Field(description="The request on the wire: a `StartSimulationJobBatchRequest`.")
    batch_policy: StoredBatchPolicy = Field(description="How it is run.")
    spec_run: str | None = optional("Id of the run of a specification that ordered it.")
    reuse: bool = Field(default=False, description="Whether its jobs take over results of earlier ones.")
    in_campaign: bool = Field(
        default=False,
        description="Whether it is one of several batches of a step; Prefect then has one task run of its jobs.",
    )

    @property
    def requests(self) -> list[Json]:
        """The requests of its jobs on the wire, in order."""
        return self.request["createSimulationJobRequests"]
