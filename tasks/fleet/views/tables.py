"""Robots of a rollout as rows of a table, for Prefect."""

from collections.abc import Iterable

from ....schemas.rollouts.rollout import Rollout
from ....schemas.wire.arns import ResourceArn
from ..rollout.statuses import robot_status

MOST_ROWS = 500
"""Limit on the rows of a wave's table; the first robots are shown, and the report covers all."""


def robot_rows(rollout: Rollout, robots: Iterable[str]) -> list[dict[str, str | float | None]]:
    """One row for each robot: name, status, step, failure, and how long it took in seconds.

    Args:
        rollout: the rollout.
        robots: their ARNs.
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
