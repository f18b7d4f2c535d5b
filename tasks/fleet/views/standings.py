"""How fleets, their robots and their deployments stand, from the catalog."""

from contextlib import suppress
from datetime import UTC, datetime

from ....schemas.documents.fleets import DeploymentJobDocument, RobotDocument
from ....schemas.rollouts.robots import RobotDeploymentState
from ....schemas.rollouts.rollout import Rollout
from ....schemas.rollouts.standings import DeploymentStanding, FleetStanding, OrderStanding, RobotStanding
from ....schemas.wire.arns import ResourceArn
from ....schemas.wire.errors import InvalidParameterException
from ...catalog import Resource
from ...service.service import Service
from ..records import last_deployment, robots_of, rollout_of
from ..rollout.counts import counts_of, current_wave
from ..rollout.thresholds import Tally
from ..rollout.waits import shown_rollback, waits_for
from ..rollout.waves import waves_of


def fleet_standing(fleet: Resource, service: Service) -> FleetStanding:
    """How a fleet stands: its robots, and its latest deployment."""
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
    """How a deployment stands.

    Args:
        job: its job.
        rollout: its rollout; nothing: it has not begun.
        now_s: the time, in seconds since the epoch.
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
    """Name and version of the application that a deployment job deploys; the name is that of its ARN."""
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
