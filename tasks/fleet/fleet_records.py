"""Fleets and enrolled robots in the catalog: robots of a fleet, deployments, and who may change them.

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
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import NamedTuple

from ...schemas.documents.document_base import FailureChanges
from ...schemas.fleet.documents import (
    DeploymentJobDocument,
    FleetChanges,
    FleetDocument,
    RobotDocument,
    RobotEnrolment,
    RobotMembership,
)
from ...schemas.fleet.rollouts.rollout import Rollout, StopCause
from ...schemas.wire.arns import ResourceArn
from ...schemas.wire.errors import (
    InvalidParameterException,
    ResourceNotFoundException,
    StateConflictError,
    ThrottlingException,
)
from ..catalog import Resource, Stored
from ..service.service import Service
from .catalog_rollouts import Rollouts
from .ddi.open_orders import OpenOrders
from .ddi.orders import is_robot_id
from .ddi.robot_tokens import hash_token, new_token
from .kept_rollouts import stop
from .rollout.statuses import robot_status

FLEET = "deployment-fleet"
ROBOT = "robot"
DEPLOYMENT = "deployment-job"

_NOT_BEGUN = ("Pending", "Preparing")
PATIENCE_S = 10.0
"""Longest time that a change of a fleet waits for other changes, in seconds."""

_LEASE_S = 60.0  # how long a fleet stays locked when the process that changes it dies
_PAUSE_S = 0.01
_PAGE = 500


@contextmanager
def fleet_held(arn: str, service: Service) -> Iterator[Resource]:
    """Locks a fleet for changes inside the `with` block: one caller at a time, over all processes.

    Args:
        arn: The fleet.
        service: The service, with its catalog and object store.

    Raises:
        InvalidParameterException: The text is not the ARN of a fleet.
        ResourceNotFoundException: The catalog has no such fleet.
        ThrottlingException: Others have kept changing it for `PATIENCE_S`.
    """
    ResourceArn.parse(arn, FLEET)
    owner = uuid.uuid4().hex
    deadline = time.monotonic() + PATIENCE_S
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
    """Lists the robots of a fleet, newest first.

    Args:
        fleet: The fleet's ARN.
        service: The service, with its catalog and object store.
        page: Number of robots that are read at once.
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
    """Returns the newest deployment job of a fleet, the only one that may be unfinished; `None` if it has had none."""
    page = service.catalog.list(DEPLOYMENT, filters={"parent": [fleet]}, limit=1)
    return page.resources[0] if page.resources else None


def rollout_of(job: str, service: Service) -> Rollout | None:
    """Returns the rollout of a deployment job; `None` if it has not begun."""
    stored = Rollouts(service.catalog).rollout(job)
    return None if stored is None else Rollout.of_json(dict(stored.rollout))


def put_into_fleet(robot: str, fleet: Resource, service: Service) -> None:
    """Adds a robot to a fleet, which the caller has locked.

    Raises:
        ResourceNotFoundException: The catalog has no such robot.
        InvalidParameterException: The robot is in another fleet.
    """
    known = service.catalog.get(robot, kind=ROBOT)
    if RobotDocument.of(known).fleet != fleet.arn:
        deployment = last_deployment(fleet.arn, service)
        rollout = None if deployment is None else rollout_of(deployment.arn, service)
        _register(known, fleet, deployment, rollout, service)


def take_out_of_fleet(robot: str, service: Service) -> None:
    """Removes a robot from its fleet, which the caller has locked.

    Raises:
        ResourceNotFoundException: The catalog has no such robot.
    """
    service.catalog.update(robot, RobotMembership(fleet=None), labels={}, status="Available")


def settle(fleet: Resource, service: Service) -> None:
    """Updates a fleet and its robots to the result of its last deployment; the caller has locked the fleet."""
    deployment = last_deployment(fleet.arn, service)
    if deployment is not None and FleetDocument.of(fleet).last_deployment_job != deployment.arn:
        service.catalog.update(fleet.arn, FleetChanges(last_deployment_job=deployment.arn))
    rollout = None if deployment is None else rollout_of(deployment.arn, service)
    for robot in robots_of(fleet.arn, service):
        with suppress(ResourceNotFoundException):  # robots may be deleted at any time
            _register(robot, fleet, deployment, rollout, service)


def end_deployment(job: Resource, why: StopCause, service: Service, changes: FailureChanges | None = None) -> None:
    """Ends a deployment job unless it has ended; the caller has locked its fleet.

    Args:
        job: The job.
        why: Cause of the end.
        service: The service, with its catalog and object store.
        changes: Why it failed, where it fails; nothing: it is canceled.
    """
    stop(job.arn, why, service)
    # A job that prepares has no rollout, or gets it just now; its run sees that the job has ended.
    with suppress(StateConflictError):
        service.catalog.transition(job.arn, "fail" if changes else "cancel", document_changes=changes)


def is_meant(robot: Resource, deployment: Resource) -> bool:
    """Whether a deployment that has not begun is for a robot; a repetition, for example, leaves out those in sync."""
    document = DeploymentJobDocument.of(deployment)
    if document.rolls_back is not None:
        return robot.arn in document.rolls_back.robots
    return robot.status != "InSync" or not document.repeats


def _status(robot: Resource, fleet: Resource, deployment: Resource | None, rollout: Rollout | None) -> str:
    """Returns the status of a robot that is in a fleet, or is being added to one."""
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


_ROBOTS_A_PAGE = 500


class _Enrolled(NamedTuple):
    arn: str
    token_sha256: str
    has_agent: bool
    tags: Mapping[str, str]


class KnownRobots:
    """Keeps the enrolled robots in the table of orders up to date; robots are known by their unique names.

    Args:
        orders: The table.
    """

    def __init__(self, orders: OpenOrders) -> None:
        self._orders = orders
        self._by_id: dict[str, _Enrolled] = {}
        self._ids: dict[str, str] = {}

    def refresh(self, service: Service) -> None:
        """Adds newly enrolled robots to the table, expels those that were deleted, and takes over new tokens."""
        found = _enrolled(service)
        for robot in self._by_id.keys() - found.keys():
            self._orders.expel(robot)
        for robot, enrolled in found.items():
            before = self._by_id.get(robot)
            if before is not None and before.arn != enrolled.arn:  # another robot with the name of one that was deleted
                self._orders.expel(robot)
            if before is None or (before.arn, before.token_sha256) != (enrolled.arn, enrolled.token_sha256):
                self._orders.enrol(robot, bytes.fromhex(enrolled.token_sha256))
        self._by_id = found
        self._ids = {enrolled.arn: robot for robot, enrolled in found.items()}

    def arn(self, robot: str) -> str | None:
        """Returns the ARN of the robot with that id; `None` if it is not enrolled."""
        enrolled = self._by_id.get(robot)
        return enrolled and enrolled.arn

    def id(self, arn: str) -> str | None:
        """Returns the id of the robot with that ARN; `None` if it is not enrolled."""
        return self._ids.get(arn)

    def has_agent(self, robot: str) -> bool:
        """Whether the robot of that id runs the project's own agent program."""
        enrolled = self._by_id.get(robot)
        return enrolled is not None and enrolled.has_agent

    def tags(self, robot: str) -> Mapping[str, str]:
        """Returns the tags of the robot with that id; empty if the robot is not enrolled."""
        enrolled = self._by_id.get(robot)
        return enrolled.tags if enrolled is not None else {}


def enrollable(name: str, service: Service) -> Resource:
    """Returns the robot of a name, after checking that its name can be part of a URL.

    Raises:
        InvalidParameterException: No robot has this name, or the name cannot be part of a URL.
    """
    robot = service.catalog.find(ROBOT, name)
    if robot is None:
        raise InvalidParameterException(f"there is no robot named {name!r}; make it with CreateRobot first")
    if not is_robot_id(name):
        raise InvalidParameterException(
            f"robot {name!r}: updaters put names into addresses, so its first character has to be a letter or a digit; "
            "make it under another name"
        )
    return robot


def replace_enrolment(**members: str | float | None) -> RobotEnrolment:
    """Makes a change of a robot's document that clears its earlier login data."""
    return RobotEnrolment.model_validate({**dict.fromkeys(RobotEnrolment.model_fields), **members})


def enrol(name: str, service: Service, random_bytes: Callable[[int], bytes], *, rotate: bool) -> str:
    """Gives a robot a login token; the catalog stores only its hash.

    Args:
        name: The robot's.
        service: The service, with its catalog and object store.
        random_bytes: Function that returns that many unpredictable bytes.
        rotate: Whether a token that it has is replaced.

    Returns:
        The token; nothing can tell it again.

    Raises:
        InvalidParameterException: There is no such robot, it has a token that is not to be replaced, or updaters cannot
            have its name in an address.
    """
    robot = enrollable(name, service)
    token = new_token(random_bytes)

    def enrolled(stored: dict[str, object]) -> RobotEnrolment:
        if RobotDocument.model_validate(stored).token_sha256 is not None and not rotate:
            raise InvalidParameterException(
                f"robot {name!r} has a token already; --rotate replaces it, and the robot then needs the new one"
            )
        return replace_enrolment(token_sha256=hash_token(token).hex())

    service.catalog.update(robot.arn, enrolled)
    return token


def _enrolled(service: Service) -> dict[str, _Enrolled]:
    found: dict[str, _Enrolled] = {}
    after = None
    while True:
        page = service.catalog.list(ROBOT, limit=_ROBOTS_A_PAGE, after=after, members=RobotEnrolment.members())
        for robot in page.resources:
            enrolment = RobotEnrolment.of_members(robot)
            token = enrolment.token_sha256
            if token is not None:
                found[robot.name] = _Enrolled(robot.arn, token, enrolment.has_agent, robot.tags)
        if (after := page.next_token) is None:
            return found
