"""A pause of a deployment to robots that poll `robomaker serve` over HTTP: another process sets it than the job's."""

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

from prefect_robomaker.tasks.fleet.control.deployment_decisions import pause, resume
from prefect_robomaker.tasks.fleet.fleet_records import enrol
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


def summary(job: dict[str, Any]) -> dict[str, tuple[str, str | None]]:
    return {
        robot["arn"].split("/")[1]: (robot["status"], robot.get("failureCode"))
        for robot in job["robotDeploymentSummary"]
    }


def waits(served: Served, job: str) -> list[str]:
    return [wait["cause"] for wait in described(served, job).get("waitsFor", [])]


@pytest.mark.endurance  # tests/tasks/fleet: control/test_controlled_runs.py pauses what died, runs/ goes on with it
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


@pytest.mark.endurance
def test_a_deployment_goes_on_when_its_worker_and_its_server_are_killed(
    serve: Serve, fleets: Fleets, make_fleet: MakeFleet, prefect_server: str
) -> None:
    with serve(PREFECT_API_URL=prefect_server) as served:
        fleet, robots = make_fleet(served, "stays", "good", "good")
        order = fleets.order(
            fleet, deployable(fleets, "X86_64"), deploymentConfig={"concurrentDeploymentPercentage": 1}
        )
        with living(robots):
            arn = served.call("CreateDeploymentJob", order)["arn"]
            wait_for(lambda: robots[0].started, "the robot's download")
            os.kill(served.wait_until_ready(), signal.SIGKILL)
            robots[0].behaviour = "good"
            wait_for(lambda: robots[1].started, "the next robot's order, by another worker", 180.0)
            os.killpg(served.process.pid, signal.SIGKILL)
            served.process.wait()

            with serve(PREFECT_API_URL=prefect_server) as another:
                for robot in robots:
                    robot.client = replace(robot.client, url=another.url)
                job = ended(another, arn)

        assert job["status"] == "Succeeded"
        assert summary(job) == dict.fromkeys(("r0", "r1", "r2"), ("InSync", None))
        assert [len(robot.started) for robot in robots] == [1, 1, 1], "each order once"
