"""Handlers of operations on deployment jobs, which install an application on the robots of a fleet.

A job is stored as `Pending`; `tasks/fleet/deployment_runs.py` runs it.
"""

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from ....schemas.fleet.documents import DeploymentJobDocument
from ....schemas.fleet.operations.deployment_jobs import (
    DEFAULT_ROBOT_TIMEOUT_S,
    CancelDeploymentJobRequest,
    CreateDeploymentJobRequest,
    DeploymentConfig,
    DescribeDeploymentJobRequest,
    ListDeploymentJobsRequest,
    SyncDeploymentJobRequest,
)
from ....schemas.fleet.required_batch import required_batch_of
from ....schemas.fleet.rollouts.rollout import Rollout
from ....schemas.fleet.rollouts.rollout_plan import DEFAULT_CONCURRENT_PERCENTAGE, DEFAULT_THRESHOLD_PERCENTAGE
from ....schemas.lifecycles import is_terminal
from ....schemas.wire.arns import ResourceArn
from ....schemas.wire.errors import (
    ConcurrentDeploymentException,
    InvalidParameterException,
    ResourceNotFoundException,
    StorageError,
)
from ...catalog import ClientToken, Resource
from ...execution.leases.leased_runs import run_under_lease
from ...operations.registry import Answer, operation, page_of, registry
from ...service.service import Service
from ...simulations.planning.applications import find_application
from ..control.deployment_decisions import check_robots, pause_that_waits
from ..control.dry_runs import DryRun, dry_run
from ..deployment_runs import DeploymentRun
from ..fleet_records import (
    DEPLOYMENT,
    FLEET,
    end_deployment,
    fleet_held,
    is_meant,
    last_deployment,
    robots_of,
    rollout_of,
    settle,
)
from ..rollout.statuses import robot_deployments, shown_rollback, waits_for

_PAGE = 200
_DEFAULTS = {
    "concurrentDeploymentPercentage": DEFAULT_CONCURRENT_PERCENTAGE,
    "failureThresholdPercentage": DEFAULT_THRESHOLD_PERCENTAGE,
    "robotDeploymentTimeoutInSeconds": DEFAULT_ROBOT_TIMEOUT_S,
}


def perform_deployment_job(arn: str, service: Service) -> None:
    """Runs a deployment job: prepares the files for robots, and rolls them out."""
    run_under_lease(arn, DEPLOYMENT, service, lambda lease: DeploymentRun(lease, service).run())


@operation("CreateDeploymentJob", perform=perform_deployment_job)
def create_deployment_job(request: CreateDeploymentJobRequest, service: Service) -> Answer:
    """Handles `CreateDeploymentJob`: stores a new deployment to the robots of a fleet.

    Refused are fleets without robots, and applications that none of the robots can run. A robot that
    cannot run it beside others that can is left to the deployment, which fails for that robot only.
    """
    token = ClientToken.of("CreateDeploymentJob", request)
    job = service.find_by_client_token(token)
    if job is None:
        document = _document(request, service)
        with fleet_held(request.fleet, service) as fleet:
            job = service.find_by_client_token(token) or _stored(document, fleet, service, token, request.tags)
    return {**_summary(job), "tags": dict(job.tags)}


def plan_deployment(members: Mapping[str, Any], service: Service) -> DryRun:
    """Forecasts what a deployment would do (`robomaker fleet deploy --dry-run`); stores nothing.

    Args:
        members: Members of a request of CreateDeploymentJob.
        service: The service, with its catalog and object store.

    Raises:
        ServiceError: CreateDeploymentJob would refuse the request; a deployment that is under way is no reason here.
    """
    request = registry()["CreateDeploymentJob"].checked(members, service)
    assert isinstance(request, CreateDeploymentJobRequest)
    ResourceArn.parse(request.fleet, FLEET)
    fleet = service.catalog.get(request.fleet, kind=FLEET)
    document = _document(request, service)
    return dry_run(document, _check(document, fleet, service), fleet, service)


@operation("SyncDeploymentJob", perform=perform_deployment_job)
def sync_deployment_job(request: SyncDeploymentJobRequest, service: Service) -> Answer:
    """Handles `SyncDeploymentJob`: repeats the fleet's latest deployment for robots that have not received it."""
    token = ClientToken.of("SyncDeploymentJob", request)
    job = service.find_by_client_token(token)
    if job is None:
        with fleet_held(request.fleet, service) as fleet:
            job = service.find_by_client_token(token) or _repeated(fleet, service, token)
    return _summary(job)


@operation("DescribeDeploymentJob")
def describe_deployment_job(request: DescribeDeploymentJobRequest, service: Service) -> Answer:
    """Handles `DescribeDeploymentJob`: returns the state of a deployment and of each of its robots."""
    job = _job(request.job, service)
    rollout = rollout_of(job.arn, service)
    robots = _robots(job, rollout, service)
    return {
        **_summary(job),
        "robotDeploymentSummary": robots,
        "tags": dict(job.tags),
        **_control(job, rollout, service),
    }


@operation("ListDeploymentJobs")
def list_deployment_jobs(request: ListDeploymentJobsRequest, service: Service) -> Answer:
    """Handles `ListDeploymentJobs`: lists deployment jobs, newest first."""
    page = page_of(request, DEPLOYMENT, service, "status", "fleetName", most=_PAGE)
    return {"deploymentJobs": [_summary(job) for job in page.resources], "nextToken": page.next_token}


@operation("CancelDeploymentJob")
def cancel_deployment_job(request: CancelDeploymentJobRequest, service: Service) -> Answer:
    """Handles `CancelDeploymentJob`: ends a deployment early; one that has ended stays as it is."""
    job = _job(request.job, service)
    if not is_terminal(DEPLOYMENT, job.status):
        # The fleet may be deleted meanwhile, which ends its deployment.
        with suppress(ResourceNotFoundException), fleet_held(_fleet(job), service) as fleet:
            end_deployment(job, "canceled", service)
            settle(fleet, service)
    return {}


def _control(job: Resource, rollout: Rollout | None, service: Service) -> dict[str, Any]:
    """Returns a deployment's waits and rollback for its description; absent where it has none."""
    if rollout is None:
        is_paused = not is_terminal(DEPLOYMENT, job.status) and pause_that_waits(job.arn, service)
        return {"waitsFor": [is_paused.to_wire()]} if is_paused else {}
    waits = [wait.to_wire() for wait in waits_for(rollout, service.clock().timestamp())]
    shown = shown_rollback(rollout)
    return {"waitsFor": waits or None, "rollback": None if shown is None else shown.to_wire()}


def _robots(job: Resource, rollout: Rollout | None, service: Service) -> list[Any]:
    """Returns the state of each robot in a deployment; empty if the deployment ended before it began."""
    if rollout is not None:
        return [each.to_wire() for each in robot_deployments(rollout, job.arn, service.clock().timestamp())]
    if is_terminal(DEPLOYMENT, job.status):
        return []
    meant = (robot for robot in robots_of(_fleet(job), service) if is_meant(robot, job))
    return [{"arn": robot.arn, "status": robot.status} for robot in meant]


def _stored(
    document: DeploymentJobDocument,
    fleet: Resource,
    service: Service,
    token: ClientToken | None,
    tags: Mapping[str, str] | None = None,
) -> Resource:
    """Checks a deployment to a fleet, stores it as a new job, and updates the records of the fleet and its robots.

    It sends nothing to the robots: the job does so when it runs. The caller holds the fleet's lock.
    """
    last = last_deployment(fleet.arn, service)
    if last is not None and not is_terminal(DEPLOYMENT, last.status):
        raise ConcurrentDeploymentException(
            f"fleet: {fleet.arn} has the deployment {last.arn}, which is {last.status}; cancel it, or wait for its end"
        )
    _check(document, fleet, service)
    if document.required_batch is not None:
        service.catalog.get(document.required_batch, kind="simulation-job-batch")
    labels = {"fleetName": [fleet.name]}
    job = service.store_job(DEPLOYMENT, "deployment", document, tags=tags, token=token, parent=fleet.arn, labels=labels)
    settle(fleet, service)
    return job


def _repeated(fleet: Resource, service: Service, token: ClientToken | None) -> Resource:
    last = last_deployment(fleet.arn, service)
    if last is None:
        raise InvalidParameterException(
            f"fleet: {fleet.arn} has had no deployment that could be repeated; call CreateDeploymentJob first"
        )
    document = DeploymentJobDocument.of(last)
    document = DeploymentJobDocument(
        deployment_application_configs=document.deployment_application_configs,
        deployment_config=_with_condition(document.deployment_config, service),
        repeats=True,
    )
    return _stored(document, fleet, service, token)


def _check(document: DeploymentJobDocument, fleet: Resource, service: Service) -> Resource:
    """Checks that a deployment is possible; returns the application's version.

    Raises an error that names the member if it is not.
    """
    (config,) = document.deployment_application_configs
    ResourceArn.parse(config["application"], "robot-application")
    application = find_application(config["application"], "robot", config["applicationVersion"], service)
    check_robots(document, application, fleet.arn, robots_of(fleet.arn, service))
    return application


def _document(request: CreateDeploymentJobRequest, service: Service) -> DeploymentJobDocument:
    configs = [config.to_wire() for config in request.deploymentApplicationConfigs]
    return DeploymentJobDocument(deployment_application_configs=configs, deployment_config=_config(request, service))


def _config(request: CreateDeploymentJobRequest, service: Service) -> dict[str, Any]:
    """Returns the request's deployment configuration with defaults filled in, and with the batch that a tag names."""
    config = {**_DEFAULTS, **(request.deploymentConfig or DeploymentConfig()).to_wire()}
    if (batch := required_batch_of(request)) is not None:
        config["requiresBatch"] = batch
    return _with_condition(config, service)


def _with_condition(config: dict[str, Any], service: Service) -> dict[str, Any]:
    """Returns the deployment configuration with the current ETag of its condition file; unchanged if it has none.

    Raises InvalidParameterException if the file cannot be read, or has another ETag than the request says.
    """
    file = config.get("downloadConditionFile")
    if file is None:
        return config
    place, known = f"s3://{file['bucket']}/{file['key']}", (file.get("etag") or "").strip('"')
    try:
        etag = service.store.head(file["bucket"], file["key"]).etag
    except StorageError as error:
        raise InvalidParameterException(
            f"deploymentConfig.downloadConditionFile: {place} cannot be read ({error}); give a program that robots ask"
        ) from error
    if known and known != etag:
        raise InvalidParameterException(
            f"deploymentConfig.downloadConditionFile.etag: {known} is not that of {place}, which is {etag}"
        )
    return {**config, "downloadConditionFile": {**file, "etag": etag}}


def _job(arn: str, service: Service) -> Resource:
    ResourceArn.parse(arn, "deployment-job")
    return service.catalog.get(arn, kind=DEPLOYMENT)


def _fleet(job: Resource) -> str:
    """Returns the ARN of the fleet that a deployment job is for."""
    return str(job.parent)


def _summary(job: Resource) -> dict[str, Any]:
    document = DeploymentJobDocument.of(job)
    return {
        "arn": job.arn,
        "fleet": job.parent,
        "status": job.status,
        "deploymentApplicationConfigs": document.deployment_application_configs,
        "deploymentConfig": document.deployment_config,
        "failureReason": document.failure_reason,
        "failureCode": document.failure_code,
        "createdAt": job.created_at,
    }
