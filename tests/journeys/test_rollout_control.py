"""People control deployments to robots that poll `robomaker serve` over HTTP: from another process than the job's."""

import os
import secrets
import signal
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from helpers.deployed_robots import deployable
from helpers.endpoint_process import Serve, Served
from helpers.fleet_calls import Fleets
from helpers.living_robots import Behaviour, LivingRobot, living
from helpers.polling_robot import PollingRobot
from helpers.processes import wait_for
from prefect.client.orchestration import get_client
from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterState, FlowRunFilterStateName

from prefect_robomaker.schemas.documents.fleets import RobotDocument
from prefect_robomaker.tasks.fleet.control.decisions import approve, pause, resume
from prefect_robomaker.tasks.fleet.control.rollbacks import TAG
from prefect_robomaker.tasks.fleet.known_robots import enrol
from prefect_robomaker.tasks.service.service import Service

MakeFleet = Callable[..., tuple[str, list[LivingRobot]]]
PATIENCE_S = 180.0


@pytest.fixture
def fleets(service: Service) -> Fleets:
    return Fleets(service)


@pytest.fixture
def make_fleet(fleets: Fleets, service: Service) -> MakeFleet:
    """Makes a fleet of robots that are enrolled, behind a server."""

    def make(served: Served, *behaviours: Behaviour) -> tuple[str, list[LivingRobot]]:
        fleet, robots = fleets.fleet(), []
        for number, behaviour in enumerate(behaviours):
            fleets.robot(f"r{number}", fleet)
            token = enrol(f"r{number}", service, secrets.token_bytes, rotate=False)
            robots.append(LivingRobot(PollingRobot(served.url, f"r{number}", token), behaviour))
        return fleet, robots

    return make


def described(served: Served, job: str) -> dict[str, Any]:
    return served.call("DescribeDeploymentJob", {"job": job})


def ended(served: Served, job: str) -> dict[str, Any]:
    """The job's description once it has ended."""
    statuses = ("Succeeded", "Failed", "Canceled")
    wait_for(lambda: described(served, job)["status"] in statuses, f"the end; {served.log.read_text()}", PATIENCE_S)
    return described(served, job)


def waits(served: Served, job: str) -> list[str]:
    return [wait["cause"] for wait in described(served, job).get("waitsFor", [])]


def shown_in_prefect(state: str) -> int:
    """How many flow runs have a state of that name."""
    chosen = FlowRunFilter(state=FlowRunFilterState(name=FlowRunFilterStateName(any_=[state])))
    with get_client(sync_client=True) as client:
        return len(client.read_flow_runs(flow_run_filter=chosen))


@pytest.mark.deep
def test_canaries_go_first_and_the_others_wait_for_a_person(
    serve: Serve, fleets: Fleets, make_fleet: MakeFleet, service: Service, prefect_server: str
) -> None:
    with serve(PREFECT_API_URL=prefect_server) as served:
        fleet, robots = make_fleet(served, "good", "bad", "good")
        config = {"concurrentDeploymentPercentage": 100, "canaryRobots": ["r1"], "requiresApproval": True}
        order = fleets.order(fleet, deployable(fleets, "X86_64"), deploymentConfig=config)
        with living(robots):
            job = ended(served, served.call("CreateDeploymentJob", order)["arn"])
            assert (job["status"], job["failureCode"]) == ("Failed", "FailureThresholdBreached")
            assert [len(robot.started) for robot in robots] == [0, 1, 0], "only the canary"

            robots[1].behaviour = "good"
            again = served.call("CreateDeploymentJob", {**order, "clientRequestToken": "again"})["arn"]
            wait_for(lambda: waits(served, again) == ["APPROVAL"], "the question", PATIENCE_S)
            wait_for(lambda: shown_in_prefect("AwaitingApproval") == 1, "the state in Prefect", PATIENCE_S)
            assert [len(robot.started) for robot in robots] == [0, 2, 0]

            approve(again, "ada", service)

            assert ended(served, again)["status"] == "Succeeded"
            assert [len(robot.started) for robot in robots] == [1, 2, 1]
            wait_for(lambda: shown_in_prefect("AwaitingApproval") == 0, "the end in Prefect", PATIENCE_S)


@pytest.mark.deep
def test_a_pause_outlives_worker_and_server(
    serve: Serve, fleets: Fleets, make_fleet: MakeFleet, service: Service, prefect_server: str
) -> None:
    with serve(PREFECT_API_URL=prefect_server) as served:
        fleet, robots = make_fleet(served, "stays", "good", "good")
        config = {"concurrentDeploymentPercentage": 1}
        order = fleets.order(fleet, deployable(fleets, "X86_64"), deploymentConfig=config)
        with living(robots):
            arn = served.call("CreateDeploymentJob", order)["arn"]
            wait_for(lambda: robots[0].started, "the first robot's download", PATIENCE_S)
            pause(arn, "ada", service)
            os.kill(served.wait_until_ready(), signal.SIGKILL)
            robots[0].behaviour = "good"
            finished = lambda: described(served, arn)["robotDeploymentSummary"][0]["status"] == "InSync"  # noqa: E731
            wait_for(finished, "the robot that had begun, by another worker", PATIENCE_S)
            os.killpg(served.process.pid, signal.SIGKILL)
            served.process.wait()

            with serve(PREFECT_API_URL=prefect_server) as another:
                for robot in robots:
                    robot.client = replace(robot.client, url=another.url)
                another.wait_until_ready()
                assert waits(another, arn) == ["PAUSED"]
                assert [len(robot.started) for robot in robots] == [1, 0, 0]

                resume(arn, service)

                assert ended(another, arn)["status"] == "Succeeded"
        assert [len(robot.started) for robot in robots] == [1, 1, 1]


@pytest.mark.deep
def test_robots_get_the_earlier_version_when_too_many_fail(
    serve: Serve, fleets: Fleets, make_fleet: MakeFleet, service: Service, prefect_server: str
) -> None:
    def version(name: str) -> str | None:
        robot = service.catalog.find("robot", name)
        assert robot is not None
        return RobotDocument.of(robot).installed_version

    with serve(PREFECT_API_URL=prefect_server) as served:
        fleet, robots = make_fleet(served, "good", "good")
        application = deployable(fleets, "X86_64")
        config = {"concurrentDeploymentPercentage": 50, "failureThresholdPercentage": 50}
        order = fleets.order(fleet, application, deploymentConfig=config)
        with living(robots):
            assert ended(served, served.call("CreateDeploymentJob", order)["arn"])["status"] == "Succeeded"
            sources = [{"s3Bucket": "apps", "s3Key": "X86_64.tar.gz", "architecture": "X86_64"}]
            suite = {"name": "General"}
            fleets.call("UpdateRobotApplication", application=application, sources=sources, robotSoftwareSuite=suite)
            fleets.call("CreateRobotApplicationVersion", application=application)
            robots[1].behaviour = "bad"
            second = fleets.order(
                fleet,
                application,
                "second",
                deploymentConfig={**config, "onThresholdBreached": "ROLLBACK"},
                config={"applicationVersion": "2"},
            )

            failed = ended(served, served.call("CreateDeploymentJob", second)["arn"])

            assert failed["failureCode"] == "FailureThresholdBreached"
            made = lambda: described(served, failed["arn"]).get("rollback", {}).get("jobs", [])  # noqa: E731
            wait_for(made, "the job that brings robots back", PATIENCE_S)
            (back,) = made()
            job = ended(served, back)
            assert (job["status"], job["tags"]) == ("Succeeded", {TAG: failed["arn"]})
            assert [robot["arn"].split("/")[1] for robot in job["robotDeploymentSummary"]] == ["r0"]
            wait_for(lambda: version("r0") == "1", "what the robot has", PATIENCE_S)
            assert len(robots[0].started) == 3
