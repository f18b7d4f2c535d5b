"""Fleets in the catalog: which robots they have, what is deployed to them, and who may change that.

A robot's document says which fleet it is in, a deployment job's parent is its fleet. What follows from
these is stored besides, for lists: a robot's status, and the fleet's last deployment in its document.
A call that changes several of them holds the fleet's lease meanwhile. If its process dies, the next change brings
the rest up to date.

| status | when |
| --- | --- |
| `Available` | it is in no fleet |
| `PendingNewDeployment` | its fleet's last deployment has not begun, or its turn has not come |
| `Deploying` | it has fetched its order |
| `InSync`, `Failed`, `NoResponse` | that is how the last deployment to it ended |
| `Registered` | it is in a fleet otherwise |
"""

import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from ...schemas.documents.base import FailureChanges
from ...schemas.documents.fleets import (
    DeploymentJobDocument,
    FleetChanges,
    FleetDocument,
    RobotDocument,
    RobotMembership,
)
from ...schemas.rollouts.events import StopCause
from ...schemas.rollouts.rollout import Rollout
from ...schemas.wire.arns import ResourceArn
from ...schemas.wire.errors import (
    InvalidParameterException,
    ResourceNotFoundException,
    StateConflictError,
    ThrottlingException,
)
from ..catalog import Resource, Stored
from ..service.service import Service
from .rollout.statuses import robot_status
from .stored_rollouts import stop

FLEET = "deployment-fleet"
ROBOT = "robot"
DEPLOYMENT = "deployment-job"

_NOT_BEGUN = ("Pending", "Preparing")
_LEASE_S = 60.0  # how long a fleet stays locked when the process that changes it dies
_PAUSE_S = 0.01
_PAGE = 500


@contextmanager
def fleet_held(arn: str, service: Service) -> Iterator[Resource]:
    """Lets one caller at a time change what belongs to a fleet, in this process or another.

    Args:
        arn: the fleet.
        service: where it is stored.

    Raises:
        InvalidParameterException: it is no ARN of a fleet.
        ResourceNotFoundException: there is no such fleet.
        ThrottlingException: others have kept changing it for `Timing.fleet_patience_s`.
    """
    ResourceArn.parse(arn, FLEET)
    owner = uuid.uuid4().hex
    deadline = time.monotonic() + service.timing.fleet_patience_s
    while not service.catalog.claim(arn, owner, _LEASE_S):
        if time.monotonic() > deadline:
            raise ThrottlingException(f"{arn} is being changed by others; try again")
        time.sleep(_PAUSE_S)
    try:
        yield service.catalog.get(arn, kind=FLEET)
    finally:
        with suppress(ResourceNotFoundException):  # the change was its deletion
            service.catalog.release(arn, owner)


def robots_of(fleet: str, service: Service, page: int = _PAGE) -> list[Resource]:
    """The robots of a fleet, newest first.

    Args:
        fleet: the fleet's ARN.
        service: where they are stored.
        page: how many are read at once.
    """
    found: list[Resource] = []
    after = None
    while True:
        filters = {"fleetName": [ResourceArn.parse(fleet, FLEET).name]}
        some = service.catalog.list(ROBOT, filters=filters, limit=page, after=after)
        found += [robot for robot in some.resources if RobotDocument.of(robot).fleet == fleet]  # names may repeat
        if (after := some.next_token) is None:
            return found


def last_deployment(fleet: str, service: Service) -> Resource | None:
    """The newest deployment job of the fleet of an ARN; if one has not ended, it is this."""
    page = service.catalog.list(DEPLOYMENT, filters={"parent": [fleet]}, limit=1)
    return page.resources[0] if page.resources else None


def rollout_of(job: str, service: Service) -> Rollout | None:
    """The rollout of the deployment job of an ARN; nothing: it has not begun."""
    stored = service.catalog.rollout(job)
    return None if stored is None else Rollout.of_json(dict(stored.rollout))


def put_into_fleet(robot: str, fleet: Resource, service: Service) -> None:
    """Registers a robot with a fleet, whose lease the caller holds; of no effect on one that is.

    Raises:
        ResourceNotFoundException: there is no such robot.
        InvalidParameterException: it is in another fleet.
    """
    known = service.catalog.get(robot, kind=ROBOT)
    if RobotDocument.of(known).fleet != fleet.arn:
        deployment = last_deployment(fleet.arn, service)
        rollout = None if deployment is None else rollout_of(deployment.arn, service)
        _register(known, fleet, deployment, rollout, service)


def take_out_of_fleet(robot: str, service: Service) -> None:
    """Deregisters a robot from the fleet it is in, whose lease the caller holds.

    Raises:
        ResourceNotFoundException: there is no such robot.
    """
    service.catalog.update(robot, RobotMembership(fleet=None), labels={}, status="Available")


def settle(fleet: Resource, service: Service) -> None:
    """Brings a fleet and its robots up to date with its last deployment; the caller holds its lease."""
    deployment = last_deployment(fleet.arn, service)
    if deployment is not None and FleetDocument.of(fleet).last_deployment_job != deployment.arn:
        service.catalog.update(fleet.arn, FleetChanges(last_deployment_job=deployment.arn))
    rollout = None if deployment is None else rollout_of(deployment.arn, service)
    for robot in robots_of(fleet.arn, service):
        with suppress(ResourceNotFoundException):  # robots may be deleted at any time
            _register(robot, fleet, deployment, rollout, service)


def end_deployment(job: Resource, why: StopCause, service: Service, changes: FailureChanges | None = None) -> None:
    """Ends a deployment job unless it has ended; the caller holds the lease of its fleet.

    Args:
        job: the job.
        why: what ends it.
        service: where it is stored.
        changes: why it failed, where it fails; nothing: it is canceled.
    """
    stop(job.arn, why, service)
    # A job that prepares has no rollout, or gets it just now; its run sees that the job has ended.
    with suppress(StateConflictError):
        service.catalog.transition(job.arn, "fail" if changes else "cancel", document_changes=changes)


def is_meant(robot: Resource, deployment: Resource) -> bool:
    """Whether a deployment that has not begun is meant for a robot of its fleet."""
    document = DeploymentJobDocument.of(deployment)
    if document.rolls_back is not None:
        return robot.arn in document.rolls_back.robots
    return robot.status != "InSync" or not document.repeats


def _status(robot: Resource, fleet: Resource, deployment: Resource | None, rollout: Rollout | None) -> str:
    """The status of a robot that is in a fleet, or about to be."""
    if deployment is None:
        return "Registered"
    state = None if rollout is None else rollout.robots.get(robot.arn)
    if rollout is not None and state is not None and state.gone is None:
        return robot_status(state, active=rollout.status == "InProgress") or "Registered"
    if rollout is None and deployment.status in _NOT_BEGUN and is_meant(robot, deployment):
        return "PendingNewDeployment"
    left_alone = robot.status == "InSync" and RobotDocument.of(robot).fleet == fleet.arn
    return "InSync" if left_alone and DeploymentJobDocument.of(deployment).repeats else "Registered"


def _register(
    robot: Resource, fleet: Resource, deployment: Resource | None, rollout: Rollout | None, service: Service
) -> None:
    status = _status(robot, fleet, deployment, rollout)
    waits = status == "PendingNewDeployment"
    known = RobotDocument.of(robot)
    meant = deployment.arn if deployment is not None and waits else known.last_deployment_job
    if (robot.status, known.fleet, known.last_deployment_job) == (status, fleet.arn, meant):
        return

    def registered(stored: Stored) -> RobotMembership:
        document = RobotDocument.model_validate(stored)
        if document.fleet not in (None, fleet.arn):
            raise InvalidParameterException(
                f"robot: {robot.arn} is registered with {document.fleet}; deregister it there first"
            )
        if deployment is not None and waits:
            return RobotMembership(last_deployment_job=deployment.arn, fleet=fleet.arn)
        return RobotMembership(fleet=fleet.arn)

    service.catalog.update(robot.arn, registered, labels={"fleetName": [fleet.name]}, status=status)
