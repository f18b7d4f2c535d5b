"""Deployments that people control: canaries, approval, pause, maintenance windows, in simulated time."""

from datetime import timedelta
from typing import Any

import pytest
from helpers.deployed_robots import Yard, bad, deployable, good, silent, slow

from prefect_robomaker.schemas.wire.errors import InvalidParameterException
from prefect_robomaker.tasks.fleet.control.deployment_decisions import approve, pause, reject, resume
from prefect_robomaker.tasks.fleet.control.rollbacks import EndedRollouts
from prefect_robomaker.tasks.fleet.kept_rollouts import open_rollouts
from prefect_robomaker.tasks.service.service import Service

ALL = {"concurrentDeploymentPercentage": 100, "failureThresholdPercentage": 100}


@pytest.fixture
def yard(service: Service) -> Yard:
    return Yard(service)


def deployed(yard: Yard, token: str = "once", **config: Any) -> str:
    found = yard.fleets.service.catalog.find("robot-application", "mine")
    application = deployable(yard.fleets, "X86_64", "ARM64") if found is None else found.arn
    return yard.fleets.deploy(yard.arn, application, token, deploymentConfig={**ALL, **config})["arn"]


def causes(yard: Yard, job: str) -> list[str]:
    return [wait["cause"] for wait in yard.fleets.described(job).get("waitsFor", [])]


def test_a_canary_that_fails_keeps_the_others_from_an_order(yard: Yard) -> None:
    yard.robot("r0", good)
    canary = yard.robot("r1", bad)
    yard.robot("r2", good)

    job = yard.run(deployed(yard, canaryRobots=["r1"]))

    assert (job["status"], job["failureCode"]) == ("Failed", "FailureThresholdBreached")
    assert "1 of 1 canaries failed" in job["failureReason"]
    assert yard.offered == [canary]
    assert yard.statuses() == {"r0": "Registered", "r1": "Failed", "r2": "Registered"}


def test_canaries_go_first_by_name_by_arn_or_as_a_share(yard: Yard) -> None:
    robots = [yard.robot(f"r{number}", good) for number in range(4)]

    assert yard.run(deployed(yard, canaryRobots=["r3", robots[1]]))["status"] == "Succeeded"
    assert set(yard.offered[:2]) == {robots[1], robots[3]}
    assert yard.offered[2:] == [robots[0], robots[2]]

    yard.offered.clear()
    yard.at_look[yard.looks + 2] = lambda: seen.extend(yard.offered)
    seen: list[str] = []
    assert yard.run(deployed(yard, "share", canaryPercentage=50))["status"] == "Succeeded"
    assert seen == robots[:2]


def test_canaries_have_to_be_in_the_fleet_and_said_once(yard: Yard) -> None:
    yard.robot("r0", good)
    with pytest.raises(InvalidParameterException, match=r"canaryRobots\[1\]: r9 is not a robot of"):
        deployed(yard, canaryRobots=["r0", "r9"])
    with pytest.raises(InvalidParameterException, match="canaryRobots and canaryPercentage say the same"):
        deployed(yard, canaryRobots=["r0"], canaryPercentage=10)
    with pytest.raises(InvalidParameterException, match="'r0' is there twice"):
        deployed(yard, canaryRobots=["r0", "r0"])


def test_a_deployment_waits_for_approval_after_its_canaries(yard: Yard) -> None:
    canary, other = yard.robot("r0", good), yard.robot("r1", good)
    arn = deployed(yard, canaryRobots=["r0"], requiresApproval=True)
    said: list[str] = []

    def too_early() -> None:
        with pytest.raises(InvalidParameterException, match="1 of its canaries have not ended") as error:
            approve(arn, "ada", yard.service)
        said.append(str(error.value))

    yard.at_look[2] = too_early
    yard.at_look[30] = lambda: said.extend([*causes(yard, arn), *yard.offered])
    yard.at_look[31] = lambda: approve(arn, "ada", yard.service)

    job = yard.run(arn)

    assert said[1:] == ["APPROVAL", canary]
    assert job["status"] == "Succeeded"
    assert yard.offered == [canary, other]
    assert "waitsFor" not in job
    with pytest.raises(InvalidParameterException, match="has ended: it is Succeeded"):
        approve(arn, "ada", yard.service)


def test_without_canaries_no_robot_begins_before_the_approval_and_a_no_cancels(yard: Yard) -> None:
    yard.robot("r0", good)
    arn = deployed(yard, requiresApproval=True)
    yard.at_look[10] = lambda: reject(arn, "ada", yard.service)

    job = yard.run(arn)

    assert (job["status"], job["failureReason"]) == ("Canceled", "the deployment was not approved, says ada")
    assert yard.offered == []
    assert yard.statuses() == {"r0": "Registered"}


def test_what_does_not_wait_for_approval_cannot_be_approved(yard: Yard) -> None:
    yard.robot("r0", slow)
    arn = deployed(yard)
    with pytest.raises(InvalidParameterException, match="it has not begun"):
        approve(arn, "ada", yard.service)
    refused: list[bool] = []

    def refuse() -> None:
        with pytest.raises(InvalidParameterException, match="has no requiresApproval"):
            approve(arn, "ada", yard.service)
        refused.append(True)
        yard.fleets.cancel(arn)

    yard.at_look[3] = refuse
    yard.run(arn)
    assert refused


def test_a_pause_holds_robots_that_have_not_begun_and_the_others_go_on(yard: Yard) -> None:
    robots = [yard.robot(f"r{number}", good) for number in range(3)]
    arn = deployed(yard, concurrentDeploymentPercentage=34)
    seen: list[Any] = []
    yard.at_look[3] = lambda: pause(arn, "ada", yard.service)
    yard.at_look[60] = lambda: seen.append((causes(yard, arn), yard.statuses(), list(yard.offered)))
    yard.at_look[61] = lambda: resume(arn, yard.service)

    job = yard.run(arn)

    ((waits, statuses, offered),) = seen
    assert waits == ["PAUSED"]
    assert statuses == {"r0": "InSync", "r1": "PendingNewDeployment", "r2": "PendingNewDeployment"}
    assert offered == robots[:1]
    assert job["status"] == "Succeeded"
    assert yard.offered == robots


def test_a_deployment_may_be_paused_before_it_begins_and_after_its_run_died(yard: Yard) -> None:
    yard.robot("r0", good)
    arn = deployed(yard)
    pause(arn, "ada", yard.service)
    (wait,) = yard.fleets.described(arn)["waitsFor"]
    assert (wait["cause"], wait["by"]) == ("PAUSED", "ada")

    class Killed(BaseException):
        pass

    def kill() -> None:
        raise Killed

    yard.at_look[5] = kill
    with pytest.raises(Killed):
        yard.run(arn)
    assert causes(yard, arn) == ["PAUSED"]
    assert yard.offered == []
    resume(arn, yard.service)

    assert yard.run(arn)["status"] == "Succeeded"


def test_the_time_of_an_order_that_is_held_back_stands_still(yard: Yard) -> None:
    away = yard.robot("r0", silent)
    arn = deployed(yard, robotDeploymentTimeoutInSeconds=60)
    yard.at_look[8] = lambda: pause(arn, "ada", yard.service)
    yard.at_look[50] = lambda: resume(arn, yard.service)
    yard.at_look[51] = lambda: yard.behaviours.update({away: good})

    assert yard.run(arn, yard.stride)["status"] == "Succeeded"


def test_outside_its_windows_no_robot_begins(yard: Yard) -> None:
    """It is 03:04:05; the windows are from 03:10 to 03:12, and from 03:30 to 03:32."""
    yard.robot("r0", good)
    late = yard.robot("r1", silent)
    yard.robot("r2", good)
    windows = [{"startTime": start, "durationInSeconds": 120} for start in ("03:10", "03:30")]
    arn = deployed(yard, maintenanceWindows=windows, concurrentDeploymentPercentage=67)
    begun: dict[str, str] = {}
    seen: list[Any] = []

    def sleep(_: float) -> None:
        is_open = yard.now.minute in (10, 11, 30, 31)
        yard.sleep(5.0 if is_open else 20.0)
        for robot in yard.offered:
            begun.setdefault(robot.split("/")[1], f"{yard.now:%H:%M}")
        if f"{yard.now:%H:%M}" == "03:20":  # its order is held back now
            yard.behaviours[late] = good

    yard.at_look[5] = lambda: seen.append(yard.fleets.described(arn)["waitsFor"])

    job = yard.run(arn, sleep)

    ((wait,),) = seen
    assert (wait["cause"], f"{wait['until']:%H:%M}") == ("MAINTENANCE_WINDOW", "03:10")
    assert job["status"] == "Succeeded"
    assert begun == {"r0": "03:10", "r2": "03:10", "r1": "03:30"}


def test_an_order_that_a_robot_got_after_the_end_of_the_job_times_out(yard: Yard) -> None:
    yard.robot("r0", good)
    away = yard.robot("r1", silent)
    job = yard.run(deployed(yard, robotDeploymentTimeoutInSeconds=300), yard.stride)
    yard.behaviours[away] = slow
    for _ in range(3):
        yard.act()  # it answers the cancellation, and gets another order
    assert yard.statuses()["r1"] == "Deploying"

    tending = EndedRollouts(yard.service)
    for _ in range(17):
        yard.now += timedelta(seconds=20)
        tending.tend(open_rollouts(yard.service))

    shown = yard.fleets.described(job["arn"])["robotDeploymentSummary"][1]
    assert (shown["status"], shown["failureCode"]) == ("Failed", "RobotAgentConnectionTimeout")
    assert yard.fleets.described(job["arn"])["status"] == "Succeeded"
