"""Catalog documents of simulation jobs and of their batches: requests, facts fixed at creation, and progress."""

from collections.abc import Mapping
from datetime import datetime
from typing import Any, Literal

from pydantic import ConfigDict, Field

from ..runs.plan import Judged, Verdict
from ..runs.programs import Scarce
from ..runs.trials import TrialRecordings
from ..wire.base import optional
from .document_base import Brief, Changes, Document, FailureChanges, Json, Part
from .worlds import StoredPlace

OutcomeStatus = Literal["Completed", "Failed", "Canceled"]


class Outcome(Part):
    """Final status of a simulation job with its verdict and failure, to be written into the job's document."""

    status: OutcomeStatus = Field(description="Final status of the job.")
    failure_code: str | None = optional("Failure code of the job; absent if it did not fail.")
    failure_reason: str | None = optional("Reason of the failure as text.")
    simulation_time_millis: int | None = optional("Wall-clock seconds of the run; absent: none ran.")
    cpu_time_s: float | None = optional("CPU seconds of the run; absent: unknown.")
    video_s: float | None = optional("Wall-clock seconds for rendering videos of the failure; absent: none.")
    upload_s: float | None = optional("Wall-clock seconds for storing the outputs; absent: unknown.")
    verdict: Verdict | None = optional("Verdict of the run's result; absent: there is no result.")
    verdict_reason: str | None = optional("Reason of the verdict FAIL or ERROR, as text.")
    judged: Judged | None = optional("Numbers behind the verdict; absent: there is none.")
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
        left_out: dict[str, None] = dict.fromkeys(("verdict", "verdict_reason", "judged", "video_s", "upload_s"))
        return self.model_copy(update=left_out).to_json()

    def announced(self, *, finished: bool | None) -> "SimulationJobProgress":
        """Returns the document update for a job whose simulation has ended but whose outputs are not uploaded yet.

        Args:
            finished: Whether the run wrote its outputs to the end; `None`: there are none.
        """
        run = {} if finished is None else {"finished": finished}
        return SimulationJobProgress(outcome=self, **run, **self._members())

    def _members(self) -> dict[str, Any]:
        return {name: value for name in _OF_JOB if (value := getattr(self, name)) is not None}


_OF_JOB = (
    *("failure_code", "failure_reason", "verdict", "verdict_reason", "judged"),
    *("simulation_time_millis", "cpu_time_s", "video_s", "upload_s", "outputs"),
)


class EarlierRun(Part):
    """An earlier run of a simulation job that ran more than once: when it began, how it ended, and its outputs."""

    run_id: str = Field(description="Id of the run.")
    started_at: str | None = optional("Begin of the run.")
    status: OutcomeStatus = Field(description="Verdict and failure of the run.")
    failure_code: str | None = optional("Failure code of the run; absent if it did not fail.")
    failure_reason: str | None = optional("Reason of the failure as text.")
    simulation_time_millis: int | None = optional("Wall-clock seconds of the run; absent: unknown.")
    restarted: bool = Field(default=False, description="Whether the run ended because the job was restarted.")
    outputs: StoredPlace | None = optional("Place of its stored outputs; absent: they are not stored.")
    not_stored: str | None = optional("Reason why the outputs are not stored; absent if they are.")


class StoredNetworkInterface(Part):
    """The network address of a simulation job, as the service's responses report it."""

    network_interface_id: str = Field(description="Id of the network interface.")
    private_ip_address: str = Field(description="Private IP address.")
    public_ip_address: str = Field(description="Public IP address.")


class ResolvedKey(Part):
    """One object of a job's data source, with the ETag that it had when the job was created."""

    s3_key: str = Field(description="Key of the object.")
    etag: str | None = optional(
        "ETag of the object when the job was created; absent: the job's role could not read it."
    )


class ResolvedDataSource(Part):
    """A data source of a simulation job, with the list of objects found when the job was created."""

    model_config = ConfigDict(extra="allow")

    name: str = Field(description="Name of the data source, and of its folder among the data sources.")
    type: str = Field(default="File", description="`File`, `Archive` or `Prefix`.")
    s3_bucket: str = Field(description="Name of the bucket.")
    s3_keys: list[ResolvedKey] = Field(description="Objects of the data source.")
    destination: str | None = optional(
        "Path at which applications find the data; absent: a folder with the source's name."
    )


ARCHIVE = "archive "
"""Prefix of an application's content in `MadeOf` if the application is an archive; the archive's ETag follows."""


class MadeOf(Part):
    """Hashes of the world and applications that a simulation job's request names, taken when its run was prepared.

    Two runs can be compared by them.
    """

    world: str | None = optional("Content hash of the world; absent: the job has no world.")
    robot: str | None = optional(
        "Content of the robot application (archive, image or package); absent: the job has none."
    )
    simulation: str | None = optional(
        "Content of the simulation application (archive, image or package); absent: the job has none."
    )
    versions: dict[str, str] = Field(default={}, description="Versions of the packages that ran the simulation.")
    once_only: str | None = optional("Reason why the same inputs may give another result; absent: they give the same.")

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

    job: str = Field(description="ARN of the job that ran the simulation.")
    spec_run: str | None = optional("Id of the specification run that created that job.")


class SimulationJobProgress(FailureChanges):
    """Update to a simulation job's document that is written while the job runs and when it ends."""

    run_id: str | None = optional("Id of the job's last run; absent: it has not run.")
    last_started_at: str | None = optional("Begin of the job's last run.")
    network_interface: StoredNetworkInterface | None = optional("Network interface of the job's last run.")
    reached_s: float = Field(default=0.0, description="Simulated seconds at which each interrupted run was resumed.")
    waited_s: dict[Scarce, float] = Field(
        default={},
        description=(
            "Seconds that the job waited for a machine before its last run, by scarce resource; waits below one "
            "second, and those for jobs of the same batch, are left out."
        ),
    )
    attempts: int = Field(
        default=1, description="Number of times that the run was begun: again after a crash of its worker."
    )
    simulation_time_millis: int | None = optional("Wall-clock seconds of the job's last run.")
    cpu_time_s: float | None = optional(
        "CPU seconds of all processes of the last run; absent: unknown, or its results were reused."
    )
    simulated_at: str | None = optional(
        "Time at which the last run's programs had ended, so that only videos and uploads remain; absent: not yet."
    )
    video_s: float | None = optional("Wall-clock seconds for rendering videos of the last run's failure; absent: none.")
    upload_s: float | None = optional("Wall-clock seconds for storing the outputs; absent: unknown, or not finished.")
    verdict: Verdict | None = optional("Verdict of the last run; absent: there is no result, or the run was canceled.")
    verdict_reason: str | None = optional("Reason of the verdict FAIL or ERROR, as text.")
    judged: Judged | None = optional("Numbers behind the verdict; absent: none, or the job is of an earlier version.")
    outcome: Outcome | None = Field(
        default=None,
        validation_alias="ending",
        serialization_alias="ending",
        description="Outcome of the run, known before its outputs are stored.",
    )
    trials_finished: int | None = optional(
        "Number of finished trials of the last run, as last reported; absent: no trials."
    )
    trials_recorded: TrialRecordings | None = optional(
        "Progress of recording trials of the last run again; absent: it has not begun to."
    )
    finished: bool | None = optional("Whether the last run wrote its outputs completely; absent: no run has ended.")
    outputs: StoredPlace | None = optional("Place of the stored outputs of its last run.")
    call_key: str | None = optional("Key with which code of the last run calls the service, until the run ends.")
    upload_canceled: bool = Field(
        default=False,
        description="Whether a cancelled job was cancelled again while its outputs were stored.",
    )
    earlier_runs: list[EarlierRun] = Field(default=[], description="Runs of the job before the last one, oldest first.")
    made_of: MadeOf | None = optional(
        "Content hashes of the last run's world and applications; absent: the job has not run."
    )

    @classmethod
    def begun(cls, run_id: str, waited_s: Mapping[Scarce, float], call_key: str) -> "SimulationJobProgress":
        """Returns the document update for a new run of a simulation job.

        It clears the failure and verdict of an earlier run.

        Args:
            run_id: Id of the run.
            waited_s: See `waited_s`.
            call_key: See `call_key`.
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
            judged=None,
            reached_s=0.0,
            trials_finished=None,
            trials_recorded=None,
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

    request_index: int | None = optional("Index of the job's request in its batch.")
    trials_finished: int | None = optional("Number of finished trials, as last reported.")
    trials_recorded: TrialRecordings | None = optional("Progress of recording trials again, as last reported.")


class JobInBrief(FailureChanges, Brief):
    """The few members of a simulation job which the web console's live pages read instead of the whole document."""

    simulation_application_names: list[str] = Field(default=[], description="Names of its simulation applications.")
    robot_application_names: list[str] = Field(default=[], description="Names of its robot applications.")
    world_name: str | None = optional("Name of its world, as people see it.")
    request_index: int | None = optional("Index of the job's request in its batch.")
    last_started_at: str | None = optional("Begin of the job's last run.")
    simulated_at: str | None = optional("Time at which the run's programs had ended.")
    waited_s: dict[Scarce, float] = Field(
        default={}, description="Seconds that the job waited for a machine, by scarce resource."
    )
    video_s: float | None = optional("Wall-clock seconds for rendering videos of the failure.")
    upload_s: float | None = optional("Wall-clock seconds for storing the outputs.")
    simulation_time_millis: int | None = optional("Wall-clock seconds of the job's last run.")
    verdict: Verdict | None = optional("Verdict of the job's last run.")
    verdict_reason: str | None = optional("Reason of the verdict FAIL or ERROR, as text.")
    video: Literal["none", "on-failure", "always"] = Field(
        default="none", description="Video policy: runs of which a video is rendered."
    )
    outputs: StoredPlace | None = optional("Place of the stored outputs of its last run.")
    run_id: str | None = optional("Id of the job's last run.")
    spec_run: str | None = optional("Id of the specification run that created the job.")


class SimulationJobDocument(SimulationJobProgress, Document):
    """Catalog document of a simulation job: its request, resolved inputs, progress and outcome."""

    request: Json = Field(description="Request as sent to the API: a `SimulationJobOrder`.")
    request_index: int | None = optional("Index of the job's request in its batch; absent: the job is not in a batch.")
    seed: int = Field(description="Seed of the run's random generators.")
    video: Literal["none", "on-failure", "always"] = Field(
        default="none", description="Video policy: runs of which a video is rendered."
    )
    requirements: list[dict[str, Any]] = Field(default=[], description="Requirements by which the run is judged.")
    trials: dict[str, Any] | None = optional("Trials of the job (`Trials`); absent: a single episode.")
    data_sources: list[ResolvedDataSource] | None = optional("Data sources with the objects that were found.")
    simulation_application_names: list[str] = Field(
        default=[], description="Names of the job's simulation applications."
    )
    robot_application_names: list[str] = Field(default=[], description="Names of the job's robot applications.")
    world_name: str | None = optional("Name of its world, as people see it: `flat 3`; absent: it has no world.")
    application_arns: dict[str, str] = Field(
        default={},
        description="ARNs of applications that the request gives by name only, by role and name: `robot scout`.",
    )
    spec_run: str | None = optional("Id of the specification run that created the job.")
    reused_from: ReusedFrom | None = optional("Earlier job whose results were reused; absent: the job ran itself.")


class StoredBatchPolicy(Part):
    """Limits of a simulation job batch (concurrency, timeout, priority), with the defaults filled in."""

    timeout_in_seconds: int = Field(description="Time limit of the batch in seconds.")
    max_concurrency: int = Field(description="Maximum number of jobs that run at the same time.")
    priority: int | None = optional(
        "Priority: on each machine jobs of batches with a higher one begin first; absent: 0."
    )


class FailedRequest(Part):
    """A request in a simulation job batch for which no job could be created, and why."""

    failure_code: str = Field(description="Failure code of the request.")
    failure_reason: str = Field(description="Reason of the failure as text.")
    failed_at: str = Field(description="Time at which the failure was found.")

    @property
    def time(self) -> datetime:
        """Time at which the request failed."""
        return datetime.fromisoformat(self.failed_at)


class BatchCounts(Changes):
    """Numbers of jobs and requests of a batch, which lists read instead of the whole document."""

    request_count: int = Field(description="Number of requests in the batch.")
    failed_count: int = Field(default=0, description="Number of requests for which no job can be created.")


class BatchProgress(FailureChanges):
    """Update to a simulation job batch's document that is written while the batch runs and when it ends."""

    failed: dict[str, FailedRequest] = Field(
        default={}, description="Requests for which no job can be created, by index."
    )
    failed_count: int = Field(default=0, description="Number of requests for which no job can be created.")
    concurrency: int | None = optional(
        "Number of jobs that a backend's job workers may hold at the same time, right now."
    )
    ended_when_taken: int = Field(
        default=0, description="Number of jobs that had ended when a job worker last took the batch over."
    )
    verdicts: dict[str, int] | None = optional("Number of completed jobs by verdict; absent until the batch ends.")


class BatchInBrief(FailureChanges, Brief):
    """The few members of a simulation job batch which the web console reads instead of the whole document."""

    request_count: int = Field(description="Number of requests in the batch.")
    failed: dict[str, FailedRequest] = Field(
        default={}, description="Requests for which no job can be created, by index."
    )
    batch_policy: StoredBatchPolicy = Field(description="Limits of the batch: concurrency, timeout, priority.")
    verdicts: dict[str, int] | None = optional("Number of completed jobs by verdict; absent until the batch ends.")
    spec_run: str | None = optional("Id of the specification run that created the batch.")


class SimulationJobBatchDocument(BatchProgress, BatchCounts, Document):
    """Catalog document of a simulation job batch: its job requests, limits and progress."""

    request: Json = Field(description="Request as sent to the API: a `StartSimulationJobBatchRequest`.")
    batch_policy: StoredBatchPolicy = Field(description="Limits of the batch: concurrency, timeout, priority.")
    spec_run: str | None = optional("Id of the specification run that created the batch.")
    reuse: bool = Field(default=False, description="Whether jobs reuse results of earlier jobs with the same inputs.")
    in_campaign: bool = Field(
        default=False,
        description="Whether the batch is one of several of a step; Prefect then has one task run for its jobs.",
    )
    mixed: bool = Field(
        default=False,
        description="Whether jobs are created in a mixed order, since the batch may end before all of them ran.",
    )

    @property
    def requests(self) -> list[Json]:
        """The batch's requests for simulation jobs, as JSON in the service's format, in order."""
        return self.request["createSimulationJobRequests"]
