"""Waits of a rollout besides its robots, and rollbacks, as DescribeDeploymentJob shows them."""

from datetime import UTC, datetime

from ....schemas.operations.deployment_jobs import DeploymentRollback, DeploymentWait
from ....schemas.rollouts.rollout import Rollout
from .ledger import Ledger
from .windows import is_open, opens_s


def waits_for(rollout: Rollout, now_s: float) -> list[DeploymentWait]:
    """Lists what the next orders wait for; empty: nothing, or the rollout has ended.

    Args:
        rollout: the rollout.
        now_s: the time, in seconds since the epoch.
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
    """How robots go back, as DescribeDeploymentJob shows it; nothing: they do not, or not yet."""
    back = rollout.rollback
    if back is None:
        return None
    return DeploymentRollback(jobs=list(back.jobs) or None, robotsLeft=list(back.left) or None, reason=back.reason)


def in_words(wait: DeploymentWait, job: str) -> str:
    """Describes a wait of a deployment, and how a person can end it.

    Args:
        wait: one of `waits_for`.
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
    """A time in seconds since the epoch, as answers show it."""
    return None if time_s is None else datetime.fromtimestamp(time_s, UTC)
