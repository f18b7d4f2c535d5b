"""Simulation jobs: one robot, one world, one run."""

from collections.abc import Mapping
from datetime import datetime
from typing import Any

from ..schemas.lifecycles import is_terminal
from ..schemas.operations.registry import seed_of, video_of
from ..schemas.operations.requested_requirements import ordered_requirements
from ..schemas.operations.simulation_jobs import (
    BatchDescribeSimulationJobRequest,
    BatchDescribeSimulationJobResponse,
    CancelSimulationJobRequest,
    CancelSimulationJobResponse,
    CreateSimulationJobRequest,
    CreateSimulationJobResponse,
    DescribeSimulationJobRequest,
    DescribeSimulationJobResponse,
    ListSimulationJobsRequest,
    ListSimulationJobsResponse,
    RestartSimulationJobRequest,
    RestartSimulationJobResponse,
    SimulationJob,
    SimulationJobOrder,
)
from ..schemas.runs.plan import ApplicationRole
from ..schemas.wire.errors import InvalidParameterException, StateConflictError
from ..tasks.catalog import ClientToken, Resource
from ..tasks.service.service import Progress, Service
from ..tasks.simulations.environment.compute import DEFAULT_COMPUTE
from ..tasks.simulations.inputs.data_sources import resolve_data_sources
from ..tasks.simulations.inputs.world_rooms import check_rooms
from ..tasks.simulations.job_runs import stop_idle_job
from ..tasks.simulations.outputs.locations import check_output_location
from ..tasks.simulations.planning.applications import find_application
from ..tasks.simulations.planning.run_plans import world_arn
from .listing import page_of
from .operation import flows_of, operation

KIND = "simulation-job"
# What lists filter by: the job's status, and the labels that `store_job` gives it.
_FILTERS = {
    "status": "status",
    "simulationApplicationName": "simulationApplicationName",
    "robotApplicationName": "robotApplicationName",
}


def perform_simulation_job(arn: str, service: Service) -> None:
    """Runs the job's simulation in a process of its own and stores its outputs."""
    from ..tasks.execution.task_pool import run_tasks
    from ..tasks.simulations.steps import simulate

    run_tasks(simulate, [{"arn": arn}], workers=1, job_arn=arn, service=service)
    status = service.catalog.get(arn).status
    service.report_progress(Progress({status.lower(): 1}, 1))


@operation("CreateSimulationJob", perform=perform_simulation_job, describe="DescribeSimulationJob")
def create_simulation_job(request: CreateSimulationJobRequest, service: Service) -> CreateSimulationJobResponse:
    """Stores a simulation job whose applications, world and data exist."""
    token = ClientToken.of("CreateSimulationJob", request)
    job = store_job(request, service, token=token)
    described = describe(job)
    for member in ("name", "failureReason", "networkInterface"):
        described.pop(member, None)
    return CreateSimulationJobResponse.model_validate(described)


@operation("DescribeSimulationJob")
def describe_simulation_job(request: DescribeSimulationJobRequest, service: Service) -> DescribeSimulationJobResponse:
    """Tells how a simulation job stands."""
    return DescribeSimulationJobResponse.model_validate(describe(service.catalog.get(request.job, kind=KIND)))


@operation("BatchDescribeSimulationJob")
def batch_describe_simulation_job(
    request: BatchDescribeSimulationJobRequest, service: Service
) -> BatchDescribeSimulationJobResponse:
    """Tells how several simulation jobs stand."""
    found = {arn: job for arn, job in service.catalog.get_many(request.jobs).items() if job.kind == KIND}
    jobs = [SimulationJob.model_validate(describe(found[arn])) for arn in request.jobs if arn in found]
    missing = [arn for arn in request.jobs if arn not in found]
    return BatchDescribeSimulationJobResponse(jobs=jobs, unprocessedJobs=missing)


@operation("ListSimulationJobs")
def list_simulation_jobs(request: ListSimulationJobsRequest, service: Service) -> ListSimulationJobsResponse:
    """Lists jobs, 100 a page at most."""
    page = page_of("ListSimulationJobs", KIND, request, service, filters=_FILTERS, given=request.filters)
    return ListSimulationJobsResponse.model_validate(
        {"simulationJobSummaries": [summary(job) for job in page.resources], "nextToken": page.next_token}
    )


@operation("CancelSimulationJob")
def cancel_simulation_job(request: CancelSimulationJobRequest, service: Service) -> CancelSimulationJobResponse:
    """Has a job end as cancelled: soon by whoever performs it, at once if nobody does.

    Cancelling a job that has ended changes nothing and succeeds.
    """
    service.catalog.get(request.job, kind=KIND)
    service.catalog.request_cancel(request.job)
    stop_idle_job(request.job, service)
    return CancelSimulationJobResponse()


@operation("RestartSimulationJob")
def restart_simulation_job(request: RestartSimulationJobRequest, service: Service) -> RestartSimulationJobResponse:
    """Has a running job run again from the start; whoever performs it sees the new status."""
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
    return RestartSimulationJobResponse()


def store_job(
    request: SimulationJobOrder, service: Service, *, token: ClientToken | None, batch: tuple[str, int] | None = None
) -> Resource:
    """Stores one job as Pending.

    Args:
      request: the order, alone or out of a batch.
      service: where it is stored.
      token: makes the call repeatable.
      batch: ARN of the batch it belongs to, and the place of its request there.

    Raises:
      ResourceNotFoundException: an application or world does not exist.
      InvalidParameterException: data cannot be read, an application cannot be started so, or the world has no such
        room.
      IdempotentParameterMismatchException: the token was used for another request.
    """
    if (earlier := service.made_before(token)) is not None:
        return earlier
    wire = request.to_wire()
    applications = {f"{role}ApplicationNames": _applications(wire, role, service) for role in ("robot", "simulation")}
    if (world := world_arn(wire)) is not None:
        check_rooms(request, service.catalog.get(world, kind="world"), service)
    check_output_location(wire.get("outputLocation"))
    data_sources = resolve_data_sources(wire.get("dataSources") or [], service)
    seed = seed_of(request)
    return service.store_job(
        KIND,
        "sim",
        {
            "request": wire,
            "requestIndex": batch[1] if batch else None,
            "seed": service.new_seed() if seed is None else seed,
            "video": video_of(request) or "none",
            "requirements": [each.to_wire() for each in ordered_requirements(request)],
            "dataSources": data_sources,
            **applications,
        },
        tags=request.tags,
        token=token,
        parent=batch[0] if batch else None,
        labels={members.removesuffix("s"): names for members, names in applications.items()},
    )


def describe(job: Resource) -> dict[str, Any]:
    """The members of a job's description, those without a value as `None`."""
    document = job.document
    request = document["request"]
    started = document.get("lastStartedAt")
    return {
        "arn": job.arn,
        "name": job.id,
        "status": job.status,
        "lastStartedAt": datetime.fromisoformat(started) if started else None,
        "lastUpdatedAt": job.updated_at,
        "failureBehavior": request.get("failureBehavior", "Fail"),
        "failureCode": document.get("failureCode"),
        "failureReason": document.get("failureReason"),
        "clientRequestToken": request.get("clientRequestToken"),
        "outputLocation": request.get("outputLocation"),
        "loggingConfig": request.get("loggingConfig"),
        "maxJobDurationInSeconds": request["maxJobDurationInSeconds"],
        "simulationTimeMillis": document.get("simulationTimeMillis", 0),
        "iamRole": request.get("iamRole"),
        "robotApplications": request.get("robotApplications"),
        "simulationApplications": request.get("simulationApplications"),
        "dataSources": document.get("dataSources") or None,
        "tags": dict(job.tags),
        "vpcConfig": request.get("vpcConfig"),
        "networkInterface": document.get("networkInterface"),
        "compute": _compute(request),
    }


def summary(job: Resource) -> dict[str, Any]:
    """The members of a job's entry in a list."""
    document = job.document
    return {
        "arn": job.arn,
        "lastUpdatedAt": job.updated_at,
        "name": job.id,
        "status": job.status,
        "simulationApplicationNames": document["simulationApplicationNames"],
        "robotApplicationNames": document["robotApplicationNames"],
        "dataSourceNames": [source["name"] for source in document.get("dataSources") or []],
        "computeType": _compute(document["request"])["computeType"],
    }


def _compute(request: Mapping[str, Any]) -> dict[str, Any]:
    return {**DEFAULT_COMPUTE, **request.get("compute", {})}


def _applications(request: Mapping[str, Any], role: ApplicationRole, service: Service) -> list[str]:
    """Names of the applications of a role, all of which can be started."""
    names = []
    for index, config in enumerate(request.get(f"{role}Applications") or []):
        application = find_application(config["application"], role, config.get("applicationVersion"), service)
        _check_launch(config["launchConfig"], application, f"{role}Applications[{index}].launchConfig")
        names.append(application.name)
    return names


def _check_launch(launch: Mapping[str, Any], application: Resource, place: str) -> None:
    """Refuses what cannot mean anything; whether it can be started is found out by whoever performs the job."""
    has_archives = bool(application.document.get("sources"))
    if has_archives and not launch.get("command") and not (launch.get("packageName") and launch.get("launchFile")):
        raise InvalidParameterException(
            f"{place}: command, or packageName and launchFile, have to say what of the archive is started, "
            "such as my_nav and arena.make_environment"
        )


def __getattr__(name: str) -> Any:
    return flows_of(__name__)(name)
