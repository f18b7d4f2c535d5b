"""Table rows for the robots of a rollout, and notes about a deployment, for Prefect."""

from collections.abc import Iterable, Iterator

from ....schemas.fleet.rollouts.rollout import Rollout
from ....schemas.fleet.rollouts.standings import DeploymentStanding
from ....schemas.wire.arns import ResourceArn
from ..rollout.statuses import in_words, robot_status

MOST_ROWS = 500
"""Limit on the rows of a wave's table; the first robots are shown, and the report covers all."""


def robot_rows(rollout: Rollout, robots: Iterable[str]) -> list[dict[str, str | float | None]]:
    """Makes a table row for each robot of a deployment: name, status, step, failure, duration in seconds.

    Args:
        rollout: The rollout.
        robots: ARNs of the robots.
    """
    active = rollout.status == "InProgress"
    before = {robot.arn: robot.installed for robot in rollout.plan.robots}
    rows: list[dict[str, str | float | None]] = []
    for arn in list(robots)[:MOST_ROWS]:
        state = rollout.robots[arn]
        ended = state.offered_s is not None and state.finished_s is not None
        rows.append(
            {
                "robot": ResourceArn.parse(arn).name,
                "status": robot_status(state, active=active) or "deleted",
                "step": state.step,
                "failure code": state.failure_code,
                "reason": state.failure_reason,
                "version before": before[arn],
                "took s": round(state.finished_s - state.offered_s, 1) if ended else None,  # type: ignore[operator]
            }
        )
    return rows


_MOST_NAMES = 10


def notes_of(deployment: DeploymentStanding) -> Iterator[str]:
    """Yields sentences on why a deployment waits or was paused; none where it only waits for robots."""
    if deployment.rolls_back is not None:
        yield f"brings robots back after {_short(deployment.rolls_back)} failed"
    for wait in deployment.waits:
        yield in_words(wait, deployment.job)
    if deployment.rollback_is_due:
        yield "robots that have the new version go back as soon as those that have begun have ended"
    back = deployment.rollback
    if back is None:
        return
    if back.jobs:
        yield f"robots go back by {', '.join(_short(job) for job in back.jobs)}"
    if back.robotsLeft:
        names = ", ".join(ResourceArn.parse(robot).name for robot in back.robotsLeft[:_MOST_NAMES])
        more = f" and {len(back.robotsLeft) - _MOST_NAMES:,} more" if len(back.robotsLeft) > _MOST_NAMES else ""
        yield f"no earlier version is known of {names}{more}"
    if back.reason:
        yield f"robots do not go back: {back.reason}"


def _short(job: str) -> str:
    return job.rpartition("/")[2]
