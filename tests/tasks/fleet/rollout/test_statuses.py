"""What DescribeDeploymentJob shows of robots."""

from helpers.small_rollouts import SmallRollout

from prefect_robomaker.schemas.fleet.rollouts.rollout import Failed, RobotGone
from prefect_robomaker.tasks.fleet.rollout.statuses import robot_deployments

NAME = "arn:aws:robomaker:us-east-1:000000000000:robot/rover/"
JOB = "arn:aws:robomaker:us-east-1:000000000000:deployment-job/deployment-1"


def downloading() -> SmallRollout:
    """A rollout to one robot, a quarter of whose download took ten seconds."""
    rollout = SmallRollout(1, name=NAME)
    rollout.offer()
    rollout.fetch(f"{NAME}0")
    rollout.progress(f"{NAME}0", "DownloadingExtracting", 0)
    rollout.wait(10)
    rollout.progress(f"{NAME}0", "DownloadingExtracting", 25)
    return rollout


def test_describe_shows_progress_of_downloads_only() -> None:
    rollout = downloading()
    (robot,) = robot_deployments(rollout.rollout, JOB, rollout.now_s)
    assert robot.to_wire()["progressDetail"] == {
        "currentProgress": "DownloadingExtracting",
        "percentDone": 25.0,
        "estimatedTimeRemainingSeconds": 30,
        "targetResource": JOB,
    }

    rollout.progress(f"{NAME}0", "Launching")
    (robot,) = robot_deployments(rollout.rollout, JOB, rollout.now_s)
    assert robot.to_wire()["progressDetail"] == {"currentProgress": "Launching", "targetResource": JOB}


def test_describe_shows_when_a_robot_began_and_ended() -> None:
    rollout = downloading()
    (robot,) = robot_deployments(rollout.rollout, JOB, rollout.now_s)
    assert robot.deploymentStartTime is not None
    assert (robot.deploymentStartTime.timestamp(), robot.deploymentFinishTime) == (1000.0, None)

    rollout.succeed(f"{NAME}0")
    (robot,) = robot_deployments(rollout.rollout, JOB, rollout.now_s)
    assert robot.deploymentFinishTime is not None
    assert robot.deploymentFinishTime.timestamp() == 1010.0
    assert robot.progressDetail is not None
    assert robot.progressDetail.currentProgress == "Finished"


def test_describe_says_of_robots_that_left_why_they_have_nothing() -> None:
    rollout = SmallRollout(3, name=NAME)
    rollout.happen(RobotGone(robot=f"{NAME}0", how="left"), RobotGone(robot=f"{NAME}1", how="deleted"))
    left, deleted, stays = robot_deployments(rollout.rollout, JOB, rollout.now_s)

    assert left.to_wire() == {
        "arn": f"{NAME}0",
        "status": "Available",
        "failureReason": "the robot left the fleet",
        "failureCode": "RobotDeploymentAborted",
    }
    assert (deleted.status, deleted.failureReason) == (None, "the robot was deleted")
    assert stays.to_wire() == {"arn": f"{NAME}2", "status": "PendingNewDeployment"}


def test_a_reason_is_cut_to_what_the_interface_holds() -> None:
    rollout = SmallRollout(1, name=NAME)
    rollout.offer()
    long = "begin " + "x" * 2000 + " end"
    rollout.happen(Failed(robot=f"{NAME}0", action_id=1, code="PreLaunchFileFailure", reason=long))
    (robot,) = robot_deployments(rollout.rollout, JOB, rollout.now_s)

    assert robot.failureReason is not None
    assert len(robot.failureReason) <= 1024
    assert robot.failureReason.startswith("begin")
    assert robot.failureReason.endswith("end")
