"""State of a rollout as `DescribeDeploymentJob` returns it.

It has the status, progress and failure of each robot, counts, and causes of waiting.
"""

from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime

from ....schemas.fleet.operations.deployment_jobs import (
    DeploymentRollback,
    DeploymentWait,
    ProgressDetail,
    RobotDeployment,
)
from ....schemas.fleet.operations.robots import RobotStatus
from ....schemas.fleet.rollouts.rollout import RobotDeploymentState, Rollout
from .download_progress import remaining_s
from .ledger import Ledger
from .maintenance_windows import is_open, opens_s


def counts_of(rollout: Rollout) -> Counter[str]:
    """Counts the robots of a deployment that succeeded, failed, were canceled, are deploying, or wait."""
    return Counter(_word(state) for state in rollout.robots.values())


def current_wave(rollout: Rollout, waves: Sequence[Sequence[str]]) -> int:
    """Returns the number, from 1, of the first wave (group of robots) that has not finished."""
    for number, robots in enumerate(waves, 1):
        if not all(rollout.robots[robot].has_ended for robot in robots):
            return number
    return len(waves)


def _word(state: RobotDeploymentState) -> str:
    if state.has_ended:
        return state.outcome or "canceled"
    return "deploying" if state.is_open else "waiting"


def waits_for(rollout: Rollout, now_s: float) -> list[DeploymentWait]:
    """Lists why no further robots may begin to install now; empty if they may, or the deployment has ended.

    Args:
        rollout: The rollout.
        now_s: The time, in seconds since the epoch.
    """
    if rollout.status != "InProgress":
        return []
    found: list[DeploymentWait] = []
    if rollout.paused:
        found.append(DeploymentWait(cause="PAUSED", since=moment_of(rollout.paused_s), by=rollout.paused_by))
    is_asked = rollout.plan.requires_approval and rollout.approved_s is None
    if is_asked and Ledger(rollout).waits_for_approval:  # reading it takes a while in a large fleet
        found.append(DeploymentWait(cause="APPROVAL"))
    windows = rollout.plan.windows
    if not is_open(windows, now_s):
        found.append(DeploymentWait(cause="MAINTENANCE_WINDOW", until=moment_of(opens_s(windows, now_s))))
    return found


def shown_rollback(rollout: Rollout) -> DeploymentRollback | None:
    """Returns the state of the rollback for `DescribeDeploymentJob`; `None` if there is no rollback."""
    back = rollout.rollback
    if back is None:
        return None
    return DeploymentRollback(jobs=list(back.jobs) or None, robotsLeft=list(back.left) or None, reason=back.reason)


def in_words(wait: DeploymentWait, job: str) -> str:
    """Describes why a deployment waits, and how a person can end the wait.

    An example: `waits for its maintenance window, which opens at 2026-11-27T22:00+00:00`.

    Args:
        wait: One of `waits_for`.
        job: ARN of the deployment job.
    """
    if wait.cause == "PAUSED":
        by = f" by {wait.by}" if wait.by else ""
        return f"paused{by}; `robomaker fleet resume {job}` lets it go on"
    if wait.cause == "APPROVAL":
        return f"waits for approval; `robomaker fleet approve {job}`, or `reject`, decides"
    until = "" if wait.until is None else f" at {wait.until.isoformat(timespec='minutes')}"
    return f"waits for its maintenance window, which opens{until}"


def moment_of(time_s: float | None) -> datetime | None:
    """Converts seconds since the epoch to a time in UTC, as responses show it; `None` stays `None`."""
    return None if time_s is None else datetime.fromtimestamp(time_s, UTC)


def robot_status(state: RobotDeploymentState, *, active: bool) -> RobotStatus | None:
    """Returns a robot's status (such as InSync or Failed) from its state in the latest rollout.

    Args:
        state: State of the robot in the latest rollout of its fleet.
        active: Whether the rollout is in progress.

    Returns:
        The status; nothing for a robot that was deleted.
    """
    if state.gone is not None:
        return "Available" if state.gone == "left" else None
    if state.order == "offered":
        return "PendingNewDeployment"
    if state.order == "fetched":
        return "Deploying"
    if state.outcome == "succeeded":
        return "InSync"
    if state.outcome == "failed":
        return "NoResponse" if state.no_response else "Failed"
    return "PendingNewDeployment" if active else "Registered"


def robot_deployments(rollout: Rollout, job: str, now_s: float) -> list[RobotDeployment]:
    """Returns the deployment's state on each robot for a response, in the plan's order.

    Args:
        rollout: The rollout.
        job: ARN of its deployment job.
        now_s: The time.
    """
    active = rollout.status == "InProgress"
    return [_deployment(arn, rollout.robots[arn], active, job, now_s) for arn in rollout.plan.order]


def _deployment(robot: str, state: RobotDeploymentState, active: bool, job: str, now_s: float) -> RobotDeployment:
    reason, code = state.failure_reason, state.failure_code
    if state.gone is not None and state.outcome is None:
        code = "RobotDeploymentAborted"
        reason = "the robot left the fleet" if state.gone == "left" else "the robot was deleted"
    return RobotDeployment(
        arn=robot,
        deploymentStartTime=moment_of(state.started_s),
        deploymentFinishTime=moment_of(state.finished_s) if state.has_ended else None,
        status=robot_status(state, active=active),
        progressDetail=_progress(state, job, now_s),
        failureReason=reason,
        failureCode=code,
    )


def _progress(state: RobotDeploymentState, job: str, now_s: float) -> ProgressDetail | None:
    if state.step is None:
        return None
    downloads = state.step == "DownloadingExtracting"
    return ProgressDetail(
        currentProgress=state.step,
        percentDone=state.percent_done if downloads else None,
        estimatedTimeRemainingSeconds=remaining_s(state, now_s) if state.order == "fetched" else None,
        targetResource=job,
    )
