"""A rollout as DescribeDeploymentJob shows it: the status, progress and failure of each robot."""

from ....schemas.operations.deployment_jobs import ProgressDetail, RobotDeployment
from ....schemas.operations.robots import RobotStatus
from ....schemas.rollouts.robots import RobotDeploymentState
from ....schemas.rollouts.rollout import Rollout
from .estimates import remaining_s
from .waits import moment_of


def robot_status(state: RobotDeploymentState, *, active: bool) -> RobotStatus | None:
    """The status of a robot.

    Args:
        state: how it stands in the latest rollout of its fleet.
        active: whether that rollout goes on.

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
    """The deployments to single robots, in the plan's order.

    Args:
        rollout: the rollout.
        job: ARN of its deployment job.
        now_s: the time.
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
