"""Rollouts in the catalog: what robots report after the end of a deployment."""

from typing import Any

import pytest
from helpers.deployed_robots import Yard, deployable, good, silent, slow

from prefect_robomaker.schemas.fleet.rollouts.rollout import Failed, Progressed
from prefect_robomaker.tasks.fleet.catalog_rollouts import Rollouts
from prefect_robomaker.tasks.fleet.kept_rollouts import open_rollouts, served_rollouts
from prefect_robomaker.tasks.service.service import Service


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The jobs whose rollouts were read."""
    found: list[str] = []
    read = Rollouts.rollout

    def noted(self: Rollouts, job: str) -> Any:
        found.append(job)
        return read(self, job)

    monkeypatch.setattr(Rollouts, "rollout", noted)
    return found


def test_reports_after_the_end_are_taken_in_together(service: Service, reads: list[str]) -> None:
    yard = Yard(service)
    late = [yard.robot(f"r{number}", slow) for number in range(3)]
    yard.robot("bad", good)
    config = {"concurrentDeploymentPercentage": 75, "failureThresholdPercentage": 1}
    job = yard.fleets.deploy(yard.arn, deployable(yard.fleets, "X86_64"), deploymentConfig=config)["arn"]
    numbers: dict[str, int] = {}

    def fail_one() -> None:
        (each,) = open_rollouts(yard.service)
        numbers.update({robot: each.rollout.robots[robot].action_id or 0 for robot in late})
        yard.say(job, Failed(robot=late[0], action_id=numbers[late[0]], code="PreLaunchFileFailure"))

    yard.at_look[3] = fail_one
    assert yard.run(job)["failureCode"] == "FailureThresholdBreached"

    reads.clear()
    for robot in late[1:]:
        for step in ("Launching", "ExecutingPostLaunch"):
            yard.say(job, Progressed(robot=robot, action_id=numbers[robot], step=step))
        yard.say(job, Failed(robot=robot, action_id=numbers[robot], code="PostLaunchFileFailure"))
    assert reads == [], "a report is only stored"

    assert served_rollouts(yard.service) == []
    assert reads.count(job) <= 2
    assert yard.statuses()["r2"] == "Failed"
    assert Rollouts(yard.service.catalog).jobs_with_events() == []
    reads.clear()
    served_rollouts(yard.service)
    assert reads == []


def test_a_robot_that_leaves_after_the_end_is_not_waited_for(service: Service) -> None:
    yard = Yard(service)
    away = yard.robot("r0", silent)
    yard.robot("r1", good)
    config = {"failureThresholdPercentage": 100, "robotDeploymentTimeoutInSeconds": 60}
    job = yard.fleets.deploy(yard.arn, deployable(yard.fleets, "X86_64"), deploymentConfig=config)["arn"]
    yard.run(job, yard.stride)
    assert open_rollouts(yard.service) != []

    yard.fleets.call("DeleteRobot", robot=away)

    assert open_rollouts(yard.service) == []
