"""Fleets in the catalog: which robots they have, what is deployed to them, and who may change that.

A robot's document says which fleet it is in, a deployment job's parent is its fleet. What follows from
these is stored besides, for lists: a robot's status, and the fleet's last deployment in its document.
A call that changes several of them holds the fleet's lease meanwhile. If its process dies, the next change brings
the rest up to date.

| status | when |
| --- | --- |
| `Available` | it is in no fleet |
| `PendingNewDeployment` | it is in a fleet whose last deployment has not begun |
| `Registered` | it is in a fleet otherwise |
"""

import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from ...schemas.documents.base import FailureChanges
from ...schemas.documents.fleets import FleetChanges, FleetDocument, RobotDocument, RobotMembership
from ...schemas.lifecycles import is_terminal
from ...schemas.wire.arns import ResourceArn
from ...schemas.wire.errors import InvalidParameterException, ResourceNotFoundException, ThrottlingException
from ..catalog import Resource, Stored
from ..service.service import Service

FLEET = "deployment-fleet"
ROBOT = "robot"
DEPLOYMENT = "deployment-job"

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


def put_into_fleet(robot: str, fleet: Resource, service: Service) -> None:
    """Registers a robot with a fleet, whose lease the caller holds; of no effect on one that is.

    Raises:
        ResourceNotFoundException: there is no such robot.
        InvalidParameterException: it is in another fleet.
    """
    known = service.catalog.get(robot, kind=ROBOT)
    if RobotDocument.of(known).fleet != fleet.arn:
        _register(robot, fleet, last_deployment(fleet.arn, service), service)


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
    for robot in robots_of(fleet.arn, service):
        with suppress(ResourceNotFoundException):  # robots may be deleted at any time
            _register(robot.arn, fleet, deployment, service)


def end_deployment(job: Resource, event: str, service: Service, changes: FailureChanges | None = None) -> None:
    """Ends a deployment job unless it has ended; the caller holds the lease of its fleet.

    Args:
        job: the job.
        event: how, an event of its lifecycle.
        service: where it is stored.
        changes: members of its document that are set with it.
    """
    if not is_terminal(DEPLOYMENT, service.catalog.get(job.arn, kind=DEPLOYMENT).status):
        service.catalog.transition(job.arn, event, document_changes=changes)


def _register(robot: str, fleet: Resource, deployment: Resource | None, service: Service) -> None:
    waits = deployment is not None and deployment.status == "Pending"

    def registered(stored: Stored) -> RobotMembership:
        document = RobotDocument.model_validate(stored)
        if document.fleet not in (None, fleet.arn):
            raise InvalidParameterException(
                f"robot: {robot} is registered with {document.fleet}; deregister it there first"
            )
        if deployment is not None and waits:
            return RobotMembership(last_deployment_job=deployment.arn, fleet=fleet.arn)
        return RobotMembership(fleet=fleet.arn)

    status = "PendingNewDeployment" if waits else "Registered"
    service.catalog.update(robot, registered, labels={"fleetName": [fleet.name]}, status=status)
