"""The documents of simulation jobs and of their batches: requests, facts fixed at creation, and progress."""

from collections.abc import Mapping
from datetime import datetime
from typing import Any, Literal

from pydantic import ConfigDict, Field

from ..runs.plan import Verdict
from ..runs.programs import Scarce
from ..wire.base import optional
from .document_base import Brief, Changes, Document, FailureChanges, Json, Part
from .worlds import StoredPlace

OutcomeStatus = Literal["Completed", "Failed", "Canceled"]


class Outcome(Part):
    """Final status of a simulation job with its verdict and failure, to be written into the job's document."""

    status: OutcomeStatus = Field(description="Terminal status of the job.")
    failure_code: str | None = optional("The service's failure code; absent when none.")
    failure_reason: str | None = optional("The same in words.")
    simulation_time_millis: int | None = optional("How long the run took; absent: none ran.")
    cpu_time_s: float | None = optional("CPU time that the run took; absent: not known.")
    video_s: float | None = optional("How long videos of its failure were made; absent: none.")
    upload_s: float | None = optional("How long its outputs were stored; absent: not known.")
    verdict: Verdict | None = optional("Verdict of its result; absent: none was written.")
    verdict_reason: str | None = optional("Why the verdict is FAIL or ERROR, in words.")
    outputs: StoredPlace | None = optional("Place of its stored outputs; absent: they are not stored.")

    def changes(self) -> "SimulationJobProgress":
        """Returns the update that this outcome makes to the simulation job's document: verdict and failure.

        The status is not part of the document.
        """
        # One that lost its outputs after its run was judged has lost the verdict with them; a cancelled one has none.
        lost = {} if self.status == "Completed" else {"verdict": None, "verdict_reason": None}
        return SimulationJobProgress(**lost, **self._members())

    def about_run(self) -> dict[str, Any]:
        """Returns the members that this outcome adds to the manifest of the output files.

        The verdict is in `result.json` beside it.
        """
        left_out: dict[str, None] = dict.fromkeys(("verdict", "verdict_reason", "video_s", "upload_s"))
        return self.model_copy(update=left_out).to_json()

    def announced(self, *, finished: bool | None) -> "SimulationJobProgress":
        """Returns the document update for a job whose simulation has ended but whose outputs are not uploaded yet.

        Args:
            finished: whether the run wrote its outputs to the end; `None`: there are none.
        """
        run = {} if finished is None else {"finished": finished}
        return SimulationJobProgress(outcome=self, **run, **self._members())

    def _members(self) -> dict[str, Any]:
        return {name: value for name in _OF_JOB if (value := getattr(self, name)) is not None}


_OF_JOB = (
    *("failure_code", "failure_reason", "verdict", "verdict_reason"),
    *("simulation_time_millis", "cpu_time_s", "video_s", "upload_s", "outputs"),
)


class EarlierRun(Part):
    """An earlier run of a simulation job that ran more than once: when it began, how it ended, and its outputs."""

    run_id: str = Field(description="Id of the run.")
    started_at: str | None = optional("When it began.")
    status: OutcomeStatus = Field(description="How it finished.")
    failure_code: str | None = optional("The service's failure code; absent when none.")
    failure_reason: str | None = optional("The same in words.")
    simulation_time_millis: int | None = optional("How long it took; absent: not known.")
    restarted: bool = Field(default=False, description="Whether it ended for a restart of the job.")
    outputs: StoredPlace | None = optional("Place of its stored outputs; absent: they are not stored.")
    not_stored: str | None = optional("Why its outputs are not stored; absent if they are.")


class StoredNetworkInterface(Part):
    """The network address of a simulation job, as the service's responses report it."""

    network_interface_id: str = Field(description="Its id.")
    private_ip_address: str = Field(description="Address inside the network.")
    public_ip_address: str = Field(description="Address from outside.")


class ResolvedKey(Part):
    """One object of a job's data source, with the ETag that it had when the job was created."""

    s3_key: str = Field(description="Its key.")
    etag: str | None = optional("Its ETag when the job was created; absent: the job's role could not read it.")


class ResolvedDataSource(Part):
    """A data source of a simulation job, with the list of objects found when the job was created."""

    model_config = ConfigDict(extra="allow")

    name: str = Field(description="Its name, a folder in the folder of data sources.")
    type: str = Field(default="File", description="`File`, `Archive` or `Prefix`.")
    s3_bucket: str = Field(description="Bucket.")
    s3_keys: list[ResolvedKey] = Field(description="Its objects.")
    destination: str | None = optional("Path at which applications find it; absent: by its name.")


ARCHIVE = "archive "
"""Prefix in `MadeOf` of an application that was an archive; the archive's ETag follows."""


class MadeOf(Part):
    """Hashes of the world and applications that a simulation job's request names, taken when its run was prepared.

    Two runs can be compared by them.
    """

    world: str | None = optional("Hash of the content of its world's bundle; absent: no world.")
    robot: str | None = optional("Content of its robot application: archive, image or package; absent: it names none.")
    simulation: str | None = optional("Content of its simulation application; likewise.")
    versions: dict[str, str] = Field(default={}, description="Versions of what ran it.")
    once_only: str | None = optional("Why the same inputs may have another result; absent: they have the same.")

    @property
    def robot_etag(self) -> str | None:
        """ETag of the robot application's archive; `None` if there was no robot application or no archive."""
        return self.etags.get("robot")

    @property
    def etags(self) -> dict[str, str]:
        """ETags of those of its applications that were archives, by role."""
        contents = {"robot": self.robot, "simulation": self.simulation}
        return {
            role: content.removeprefix(ARCHIVE)
            for role, content in contents.items()
            if content is not None and content.startswith(ARCHIVE)
        }


class ReusedFrom(Part):
    """The earlier simulation job whose results a job took over instead of running."""

    job: str = Field(description="ARN of the job that ran.")
    spec_run: str | None = optional("The run of a specification that ordered it.")


class SimulationJobProgress(FailureChanges):
    """Update to a simulation job's document that is written while the job runs and when it ends."""

    run_id: str | None = optional("Id of its last run; absent: it has not run.")
    last_started_at: str | None = optional("When that run began.")
    network_interface: StoredNetworkInterface | None = optional("Network of that run.")
    reached_s: float = Field(
        default=0.0, description="How far its runs had come when one went on, in simulated seconds."
    )
    waited_s: dict[Scarce, float] = Field(
        default={},
        description="How long it waited for a machine before its last run, in seconds, by what the machine had too "
        "little of; waits of less than a second, and those for jobs of its own batch, are left out.",
    )
    attempts: int = Field(default=1, description="How often that run was begun: again after a crash of its worker.")
    simulation_time_millis: int | None = optional("How long its last run took.")
    cpu_time_s: float | None = optional(
        "CPU time of all processes of that run; absent: not known, or it was taken over."
    )
    simulated_at: str | None = optional(
        "When the programs of its last run had ended, so that it only draws and stores; absent: not yet."
    )
    video_s: float | None = optional(
        "How long videos of that run's failure were made, by the clock; absent: none were."
    )
    upload_s: float | None = optional("How long its outputs were stored, by the clock; absent: not known, or not yet.")
    verdict: Verdict | None = optional("Verdict of its last run; absent: it has no result, or was canceled.")
    verdict_reason: str | None = optional("Why the verdict is FAIL or ERROR, in words.")
    outcome: Outcome | None = Field(
        default=None,
        validation_alias="ending",
        serialization_alias="ending",
        description="How it finished, known before its outputs are stored.",
    )
    trials_finished: int | None = optional(
        "How many trials of the last run had finished when it was last asked; absent: none."
    )
    finished: bool | None = optional("Whether the last run wrote its outputs to the end; absent: no run ended.")
    outputs: StoredPlace | None = optional("Place of the stored outputs of its last run.")
    call_key: str | None = optional("Key with which the code of its last run calls the service, until that run ends.")
    upload_canceled: bool = Field(
        default=False,
        description="Whether a job that had been cancelled was cancelled again while its outputs were stored.",
    )
    earlier_runs: list[EarlierRun] = Field(default=[], description="Its runs before the last one, oldest first.")
    made_of: MadeOf | None = optional("Contents that its last run was made of; absent: it has not run.")

    @classmethod
    def begun(cls, run_id: str, waited_s: Mapping[Scarce, float], call_key: str) -> "SimulationJobProgress":
        """Returns the document update for a new run of a simulation job.

        It clears the failure and verdict of an earlier run.

        Args:
            run_id: id of the run.
            waited_s: see `waited_s`.
            call_key: see `call_key`.
        """
        return cls(
            run_id=run_id,
            waited_s=dict(waited_s),
            call_key=call_key,
            outcome=None,
            finished=None,
            failure_code=None,
            failure_reason=None,
            verdict=None,
            verdict_reason=None,
            reached_s=0.0,
            trials_finished=None,
            simulated_at=None,
            video_s=None,
            upload_s=None,
        )

    @property
    def started_at(self) -> datetime | None:
        """Time at which the job's last run began; `None` if it never ran."""
        return datetime.fromisoformat(self.last_started_at) if self.last_started_at else None


class JobTrials(Changes):
    """The number of finished trials of a simulation job, which a batch reads for its progress."""

    request_index: int | None = optional("Place of its request in its batch.")
    trials_finished: int | None = optional("How many trials had finished when it was asked.")


class JobInBrief(FailureChanges, Brief):
    """The few members of a simulation job which the web console's live pages read instead of the whole document."""

    simulation_application_names: list[str] = Field(default=[], description="Names of its simulation applications.")
    robot_application_names: list[str] = Field(default=[], description="Names of its robot applications.")
    world_name: str | None = optional("Name of its world, as people see it.")
    request_index: int | None = optional("Place of its request in its batch.")
    last_started_at: str | None = optional("When its last run began.")
    simulated_at: str | None = optional("When its programs had ended.")
    waited_s: dict[Scarce, float] = Field(default={}, description="How long it waited for a machine, by what lacked.")
    video_s: float | None = optional("How long videos of its failure were made.")
    upload_s: float | None = optional("How long its outputs were stored.")
    simulation_time_millis: int | None = optional("How long its last run took.")
    verdict: Verdict | None = optional("Verdict of its last run.")
    verdict_reason: str | None = optional("Why the verdict is FAIL or ERROR, in words.")
    video: Literal["none", "on-failure", "always"] = Field(default="none", description="When a video is written.")
    outputs: StoredPlace | None = optional("Place of the stored outputs of its last run.")
    run_id: str | None = optional("Id of its last run.")


class SimulationJobDocument(SimulationJobProgress, Document):
    """Catalog document of a simulation job: its request, resolved inputs, progress and outcome."""

    request: Json = Field(description="The request on the wire: a `SimulationJobOrder`.")
    request_index: int | None = optional("Place of its request in its batch; absent: no batch.")
    seed: int = Field(description="Seed of the run's random generators.")
    video: Literal["none", "on-failure", "always"] = Field(default="none", description="When a video is written.")
    requirements: list[dict[str, Any]] = Field(default=[], description="Requirements that the run is judged by.")
    trials: dict[str, Any] | None = optional("Its trials: `Trials`; absent: one episode.")
    data_sources: list[ResolvedDataSource] | None = optional("Its data, found.")
    simulation_application_names: list[str] = Field(default=[], description="Names of its simulation applications.")
    robot_application_names: list[str] = Field(default=[], description="Names of its robot applications.")
    world_name: str | None = optional("Name of its world, as people see it: `flat 3`; absent: it has no world.")
    application_arns: dict[str, str] = Field(
        default={}, description="ARNs of applications that its request names barely, by role and name: `robot scout`."
    )
    spec_run: str | None = optional("Id of the run of a specification that ordered it.")
    reused_from: ReusedFrom | None = optional("Job whose results it took over; absent: it ran.")


class StoredBatchPolicy(Part):
    """Limits of a simulation job batch (concurrency, timeout, priority), with the defaults filled in."""

    timeout_in_seconds: int = Field(description="Seconds after which it stops.")
    max_concurrency: int = Field(description="How many of its jobs run at once.")
    priority: int | None = optional("On each machine jobs of batches with a higher one begin first; absent: 0.")


class FailedRequest(Part):
    """A request in a simulation job batch for which no job could be created, and why."""

    failure_code: str = Field(description="Why, a failure code of the service.")
    failure_reason: str = Field(description="The same in words.")
    failed_at: str = Field(description="When that was found out.")

    @property
    def time(self) -> datetime:
        """Time at which the request failed."""
        return datetime.fromisoformat(self.failed_at)


class BatchCounts(Changes):
    """Numbers of jobs and requests of a batch, which lists read instead of the whole document."""

    request_count: int = Field(description="How many requests it has.")
    failed_count: int = Field(default=0, description="How many of them never become jobs.")


class BatchProgress(FailureChanges):
    """Update to a simulation job batch's document that is written while the batch runs and when it ends."""

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
    """The few members of a simulation job batch which the web console reads instead of the whole document."""

    request_count: int = Field(description="How many requests it has.")
    failed: dict[str, FailedRequest] = Field(default={}, description="Requests that never become jobs, by place.")
    batch_policy: StoredBatchPolicy = Field(description="How it is run.")
    verdicts: dict[str, int] | None = optional(
        "How many of its jobs that are Completed have which verdict; absent until it ends."
    )
    spec_run: str | None = optional("Id of the run of a specification that ordered it.")


class SimulationJobBatchDocument(BatchProgress, BatchCounts, Document):
    """Catalog document of a simulation job batch: its job requests, limits and progress."""

    request: Json = Field(description="The request on the wire: a `StartSimulationJobBatchRequest`.")
    batch_policy: StoredBatchPolicy = Field(description="How it is run.")
    spec_run: str | None = optional("Id of the run of a specification that ordered it.")
    reuse: bool = Field(default=False, description="Whether its jobs take over results of earlier ones.")
    in_campaign: bool = Field(
        default=False,
        description="Whether it is one of several batches of a step; Prefect then has one task run of its jobs.",
    )
    mixed: bool = Field(
        default=False,
        description="Whether its requests become jobs in a mixed order, since it may end before all of them ran.",
    )

    @property
    def requests(self) -> list[Json]:
        """The batch's requests for simulation jobs, as JSON in the service's format, in order."""
        return self.request["createSimulationJobRequests"]
