"""States of fleets, their robots and their deployments, from the catalog; finding a deployment and following it."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime

from ....schemas.fleet.documents import DeploymentJobDocument, RobotDocument
from ....schemas.fleet.rollouts.rollout import RobotDeploymentState, Rollout
from ....schemas.fleet.rollouts.standings import DeploymentStanding, FleetStanding, OrderStanding, RobotStanding
from ....schemas.lifecycles import is_terminal
from ....schemas.wire.arns import ResourceArn
from ....schemas.wire.errors import InvalidParameterException
from ...catalog import Resource
from ...service.service import Service
from ..catalog_rollouts import Rollouts
from ..fleet_records import DEPLOYMENT, FLEET, last_deployment, robots_of, rollout_of
from ..rollout.failure_thresholds import Tally
from ..rollout.statuses import counts_of, current_wave, shown_rollback, waits_for
from ..rollout.waves import waves_of


def fleet_standing(fleet: Resource, service: Service) -> FleetStanding:
    """Returns the status of a fleet: its robots, and its latest deployment."""
    job = last_deployment(fleet.arn, service)
    rollout = None if job is None else rollout_of(job.arn, service)
    states = {} if rollout is None else rollout.robots
    return FleetStanding(
        fleet=fleet.name,
        arn=fleet.arn,
        robots=tuple(_robot(robot, states.get(robot.arn)) for robot in reversed(robots_of(fleet.arn, service))),
        deployment=None if job is None else deployment_standing(job, rollout, service.clock().timestamp()),
    )


def deployment_standing(job: Resource, rollout: Rollout | None, now_s: float) -> DeploymentStanding:
    """Returns the status of a deployment for `robomaker fleet status`.

    Args:
        job: The deployment job.
        rollout: Rollout of the job; `None`: it has not begun.
        now_s: The time, in seconds since the epoch.
    """
    document = DeploymentJobDocument.of(job)
    application, version = deployed_by(job)
    members: dict[str, object] = {
        "job": job.arn,
        "status": job.status,
        "application": application,
        "version": version,
        "created_at": job.created_at,
        "failure_code": document.failure_code,
        "failure_reason": document.failure_reason,
        "rolls_back": None if document.rolls_back is None else document.rolls_back.job,
    }
    return DeploymentStanding.model_validate(members | ({} if rollout is None else _progress(rollout, now_s)))


def deployed_by(job: Resource) -> tuple[str, str]:
    """Returns name and version of the application that a deployment job deploys."""
    (config,) = DeploymentJobDocument.of(job).deployment_application_configs
    name = str(config["application"])
    with suppress(InvalidParameterException):
        name = ResourceArn.parse(name).name
    return name, str(config["applicationVersion"])


def _progress(rollout: Rollout, now_s: float) -> dict[str, object]:
    tally = Tally(rollout.plan)
    for robot, state in rollout.robots.items():
        tally.count(robot, state, 1)
    waves = waves_of(rollout.plan)
    return {
        "robots": len(rollout.robots),
        "counts": dict(counts_of(rollout)),
        "wave": current_wave(rollout, waves),
        "waves": len(waves),
        "failed_percent": round(100 * tally.fleet.failed / max(tally.fleet.robots, 1), 1),
        "threshold_percent": rollout.plan.threshold_percentage,
        "paused": rollout.paused,
        "waits": tuple(waits_for(rollout, now_s)),
        "rollback_is_due": rollout.plan.rolls_back
        and rollout.failure_code == "FailureThresholdBreached"
        and rollout.rollback is None,
        "rollback": shown_rollback(rollout),
    }


def _robot(robot: Resource, state: RobotDeploymentState | None) -> RobotStanding:
    document = RobotDocument.of(robot)
    seen_s = document.last_seen_s
    has_failed = state is not None and state.outcome == "failed"
    return RobotStanding(
        robot=robot.name,
        kind=None if document.token_sha256 is None else "agent" if document.has_agent else "updater",
        status=robot.status,
        version=document.installed,
        last_seen=None if seen_s is None else datetime.fromtimestamp(int(seen_s), UTC),
        order=None if state is None else _order(state),
        failure_code=state.failure_code if state is not None and has_failed else None,
        failure_reason=state.failure_reason if state is not None and has_failed else None,
    )


def _order(state: RobotDeploymentState) -> OrderStanding | None:
    if state.action_id is None or state.order in ("none", "closed"):
        return None
    return OrderStanding(
        number=state.action_id,
        state=state.order,
        step=state.step,
        percent_done=state.percent_done if state.step == "DownloadingExtracting" else None,
    )


_PAGE = 100


def fleets(service: Service) -> Iterator[Resource]:
    """Yields all fleets, newest first."""
    after = None
    while True:
        page = service.catalog.list(FLEET, limit=_PAGE, after=after)
        yield from page.resources
        if (after := page.next_token) is None:
            return


def find_fleet(fleet: str, service: Service) -> Resource:
    """Finds a fleet by its name or ARN.

    Raises:
        InvalidParameterException: No fleet has this name, or the ARN is not that of a fleet.
        ResourceNotFoundException: The catalog has no fleet of this ARN.
    """
    if fleet.startswith("arn:"):
        ResourceArn.parse(fleet, FLEET)
        return service.catalog.get(fleet, kind=FLEET)
    if (found := service.catalog.find(FLEET, fleet)) is None:
        raise InvalidParameterException(
            f"there is no fleet named {fleet!r}; `robomaker fleet status` lists those there are"
        )
    return found


def find_deployment(named: str | None, service: Service) -> Resource:
    """Finds a deployment job by ARN, by its fleet, or as the only one in progress.

    Args:
        named: Name or ARN that the user gave; `None`: the only deployment in progress.
        service: The service, with its catalog and object store.

    Raises:
        InvalidParameterException: Nothing has this name, the fleet has had no deployment, or none or several
            deployments are in progress.
        ResourceNotFoundException: The catalog has no resource of this ARN.
    """
    if named is None:
        return _only_one(service)
    if named.startswith("arn:") and ResourceArn.parse(named, FLEET, DEPLOYMENT).kind == DEPLOYMENT:
        return service.catalog.get(named, kind=DEPLOYMENT)
    fleet = find_fleet(named, service)
    if (found := last_deployment(fleet.arn, service)) is None:
        raise InvalidParameterException(f"fleet {fleet.name!r} has had no deployment; CreateDeploymentJob makes one")
    return found


def _only_one(service: Service) -> Resource:
    latest = [last_deployment(fleet.arn, service) for fleet in fleets(service)]
    found = [job for job in latest if job is not None and not is_terminal(DEPLOYMENT, job.status)]
    if len(found) == 1:
        return found[0]
    if not found:
        raise InvalidParameterException("no deployment goes on; name a fleet, or the ARN of a deployment")
    names = ", ".join(sorted(ResourceArn.parse(str(job.parent)).name for job in found))
    raise InvalidParameterException(f"deployments to {len(found)} fleets go on: {names}; name one of them")


LOOK_S = 1.0
"""Interval between two snapshots of a deployment, in seconds."""


@dataclass(frozen=True)
class Look:
    """Snapshot of a deployment's state, for a command that follows it."""

    job: Resource
    at_s: float
    """Time of a deployment's snapshot, in seconds since the epoch."""

    rollout: Rollout | None = None
    """States of the robots; `None`: the deployment has not begun."""

    waves: Sequence[tuple[str, ...]] = ()
    """ARNs of the robots of each wave of a deployment."""

    @property
    def has_ended(self) -> bool:
        """Whether the deployment job had its final status at the snapshot, such as succeeded, failed or canceled."""
        return is_terminal(DEPLOYMENT, self.job.status)


def follow(job: Resource, service: Service, sleep: Callable[[float], object]) -> Iterator[Look]:
    """Yields snapshots of a deployment until it has ended.

    Args:
        job: The deployment job.
        service: The service, with its catalog and object store.
        sleep: Waits, in seconds.

    Raises:
        ResourceNotFoundException: The deployment was deleted.
        ServiceUnavailableException: The catalog does not answer.
    """
    look, revision = _look(job, service), None
    while True:
        yield look
        if look.has_ended:
            return
        sleep(LOOK_S)
        job = service.catalog.get(job.arn)
        now = Rollouts(service.catalog).open_rollouts(str(job.parent)).get(job.arn)
        if now is None or now != revision or is_terminal(DEPLOYMENT, job.status):
            look, revision = _look(job, service), now
        else:
            look = Look(job, service.clock().timestamp(), look.rollout, look.waves)


def _look(job: Resource, service: Service) -> Look:
    rollout, at_s = rollout_of(job.arn, service), service.clock().timestamp()
    return Look(job, at_s) if rollout is None else Look(job, at_s, rollout, waves_of(rollout.plan))
