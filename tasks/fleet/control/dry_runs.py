"""Dry runs of deployments: which robot would get which version, in which wave. Nothing is stored."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from ....schemas.documents.applications import ApplicationDocument
from ....schemas.fleet.documents import DeploymentJobDocument, RobotDocument
from ....schemas.fleet.operations.deployment_jobs import MaintenanceWindow
from ....schemas.fleet.rollouts.rollout_plan import RolloutPlan
from ....schemas.lifecycles import is_terminal
from ...catalog import Resource
from ...service.service import Service
from ..fleet_records import DEPLOYMENT, last_deployment, robots_of
from ..rollout.maintenance_windows import is_open, opens_s
from ..rollout.waves import waves_of
from ..rollout_beginnings import plan_of
from .deployment_decisions import served_architectures

AWAY_S = 300.0
"""Time without a poll after which a robot counts as away, in seconds."""


@dataclass(frozen=True)
class PlannedChange:
    """The change that a deployment would make to one robot."""

    robot: str
    """Name of a robot in a deployment's forecast."""

    wave: int | None
    """Number of the robot's wave, from 1; `None`: it cannot get the application."""

    is_canary: bool
    before: str | None
    """Application and version that the robot has; `None`: unknown."""

    after: str | None
    """Application and version that the robot would get; `None`: none."""

    notes: tuple[str, ...]
    """Notes for people about this robot in a deployment's forecast, such as a missing architecture."""


@dataclass(frozen=True)
class DryRun:
    """Forecast of a deployment to a fleet: its changes to robots, and when it may begin."""

    changes: tuple[PlannedChange, ...]
    """Changes to robots, in the order in which they get their orders.

    Robots that cannot get the application are last.
    """

    at_once: int
    """Limit of the robots that have orders at the same time in a deployment."""

    requires_approval: bool
    rolls_back: bool
    windows: tuple[MaintenanceWindow, ...]
    opens_s: float | None
    """Earliest start of the first robot, in seconds since the epoch; `None`: immediately."""

    blocked_by: str | None
    """ARN of an unfinished deployment of the fleet, because of which this one would be refused.

    `None`: there is none.
    """


def dry_run(document: DeploymentJobDocument, application: Resource, fleet: Resource, service: Service) -> DryRun:
    """Forecasts a deployment to a fleet without starting it.

    Args:
        document: The deployment, as it would be stored.
        application: The version of the application.
        fleet: The fleet.
        service: The service, with its catalog and object store.
    """
    job = Resource.new(arn=f"{fleet.arn}/dry-run", kind=DEPLOYMENT, id="dry-run", status="Pending", document=document)
    robots = list(reversed(robots_of(fleet.arn, service)))
    served = served_architectures(application)
    plan = plan_of(job, robots, lambda robot: served is None or RobotDocument.of(robot).architecture in served)
    now_s = service.clock().timestamp()
    last = last_deployment(fleet.arn, service)
    return DryRun(
        changes=_changes(plan, robots, application, now_s),
        at_once=plan.concurrency,
        requires_approval=plan.requires_approval,
        rolls_back=plan.rolls_back,
        windows=plan.windows,
        opens_s=None if is_open(plan.windows, now_s) else opens_s(plan.windows, now_s),
        blocked_by=None if last is None or is_terminal(DEPLOYMENT, last.status) else last.arn,
    )


def _changes(
    plan: RolloutPlan, robots: Sequence[Resource], application: Resource, now_s: float
) -> tuple[PlannedChange, ...]:
    by_arn = {robot.arn: robot for robot in robots}
    unfit = {robot.arn: robot.unfit_reason for robot in plan.robots if robot.unfit_code is not None}
    after = f"{application.name} {ApplicationDocument.of(application).version}"
    found: list[PlannedChange] = []
    for wave, arns in enumerate(waves_of(plan), 1):
        for arn in arns:
            robot = RobotDocument.of(by_arn[arn])
            before = robot.installed
            notes = [*_absence(robot, now_s), *(["has this version"] if before == after else [])]
            is_canary = arn in plan.canaries
            found.append(PlannedChange(by_arn[arn].name, wave, is_canary, before, after, tuple(notes)))
    for arn, reason in unfit.items():
        robot = RobotDocument.of(by_arn[arn])
        notes = (str(reason), *_absence(robot, now_s))
        found.append(PlannedChange(by_arn[arn].name, None, False, robot.installed, None, notes))
    return tuple(found)


def _absence(robot: RobotDocument, now_s: float) -> list[str]:
    """Returns the reason why a robot would not fetch an order now; empty if it would."""
    if robot.token_sha256 is None:
        return ["not enrolled"]
    if robot.last_seen_s is None:
        return ["never seen"]
    if now_s - robot.last_seen_s > AWAY_S:
        return [f"away since {datetime.fromtimestamp(int(robot.last_seen_s), UTC).isoformat()}"]
    return []
