"""Handlers of operations on simulation jobs: one robot, one world, one run."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from ...schemas.documents.simulation_jobs import SimulationJobDocument, SimulationJobProgress
from ...schemas.lifecycles import is_terminal
from ...schemas.operations.simulation_jobs import (
    BatchDescribeSimulationJobRequest,
    BatchDescribeSimulationJobResponse,
    CancelSimulationJobRequest,
    CreateSimulationJobRequest,
    DescribeSimulationJobRequest,
    ListSimulationJobsRequest,
    RestartSimulationJobRequest,
    SimulationJob,
)
from ...schemas.runs.plan import ApplicationRole
from ...schemas.runs.programs import Scarce
from ...schemas.runs.trials import TrialCounts
from ...schemas.wire.errors import InvalidParameterException, StateConflictError
from ..catalog import ClientToken, Resource
from ..execution.credential_blocks import read_credential_block
from ..execution.task_pool import run_alone, step_runner
from ..jobs.batch_workers import EndedJobs
from ..jobs.job_runs import perform_job, stop_idle_job
from ..jobs.simulation_places import Place, permit_of
from ..machine.machine_slots import MachineSlots
from ..service.service import Progress, Service
from ..simulations.environment.run_environment import DEFAULT_COMPUTE
from ..simulations.planning.applications import LATEST
from ..simulations.stored_jobs import bare_name, reuse_job, store_job
from .registry import Answer, operation, page_of

KIND = "simulation-job"


def perform_simulation_job(arn: str, service: Service) -> None:
    """Waits for a slot of this machine, runs a simulation job in separate processes, and uploads its outputs.

    Blocks until the job has ended, and reports its progress. A failed job raises no error: its status says so.
    """
    run_step = step_runner()

    def has_to_end() -> bool:
        status, is_canceled = service.catalog.standing(arn)
        return is_canceled or is_terminal(KIND, status)

    def tell_trials(told: TrialCounts) -> None:
        service.report_progress(Progress({"running": 1}, 1, trials=told))

    def tell_wait(scarce: Scarce | None) -> None:
        service.report_progress(Progress({"pending": 1}, 1, scarce))

    def perform() -> None:
        machine = MachineSlots(service.settings, tell=service.report_note, watch=tell_wait)
        name = arn.rpartition("/")[2]
        with Place(lambda stack: stack.enter_context(machine.hold(has_to_end, name)), permit_of(machine)) as place:
            turn = place.simulate()
            # Ends one that has no slot because it has to end.
            waited_s = turn.waited_s if turn else None
            perform_job(arn, service, run_step=run_step, on_trials=tell_trials, waited_s=waited_s, place=place)

    run_alone(perform, job_arn=arn, service=service)
    job = service.catalog.get(arn)
    counts = Counter([job.status.lower()])
    EndedJobs([job]).tell(counts)
    service.report_progress(Progress({state: count for state, count in counts.items() if count}, 1))


@operation("CreateSimulationJob", perform=perform_simulation_job)
def create_simulation_job(request: CreateSimulationJobRequest, service: Service) -> Answer:
    """Handles `CreateSimulationJob`: stores a job after checking that its applications, world and data exist.

    Returns its description; the job is not run here. Where results are reused, the new job has finished already if an
    earlier job with the same inputs has results.
    """
    token = ClientToken.of("CreateSimulationJob", request)
    service = service.with_blocks(read_credential_block)
    job = reuse_job(request, service, token=token) if service.reuses else None
    described = describe(job or store_job(request, service, token=token))
    for member in ("name", "failureReason", "networkInterface", "verdict"):
        described.pop(member, None)
    return described


@operation("DescribeSimulationJob")
def describe_simulation_job(request: DescribeSimulationJobRequest, service: Service) -> Answer:
    """Handles `DescribeSimulationJob`: returns the full description of a simulation job."""
    return describe(service.catalog.get(request.job, kind=KIND))


@operation("BatchDescribeSimulationJob")
def batch_describe_simulation_job(
    request: BatchDescribeSimulationJobRequest, service: Service
) -> BatchDescribeSimulationJobResponse:
    """Handles `BatchDescribeSimulationJob`: returns the descriptions of several simulation jobs.

    ARNs without a job are listed as unprocessed.
    """
    found = {arn: job for arn, job in service.catalog.get_many(request.jobs).items() if job.kind == KIND}
    jobs = [SimulationJob.model_validate(describe(found[arn])) for arn in request.jobs if arn in found]
    missing = [arn for arn in request.jobs if arn not in found]
    return BatchDescribeSimulationJobResponse(jobs=jobs, unprocessedJobs=missing)


@operation("ListSimulationJobs")
def list_simulation_jobs(request: ListSimulationJobsRequest, service: Service) -> Answer:
    """Handles `ListSimulationJobs`: returns a page of jobs, newest first, and a token for the next page."""
    page = page_of(request, KIND, service, "status", "simulationApplicationName", "robotApplicationName")
    return {"simulationJobSummaries": [summary(job) for job in page.resources], "nextToken": page.next_token}


@operation("CancelSimulationJob")
def cancel_simulation_job(request: CancelSimulationJobRequest, service: Service) -> Answer:
    """Handles `CancelSimulationJob`: cancels a simulation job, at once or through its job worker.

    A running job is cancelled as soon as its worker notices, and stores its outputs; if cancelled again, it ends with
    the outputs stored by then. Cancelling a job that has ended changes nothing and succeeds.
    """
    service.catalog.get(request.job, kind=KIND)
    status, is_canceled = service.catalog.standing(request.job)
    service.catalog.request_cancel(request.job)
    if is_canceled and status == "Terminating":
        service.catalog.update(request.job, SimulationJobProgress(upload_canceled=True))
    stop_idle_job(request.job, service)
    return {}


@operation("RestartSimulationJob")
def restart_simulation_job(request: RestartSimulationJobRequest, service: Service) -> Answer:
    """Handles `RestartSimulationJob`: requests that a running simulation job starts again from the beginning.

    Raises `InvalidParameterException` if the job is not running or is being cancelled.
    """
    job = service.catalog.get(request.job, kind=KIND)
    _, is_to_be_cancelled = service.catalog.standing(request.job)
    if is_to_be_cancelled and not is_terminal(KIND, job.status):
        raise InvalidParameterException(f"job: {job.arn} is being cancelled; only a running job can be restarted")
    try:
        service.catalog.transition(request.job, "restart")
    except StateConflictError as error:
        status, _ = service.catalog.standing(request.job)
        raise InvalidParameterException(
            f"job: {job.arn} is {status}; only a job that is Running or RunningFailed can be restarted"
        ) from error
    return {}


def describe(job: Resource) -> dict[str, Any]:
    """Makes the members of a simulation job's description; those without a value are `None`."""
    document = SimulationJobDocument.of(job)
    request = document.request
    return {
        "arn": job.arn,
        "name": job.id,
        "status": job.status,
        "lastStartedAt": document.started_at,
        "lastUpdatedAt": job.updated_at,
        "failureBehavior": request.get("failureBehavior", "Fail"),
        "failureCode": document.failure_code,
        "failureReason": document.failure_reason,
        "clientRequestToken": request.get("clientRequestToken"),
        "outputLocation": request.get("outputLocation"),
        "loggingConfig": {"recordAllRosTopics": False, **request.get("loggingConfig", {})},
        "maxJobDurationInSeconds": request["maxJobDurationInSeconds"],
        "simulationTimeMillis": document.simulation_time_millis or 0,
        "iamRole": request.get("iamRole"),
        "robotApplications": _with_defaults("robot", document),
        "simulationApplications": _with_defaults("simulation", document),
        "dataSources": [source.to_json() for source in document.data_sources or []] or None,
        "tags": dict(job.tags),
        "vpcConfig": request.get("vpcConfig"),
        "networkInterface": document.network_interface and document.network_interface.to_json(),
        "compute": _compute(request),
        "verdict": _verdict(job.status, document),
    }


def _verdict(status: str, document: SimulationJobDocument) -> dict[str, Any] | None:
    """Makes the verdict of a job that has completed; what a run that was cut short was judged to be means nothing."""
    if status != "Completed" or document.verdict is None:
        return None
    counts = {} if document.judged is None else document.judged.model_dump(exclude_none=True)
    reason = {} if document.verdict_reason is None else {"reason": document.verdict_reason}
    return {"verdict": document.verdict, **reason, **counts}


def summary(job: Resource) -> dict[str, Any]:
    """Returns the members of a simulation job's entry in the answer of `ListSimulationJobs`."""
    document = SimulationJobDocument.of(job)
    return {
        "arn": job.arn,
        "lastUpdatedAt": job.updated_at,
        "name": job.id,
        "status": job.status,
        "simulationApplicationNames": document.simulation_application_names,
        "robotApplicationNames": document.robot_application_names,
        "dataSourceNames": [source.name for source in document.data_sources or []],
        "computeType": _compute(document.request)["computeType"],
    }


def _with_defaults(role: ApplicationRole, document: SimulationJobDocument) -> list[dict[str, Any]] | None:
    """Returns a job's application configurations as the service describes them: ARNs, and defaults of omitted members.

    Returns `None` if the job has no application of that role.
    """
    configs: Sequence[Mapping[str, Any]] | None = document.request.get(f"{role}Applications")
    if not configs:
        return None
    return [
        {
            "applicationVersion": LATEST,
            "uploadConfigurations": [],
            "useDefaultUploadConfigurations": bool(config.get("uploadConfigurations")),
            "useDefaultTools": False,
            **config,
            # Jobs that earlier releases stored have no ARN for a bare name.
            "application": document.application_arns.get(bare_name(role, config["application"]), config["application"]),
        }
        for config in configs
    ]


def _compute(request: Mapping[str, Any]) -> dict[str, Any]:
    return {**DEFAULT_COMPUTE, **request.get("compute", {})}
