"""Deployment jobs: an application brought to the robots of a fleet.

Deployments do not act yet: nothing is brought to any robot. A request is checked like one that will be
carried out and stored as `Pending`, where it stays until it is cancelled or its fleet is deleted; it is
no job operation, since there is nothing to perform.
"""

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from ...schemas.documents.applications import ApplicationDocument
from ...schemas.documents.fleets import DeploymentJobDocument, RobotDocument
from ...schemas.lifecycles import is_terminal
from ...schemas.operations.deployment_jobs import (
    DEFAULT_ROBOT_TIMEOUT_S,
    CancelDeploymentJobRequest,
    CancelDeploymentJobResponse,
    CreateDeploymentJobRequest,
    DeploymentConfig,
    DescribeDeploymentJobRequest,
    ListDeploymentJobsRequest,
    S3Object,
    SyncDeploymentJobRequest,
)
from ...schemas.wire.arns import ResourceArn
from ...schemas.wire.errors import (
    ConcurrentDeploymentException,
    InvalidParameterException,
    ResourceNotFoundException,
    StorageError,
)
from ..catalog import ClientToken, Resource
from ..fleet.records import DEPLOYMENT, end_deployment, fleet_held, last_deployment, robots_of, settle
from ..service.service import Service
from ..simulations.planning.applications import find_application
from .pages import page_of
from .registry import Answer, operation

_PAGE = 200
_FILTERS = {"status": "status", "fleetName": "fleetName"}


@operation("CreateDeploymentJob")
def create_deployment_job(request: CreateDeploymentJobRequest, service: Service) -> Answer:
    """Stores a deployment to the robots of a fleet; it stays `Pending`, since deployments do not act yet.

    Refused are fleets without robots, and applications that none of the robots can run. A robot that
    cannot run it beside others that can is left to the deployment, which fails for that robot only.
    """
    token = ClientToken.of("CreateDeploymentJob", request)
    job = service.find_by_client_token(token)
    if job is None:
        configs = [config.to_wire() for config in request.deploymentApplicationConfigs]
        document = DeploymentJobDocument(
            deployment_application_configs=configs, deployment_config=_config(request, service)
        )
        with fleet_held(request.fleet, service) as fleet:
            job = service.find_by_client_token(token) or _stored(document, fleet, service, token, request.tags)
    return {**_summary(job), "tags": dict(job.tags)}


@operation("SyncDeploymentJob")
def sync_deployment_job(request: SyncDeploymentJobRequest, service: Service) -> Answer:
    """Stores the fleet's latest deployment once more, however it ended, for the robots it has now."""
    token = ClientToken.of("SyncDeploymentJob", request)
    job = service.find_by_client_token(token)
    if job is None:
        with fleet_held(request.fleet, service) as fleet:
            job = service.find_by_client_token(token) or _repeated(fleet, service, token)
    return _summary(job)


@operation("DescribeDeploymentJob")
def describe_deployment_job(request: DescribeDeploymentJobRequest, service: Service) -> Answer:
    """Tells how a deployment stands; one that waits names the robots it is meant for."""
    job = _job(request.job, service)
    robots: list[dict[str, Any]] = []
    if not is_terminal(DEPLOYMENT, job.status):
        robots = [{"arn": robot.arn, "status": robot.status} for robot in robots_of(_fleet(job), service)]
    return {**_summary(job), "robotDeploymentSummary": robots, "tags": dict(job.tags)}


@operation("ListDeploymentJobs")
def list_deployment_jobs(request: ListDeploymentJobsRequest, service: Service) -> Answer:
    """Lists deployment jobs, newest first."""
    page = page_of(
        "ListDeploymentJobs", DEPLOYMENT, request, service, filters=_FILTERS, given=request.filters, most=_PAGE
    )
    return {"deploymentJobs": [_summary(job) for job in page.resources], "nextToken": page.next_token}


@operation("CancelDeploymentJob")
def cancel_deployment_job(request: CancelDeploymentJobRequest, service: Service) -> CancelDeploymentJobResponse:
    """Ends a deployment early; one that has ended stays as it is."""
    job = _job(request.job, service)
    if not is_terminal(DEPLOYMENT, job.status):
        # The fleet may be deleted meanwhile, which ends its deployment.
        with suppress(ResourceNotFoundException), fleet_held(_fleet(job), service) as fleet:
            end_deployment(job, "cancel", service)
            settle(fleet, service)
    return CancelDeploymentJobResponse()


def _stored(
    document: DeploymentJobDocument,
    fleet: Resource,
    service: Service,
    token: ClientToken | None,
    tags: Mapping[str, str] | None = None,
) -> Resource:
    """Stores a deployment to a fleet whose lease the caller holds, and tells the robots of it."""
    last = last_deployment(fleet.arn, service)
    if last is not None and not is_terminal(DEPLOYMENT, last.status):
        raise ConcurrentDeploymentException(
            f"fleet: {fleet.arn} has the deployment {last.arn}, which is {last.status}; cancel it, or wait for its end"
        )
    _check_robots(document, fleet, service)
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
        deployment_config=document.deployment_config,
    )
    return _stored(document, fleet, service, token)


def _check_robots(document: DeploymentJobDocument, fleet: Resource, service: Service) -> None:
    """Refuses a deployment that cannot reach a single robot."""
    (config,) = document.deployment_application_configs
    ResourceArn.parse(config["application"], "robot-application")
    application = find_application(config["application"], "robot", config["applicationVersion"], service)
    architectures = {RobotDocument.of(robot).architecture for robot in robots_of(fleet.arn, service)}
    if not architectures:
        raise InvalidParameterException(f"fleet: {fleet.arn} has no robots; register some first")
    sources = ApplicationDocument.of(application).sources
    served = {source.architecture for source in sources} if sources else {None}
    if None not in served and not architectures & served:
        raise InvalidParameterException(
            f"deploymentApplicationConfigs[0]: version {config['applicationVersion']} of {application.arn} has sources "
            f"for {_listed(served)}, the robots of {fleet.arn} are {_listed(architectures)}; add a source for them"
        )


def _listed(words: set[Any]) -> str:
    return ", ".join(sorted(words))


def _config(request: CreateDeploymentJobRequest, service: Service) -> dict[str, Any]:
    """The request's configuration with the timeout that holds and the ETag the condition file has now."""
    config = request.deploymentConfig or DeploymentConfig()
    wanted = {"robotDeploymentTimeoutInSeconds": DEFAULT_ROBOT_TIMEOUT_S, **config.to_wire()}
    if config.downloadConditionFile is not None:
        wanted["downloadConditionFile"] = _found(config.downloadConditionFile, service)
    return wanted


def _found(file: S3Object, service: Service) -> dict[str, Any]:
    place = f"deploymentConfig.downloadConditionFile: s3://{file.bucket}/{file.key}"
    try:
        etag = service.store.head(file.bucket, file.key).etag
    except StorageError as error:
        raise InvalidParameterException(f"{place} cannot be read ({error}); put the program there first") from error
    if file.etag not in (None, etag):
        raise InvalidParameterException(f"{place} has the ETag {etag!r}, not {file.etag!r}; leave etag out for any")
    return {**file.to_wire(), "etag": etag}


def _job(arn: str, service: Service) -> Resource:
    ResourceArn.parse(arn, "deployment-job")
    return service.catalog.get(arn, kind=DEPLOYMENT)


def _fleet(job: Resource) -> str:
    """The ARN of a deployment's fleet."""
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
