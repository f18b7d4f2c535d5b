"""Deployment jobs: asked for, described, listed, repeated and cancelled, before any has begun."""

from typing import Any

import pytest
from helpers.application_calls import BUCKET, Applications, at_once
from helpers.fleet_calls import LAUNCH, Fleets

from prefect_robomaker.schemas.wire.errors import (
    ConcurrentDeploymentException,
    IdempotentParameterMismatchException,
    InvalidParameterException,
    ResourceNotFoundException,
)
from prefect_robomaker.tasks.service.service import Service

PREFIX = "arn:aws:robomaker:us-east-1:000000000000"
FIVE_HOURS_S = 18000


@pytest.fixture
def fleets(service: Service) -> Fleets:
    return Fleets(service)


@pytest.fixture
def yard(fleets: Fleets) -> str:
    """ARN of a fleet with the robot rover."""
    arn = fleets.fleet("yard")
    fleets.robot("rover", arn)
    return arn


@pytest.fixture
def application(fleets: Fleets) -> str:
    """ARN of a robot application of one version."""
    return fleets.application()


def jobs(fleets: Fleets, **members: Any) -> list[str]:
    return [job["arn"] for job in fleets.call("ListDeploymentJobs", **members)["deploymentJobs"]]


def statuses(fleets: Fleets, fleet: str) -> dict[str, str]:
    return {robot["name"]: robot["status"] for robot in fleets.described(fleet)["robots"]}


# Ordering and describing


def test_what_was_ordered_is_answered_described_and_listed(fleets: Fleets, yard: str, application: str) -> None:
    launch = {
        **LAUNCH,
        "preLaunchFile": "before.sh",
        "postLaunchFile": "after.sh",
        "environmentVariables": {"SPEED": "2"},
    }
    config = {"concurrentDeploymentPercentage": 20, "failureThresholdPercentage": 100}

    job = fleets.deploy(
        yard, application, config={"launchConfig": launch}, deploymentConfig=config, tags={"night": "1"}
    )

    assert job["arn"].startswith(f"{PREFIX}:deployment-job/deployment-")
    assert job == {
        "arn": job["arn"],
        "fleet": yard,
        "status": "Pending",
        "deploymentApplicationConfigs": [
            {"application": application, "applicationVersion": "1", "launchConfig": launch}
        ],
        "deploymentConfig": {**config, "robotDeploymentTimeoutInSeconds": FIVE_HOURS_S},
        "createdAt": job["createdAt"],
        "tags": {"night": "1"},
    }
    robots = [{"arn": fleets.described(yard)["robots"][0]["arn"], "status": "PendingNewDeployment"}]
    assert fleets.described(job["arn"]) == {**job, "robotDeploymentSummary": robots}
    del job["tags"]
    assert fleets.call("ListDeploymentJobs") == {"deploymentJobs": [job]}


def test_the_robots_wait_for_a_deployment_until_it_is_cancelled(fleets: Fleets, yard: str, application: str) -> None:
    job = fleets.deploy(yard, application)
    late = fleets.robot("late", yard)
    bystander = fleets.robot("bystander", fleets.fleet("hall"))

    assert statuses(fleets, yard) == {"rover": "PendingNewDeployment", "late": "PendingNewDeployment"}
    meant = fleets.described(late)
    assert (meant["lastDeploymentJob"], meant["lastDeploymentTime"]) == (job["arn"], job["createdAt"])
    assert fleets.described(bystander)["status"] == "Registered"
    waiting = fleets.call("ListRobots", filters=[{"name": "status", "values": ["PendingNewDeployment"]}])["robots"]
    assert {robot["name"] for robot in waiting} == {"rover", "late"}
    assert len(fleets.described(job["arn"])["robotDeploymentSummary"]) == 2

    fleets.cancel(job["arn"])
    fleets.cancel(job["arn"])  # it has ended

    ended = fleets.described(job["arn"])
    assert (ended["status"], ended["robotDeploymentSummary"]) == ("Canceled", [])
    assert "failureCode" not in ended
    assert statuses(fleets, yard) == {"rover": "Registered", "late": "Registered"}
    assert fleets.described(late)["lastDeploymentJob"] == job["arn"]
    later = fleets.robot("later", yard)
    assert "lastDeploymentJob" not in fleets.described(later)


def test_robots_that_leave_are_not_deployed_to(fleets: Fleets, yard: str, application: str) -> None:
    crane, truck = fleets.robot("crane", yard), fleets.robot("truck", yard)
    job = fleets.deploy(yard, application)["arn"]

    fleets.deregister(yard, crane)
    fleets.call("DeleteRobot", robot=truck)

    (left,) = fleets.described(job)["robotDeploymentSummary"]
    assert ":robot/rover/" in left["arn"]
    assert fleets.described(crane)["status"] == "Available"


# One at a time


def test_a_fleet_has_one_deployment_at_a_time(fleets: Fleets, yard: str, application: str) -> None:
    hall = fleets.fleet("hall")
    fleets.robot("crane", hall)
    job = fleets.deploy(yard, application, "first")["arn"]

    with pytest.raises(ConcurrentDeploymentException, match=f"{job}, which is Pending; cancel it"):
        fleets.deploy(yard, application, "second")
    with pytest.raises(ConcurrentDeploymentException):
        fleets.call("SyncDeploymentJob", fleet=yard, clientRequestToken="third")
    fleets.deploy(hall, application, "other-fleet")
    fleets.cancel(job)
    assert fleets.deploy(yard, application, "second")["arn"] in jobs(fleets)
    assert len(jobs(fleets)) == 3


def test_of_many_orders_at_once_one_is_taken(fleets: Fleets, yard: str, application: str) -> None:
    tokens = [f"token-{number}" for number in range(6)]

    answers = at_once([lambda token=token: fleets.deploy(yard, application, token) for token in tokens])

    taken = [answer["arn"] for answer in answers if isinstance(answer, dict)]
    assert taken == jobs(fleets)
    assert len(taken) == 1
    assert sum(isinstance(answer, ConcurrentDeploymentException) for answer in answers) == 5


def test_one_order_sent_many_times_at_once_is_one_deployment(fleets: Fleets, yard: str, application: str) -> None:
    answers = at_once([lambda: fleets.deploy(yard, application)] * 6)

    assert all(answer == answers[0] for answer in answers)
    assert jobs(fleets) == [answers[0]["arn"]]


# Tokens


def test_an_order_is_repeated_with_its_token_whatever_has_changed(fleets: Fleets, yard: str, application: str) -> None:
    job = fleets.deploy(yard, application)
    fleets.call("DeleteFleet", fleet=yard)
    fleets.call("DeleteRobotApplication", application=application)

    again = fleets.deploy(yard, application)

    assert again["arn"] == job["arn"]
    assert again["status"] == "Failed"
    with pytest.raises(IdempotentParameterMismatchException, match="once"):
        fleets.deploy(yard, application, tags={"other": "1"})


@pytest.mark.parametrize("operation", ["CreateDeploymentJob", "SyncDeploymentJob"])
def test_the_token_has_to_be_given(fleets: Fleets, yard: str, application: str, operation: str) -> None:
    request = fleets.order(yard, application)
    if operation == "SyncDeploymentJob":
        del request["deploymentApplicationConfigs"]
    del request["clientRequestToken"]

    with pytest.raises(InvalidParameterException, match="clientRequestToken"):
        fleets.call(operation, **request)


# What is refused


@pytest.mark.parametrize(
    ("config", "says"),
    [
        ({"applicationVersion": "$LATEST"}, "applicationVersion"),
        ({"applicationVersion": None}, "applicationVersion"),
        ({"application": "mine"}, "application"),
        ({"launchConfig": {"packageName": "p"}}, "launchFile"),
        ({"launchConfig": {"launchFile": "l"}}, "packageName"),
        ({"launchConfig": {**LAUNCH, "environmentVariables": {"AWS_X": "1"}}}, "reserved"),
        ({"launchConfig": {**LAUNCH, "command": ["true"]}}, "command"),
        ({"application": f"{PREFIX}:simulation-application/mine/1"}, "has to name a robot-application"),
        ({"application": "arn:mine"}, "has to look like"),
    ],
)
def test_an_application_that_cannot_be_deployed_is_refused(
    fleets: Fleets, yard: str, application: str, config: dict[str, Any], says: str
) -> None:
    with pytest.raises(InvalidParameterException, match=says):
        fleets.deploy(yard, application, config=config)
    assert jobs(fleets) == []
    assert statuses(fleets, yard) == {"rover": "Registered"}


@pytest.mark.parametrize("config", [{"applicationVersion": "2"}, {"application": f"{PREFIX}:robot-application/none/1"}])
def test_an_application_or_version_that_does_not_exist_is_not_found(
    fleets: Fleets, yard: str, application: str, config: dict[str, Any]
) -> None:
    with pytest.raises(ResourceNotFoundException):
        fleets.deploy(yard, application, config=config)


def test_one_application_is_deployed_at_a_time(fleets: Fleets, yard: str, application: str) -> None:
    order = fleets.order(yard, application)
    for configs in ([], order["deploymentApplicationConfigs"] * 2):
        with pytest.raises(InvalidParameterException, match="deploymentApplicationConfigs"):
            fleets.call("CreateDeploymentJob", **{**order, "deploymentApplicationConfigs": configs})


@pytest.mark.parametrize(
    ("member", "least", "most"),
    [
        ("concurrentDeploymentPercentage", 1, 100),
        ("failureThresholdPercentage", 1, 100),
        ("robotDeploymentTimeoutInSeconds", 60, 7 * 24 * 3600),
    ],
)
def test_numbers_of_the_configuration_have_bounds(
    fleets: Fleets, yard: str, application: str, member: str, least: int, most: int
) -> None:
    for wrong in (least - 1, most + 1):
        with pytest.raises(InvalidParameterException, match=member):
            fleets.deploy(yard, application, deploymentConfig={member: wrong})
    for right in (least, most):
        job = fleets.deploy(yard, application, f"token-{right}", deploymentConfig={member: right})
        assert job["deploymentConfig"][member] == right
        fleets.cancel(job["arn"])


def test_a_fleet_that_is_empty_gone_or_none_is_refused(fleets: Fleets, yard: str, application: str) -> None:
    with pytest.raises(InvalidParameterException, match="has no robots; register some first"):
        fleets.deploy(fleets.fleet("empty"), application)
    fleets.call("DeleteFleet", fleet=yard)
    with pytest.raises(ResourceNotFoundException, match="yard"):
        fleets.deploy(yard, application)
    with pytest.raises(InvalidParameterException, match="has to name a deployment-fleet"):
        fleets.deploy(application, application)


def test_at_least_one_robot_has_to_be_able_to_run_the_application(fleets: Fleets, yard: str) -> None:
    [source] = Applications.of("Robot", fleets.service).stored("mine.tar")
    for_arm = fleets.application("arm", sources=[{**source, "architecture": "ARM64"}])
    for_all = fleets.application("all", sources=[source])

    with pytest.raises(InvalidParameterException, match=r"has sources for ARM64, the robots of .* are X86_64"):
        fleets.deploy(yard, for_arm)
    fleets.cancel(fleets.deploy(yard, for_all, "anything")["arn"])
    fleets.robot("small", yard, architecture="ARM64")
    assert fleets.deploy(yard, for_arm)["status"] == "Pending"


# The condition file


def test_a_condition_that_no_robot_is_asked_is_refused_and_not_ignored(
    fleets: Fleets, yard: str, application: str
) -> None:
    file = {"bucket": BUCKET, "key": "may.sh"}
    fleets.service.store.ensure_bucket(BUCKET)
    fleets.service.store.put_bytes(BUCKET, "may.sh", b"exit 0")

    with pytest.raises(InvalidParameterException, match=r"downloadConditionFile: only agents ask it, and no robot of"):
        fleets.deploy(yard, application, deploymentConfig={"downloadConditionFile": file})

    job = fleets.deploy(yard, application)
    fleets.cancel(job["arn"])
    fleets.give_condition(job["arn"], file)
    with pytest.raises(InvalidParameterException, match=r"downloadConditionFile: only agents ask it, and no robot of"):
        fleets.call("SyncDeploymentJob", fleet=yard, clientRequestToken="again")


def test_the_etag_of_a_condition_is_that_of_the_moment(fleets: Fleets, yard: str, application: str) -> None:
    fleets.let_agents_in(yard)
    file = {"bucket": BUCKET, "key": "may.sh"}
    fleets.service.store.ensure_bucket(BUCKET)
    with pytest.raises(InvalidParameterException, match=r"downloadConditionFile: s3://\S+/may.sh cannot be read"):
        fleets.deploy(yard, application, deploymentConfig={"downloadConditionFile": file})
    etag = fleets.service.store.put_bytes(BUCKET, "may.sh", b"exit 0").etag
    with pytest.raises(InvalidParameterException, match=r"downloadConditionFile.etag: other is not that of s3://"):
        fleets.deploy(yard, application, deploymentConfig={"downloadConditionFile": {**file, "etag": "other"}})

    job = fleets.deploy(yard, application, deploymentConfig={"downloadConditionFile": file})

    assert job["deploymentConfig"]["downloadConditionFile"] == {**file, "etag": etag}


# Repeating the latest


def test_the_latest_deployment_is_repeated(fleets: Fleets, yard: str, application: str) -> None:
    other = fleets.application("other")
    for token, deployed in (("first", other), ("second", application)):
        fleets.cancel(
            fleets.deploy(yard, deployed, token, deploymentConfig={"concurrentDeploymentPercentage": 7})["arn"]
        )

    request = {"fleet": yard, "clientRequestToken": "sync"}
    synced = fleets.call("SyncDeploymentJob", **request)

    assert synced["status"] == "Pending"
    assert synced["deploymentApplicationConfigs"] == fleets.order(yard, application)["deploymentApplicationConfigs"]
    assert synced["deploymentConfig"]["concurrentDeploymentPercentage"] == 7
    assert "tags" not in synced
    assert fleets.call("SyncDeploymentJob", **request) == synced
    assert statuses(fleets, yard) == {"rover": "PendingNewDeployment"}
    assert len(jobs(fleets)) == 3


def test_what_cannot_be_repeated_is_refused(fleets: Fleets, yard: str, application: str) -> None:
    def sync() -> None:
        fleets.call("SyncDeploymentJob", fleet=yard, clientRequestToken="sync")

    with pytest.raises(InvalidParameterException, match="has had no deployment"):
        sync()
    fleets.cancel(fleets.deploy(yard, application)["arn"])
    fleets.call("DeleteRobotApplication", application=application)
    with pytest.raises(ResourceNotFoundException, match="robot-application"):
        sync()
    fleets.call("DeleteFleet", fleet=yard)
    with pytest.raises(ResourceNotFoundException, match="yard"):
        sync()


# Lists


def test_lists_have_pages_and_find_deployments_by_status_and_fleet(fleets: Fleets, yard: str, application: str) -> None:
    hall = fleets.fleet("hall")
    fleets.robot("crane", hall)
    made = []
    for number in range(3):
        made.append(fleets.deploy(yard, application, f"token-{number}")["arn"])
        fleets.cancel(made[-1])
    made.append(fleets.deploy(hall, application, "hall")["arn"])

    def found(name: str, value: str) -> list[str]:
        return jobs(fleets, filters=[{"name": name, "values": [value]}])

    assert found("status", "Pending") == [made[3]]
    assert found("status", "Canceled") == made[2::-1]
    assert found("fleetName", "hall") == [made[3]]
    assert found("fleetName", "yard") == made[2::-1]
    assert found("fleetName", "none") == []
    first = fleets.call("ListDeploymentJobs", maxResults=3)
    assert [job["arn"] for job in first["deploymentJobs"]] == made[:0:-1]
    assert jobs(fleets, nextToken=first["nextToken"]) == made[:1]
    with pytest.raises(InvalidParameterException, match="known are fleetName, status"):
        found("name", "yard")
    with pytest.raises(InvalidParameterException, match="maxResults"):
        jobs(fleets, maxResults=201)


@pytest.mark.parametrize("operation", ["DescribeDeploymentJob", "CancelDeploymentJob"])
def test_a_job_that_is_not_there_is_not_found(fleets: Fleets, operation: str) -> None:
    with pytest.raises(ResourceNotFoundException, match="deployment-000000000000"):
        fleets.call(operation, job=f"{PREFIX}:deployment-job/deployment-000000000000")
    with pytest.raises(InvalidParameterException, match="has to name a deployment-job"):
        fleets.call(operation, job=f"{PREFIX}:simulation-job/sim-000000000000")
