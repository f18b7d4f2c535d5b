"""Decisions of people about a running deployment (pause, resume, approve, reject), and checks of new deployments.

Any process may make a decision while another runs the job: it is stored in the catalog when the call returns. A
deployment that has not begun keeps it as an event, and applies it when it begins.
"""

from collections.abc import Sequence
from datetime import UTC, datetime

from ....schemas.documents.applications import ApplicationDocument
from ....schemas.fleet.documents import DeploymentJobDocument, RobotDocument
from ....schemas.fleet.operations.deployment_jobs import DeploymentConfig, DeploymentWait
from ....schemas.fleet.rollouts.rollout import Approved, Paused, Resumed, Rollout, RolloutEvent, Stopped
from ....schemas.lifecycles import is_terminal
from ....schemas.wire.arns import ResourceArn
from ....schemas.wire.errors import InvalidParameterException
from ...catalog import Resource
from ...service.service import Service
from ..catalog_rollouts import Rollouts
from ..fleet_records import DEPLOYMENT, fleet_held, settle
from ..kept_rollouts import KeptRollout
from ..rollout.ledger import Ledger


def pause(job: str, by: str, service: Service) -> None:
    """Pauses a deployment: no further robot begins; robots that have begun continue.

    Args:
        job: ARN of the deployment job.
        by: Name of the person who decides.
        service: The service, with its catalog and object store.

    Raises:
        ResourceNotFoundException: The catalog has no such job.
        InvalidParameterException: The deployment has ended.
    """
    _tell(_under_way(job, service), Paused(by=by), service)


def resume(job: str, service: Service) -> None:
    """Resumes a paused deployment; does nothing if it is not paused.

    Raises:
        ResourceNotFoundException: The catalog has no such job.
        InvalidParameterException: The deployment has ended.
    """
    _tell(_under_way(job, service), Resumed(), service)


def approve(job: str, by: str, service: Service) -> None:
    """Approves a deployment that waits for a person's approval.

    Args:
        job: ARN of the deployment job.
        by: Name of the person who decides.
        service: The service, with its catalog and object store.

    Raises:
        ResourceNotFoundException: The catalog has no such job.
        InvalidParameterException: The deployment does not wait for approval.
    """
    found = _waiting(job, service)
    _tell(found, Approved(by=by), service)


def reject(job: str, by: str, service: Service) -> None:
    """Rejects, and so cancels, a deployment that waits for a person's approval.

    Args:
        job: ARN of the deployment job.
        by: Name of the person who decides.
        service: The service, with its catalog and object store.

    Raises:
        ResourceNotFoundException: The catalog has no such job.
        InvalidParameterException: The deployment does not wait for approval.
    """
    found = _waiting(job, service)
    _tell(found, Stopped(why="rejected", by=by), service)
    with fleet_held(str(found.parent), service) as fleet:
        settle(fleet, service)


def pause_that_waits(job: str, service: Service) -> DeploymentWait | None:
    """Returns the pause that keeps a deployment from beginning; `None` if nothing does.

    Args:
        job: ARN of the deployment job.
        service: The service, with its catalog and object store.
    """
    said = [each for each in Rollouts(service.catalog).events(job) if each.event.get("kind") in ("paused", "resumed")]
    if not said or said[-1].event["kind"] == "resumed":
        return None
    since = datetime.fromtimestamp(said[-1].at_s, UTC)
    return DeploymentWait(cause="PAUSED", since=since, by=Paused.of_json(dict(said[-1].event)).by)


def _under_way(arn: str, service: Service) -> Resource:
    ResourceArn.parse(arn, DEPLOYMENT)
    job = service.catalog.get(arn, kind=DEPLOYMENT)
    if is_terminal(job.kind, job.status):
        raise InvalidParameterException(f"{arn} has ended: it is {job.status}; nothing of it waits")
    return job


def _waiting(arn: str, service: Service) -> Resource:
    """Returns the deployment job, after checking that it waits for approval.

    Raises InvalidParameterException, which says why, if it does not.
    """
    job = _under_way(arn, service)
    stored = Rollouts(service.catalog).rollout(job.arn)
    if stored is None:
        raise InvalidParameterException(
            f"{job.arn} is {job.status}: it has not begun, so it does not wait for approval"
        )
    kept = KeptRollout(job, service)
    kept.fold()
    ledger = Ledger(kept.rollout)
    if not ledger.waits_for_approval:
        raise InvalidParameterException(f"{job.arn} does not wait for approval: {_why_not(kept.rollout)}")
    return job


def _why_not(rollout: Rollout) -> str:
    if not rollout.plan.requires_approval:
        return "its deploymentConfig has no requiresApproval"
    if rollout.approved_s is not None:
        return f"{rollout.approved_by or 'a person'} has approved it"
    if rollout.status != "InProgress":
        return f"it is {rollout.status}"
    waiting = [arn for arn in rollout.plan.canaries if not rollout.robots[arn].has_ended]
    return f"{len(waiting)} of its canaries have not ended, such as {waiting[0]}; approve when they have"


def _tell(job: Resource, event: RolloutEvent, service: Service) -> None:
    Rollouts(service.catalog).add_event(job.arn, event.to_json(), service.clock().timestamp())
    if Rollouts(service.catalog).rollout(job.arn) is not None:
        KeptRollout(job, service).fold()


def check_robots(
    document: DeploymentJobDocument, application: Resource, fleet: str, robots: Sequence[Resource]
) -> None:
    """Raises an error for a deployment that cannot reach any robot, or whose canary robots are not in its fleet.

    Args:
        document: The deployment.
        application: The version of the application.
        fleet: ARN of the fleet.
        robots: Robots of the fleet.

    Raises:
        InvalidParameterException: The fleet has no robots, none can run the application or be asked the condition, or
            a canary is not among them.
    """
    if not robots:
        raise InvalidParameterException(f"fleet: {fleet} has no robots; register some first")
    documents = [RobotDocument.of(robot) for robot in robots]
    if "downloadConditionFile" in document.deployment_config and not any(each.has_agent for each in documents):
        raise InvalidParameterException(
            f"deploymentConfig.downloadConditionFile: only agents ask it, and no robot of {fleet} has one; "
            "enroll robots with `robomaker robots enroll NAME --agent` first, or leave it out (docs/fleet/fleets.md)"
        )
    architectures = {each.architecture for each in documents}
    served = served_architectures(application)
    if served is not None and not architectures & served:
        version = document.deployment_application_configs[0]["applicationVersion"]
        raise InvalidParameterException(
            f"deploymentApplicationConfigs[0]: version {version} of {application.arn} has sources "
            f"for {_listed(served)}, the robots of {fleet} are {_listed(architectures)}; add a source for them"
        )
    if not document.repeats:  # since then, canaries may have left
        _check_canaries(DeploymentConfig.model_validate(document.deployment_config), fleet, robots)


def served_architectures(application: Resource) -> set[str] | None:
    """Returns the processor architectures that an application version supports; `None` means any."""
    served = {source.architecture for source in ApplicationDocument.of(application).sources or []}
    return None if None in served or not served else {each for each in served if each is not None}


def _check_canaries(config: DeploymentConfig, fleet: str, robots: Sequence[Resource]) -> None:
    known = {robot.arn for robot in robots} | {robot.name for robot in robots}
    for number, canary in enumerate(config.canaryRobots or []):
        if canary not in known:
            raise InvalidParameterException(
                f"deploymentConfig.canaryRobots[{number}]: {canary} is not a robot of {fleet}; name robots of the fleet"
            )


def _listed(words: set[str]) -> str:
    return ", ".join(sorted(words))
