"""Deployments to robots that poll `robomaker serve` over HTTP: calls in, robots in sync out."""

import os
import re
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from helpers.deployed_robots import deployable
from helpers.endpoint_process import Serve, Served
from helpers.fleet_calls import Fleets
from helpers.living_robots import Behaviour, LivingRobot, living
from helpers.polling_robot import PollingRobot
from helpers.processes import started, wait_for

from prefect_robomaker.schemas.documents.fleets import RobotDocument
from prefect_robomaker.tasks.fleet.known_robots import enrol
from prefect_robomaker.tasks.fleet.views.reports import report_of, report_path
from prefect_robomaker.tasks.service.service import Service

ONE_BY_ONE = {"concurrentDeploymentPercentage": 34, "failureThresholdPercentage": 50}
ROBOMAKER = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main"]
MakeFleet = Callable[..., tuple[str, list[LivingRobot]]]


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


def ended(served: Served, job: str, statuses: tuple[str, ...] = ("Succeeded", "Failed", "Canceled")) -> dict[str, Any]:
    """The job's description once it has one of some statuses."""
    described = lambda: served.call("DescribeDeploymentJob", {"job": job})  # noqa: E731
    wait_for(lambda: described()["status"] in statuses, f"the end of {job}; {served.log.read_text()}")
    return described()


def summary(job: dict[str, Any]) -> dict[str, tuple[str, str | None]]:
    return {
        robot["arn"].split("/")[1]: (robot["status"], robot.get("failureCode"))
        for robot in job["robotDeploymentSummary"]
    }


@pytest.mark.endurance
def test_robots_get_a_deployment_over_http(
    serve: Serve, fleets: Fleets, make_fleet: MakeFleet, prefect_server: str
) -> None:
    with serve(PREFECT_API_URL=prefect_server) as served:
        fleet, robots = make_fleet(served, "good", "bad", "good")
        order = fleets.order(fleet, deployable(fleets, "X86_64"), deploymentConfig=ONE_BY_ONE)
        with living(robots):
            job = ended(served, served.call("CreateDeploymentJob", order)["arn"])

            assert job["status"] == "Succeeded"
            assert summary(job) == {
                "r0": ("InSync", None),
                "r1": ("Failed", "ExtractingBundleFailure"),
                "r2": ("InSync", None),
            }
            assert "the arm does not answer" in job["robotDeploymentSummary"][1]["failureReason"]
            assert robots[0].installed == robots[2].installed != []

            # The threshold: two of three robots are bad now, and the third has no order when the second fails.
            robots[0].behaviour = "bad"
            again = served.call("CreateDeploymentJob", {**order, "clientRequestToken": "again"})["arn"]
            job = ended(served, again)
            assert (job["status"], job["failureCode"]) == ("Failed", "FailureThresholdBreached")
            assert summary(job)["r2"] == ("Registered", None)

            # Robots come right, and get it by a repetition.
            robots[0].behaviour = robots[1].behaviour = "good"
            synced = served.call("SyncDeploymentJob", {"fleet": fleet, "clientRequestToken": "sync"})["arn"]
            assert summary(ended(served, synced)) == dict.fromkeys(("r0", "r1", "r2"), ("InSync", None))


@pytest.mark.deep
def test_a_deployment_is_watched_to_its_end_and_reported(
    serve: Serve, fleets: Fleets, make_fleet: MakeFleet, prefect_server: str, service: Service
) -> None:
    environ = {"ROBOMAKER_HOME": str(service.settings.home)}
    with serve(PREFECT_API_URL=prefect_server) as served:
        fleet, robots = make_fleet(served, "good", "bad", "good")
        order = fleets.order(fleet, deployable(fleets, "X86_64"), deploymentConfig=ONE_BY_ONE)
        job = served.call("CreateDeploymentJob", order)["arn"]
        with started([*ROBOMAKER, "fleet", "watch", "yard"], environ, stdout=subprocess.PIPE) as watch, living(robots):
            told, _ = watch.communicate(timeout=240)

            # Robots poll all the time, and so were seen within the last seconds.
            ended_s = time.time()
            r0 = fleets.service.catalog.find("robot", "r0")
            assert r0 is not None
            wait_for(lambda: (RobotDocument.of(service.catalog.get(r0.arn)).last_seen_s or 0) > ended_s, "a sighting")
            stored = service.catalog.get(job)
            wait_for(report_path(stored, service).exists, "the report")

    assert watch.returncode == 0
    lines = [line.partition("] ")[2] for line in told.splitlines()]
    assert lines[0] == f"mine 1 to yard: {job.rpartition('/')[2]}"
    assert [line for line in lines if "InSync" in line] == ["r0 (wave 1): InSync", "r2 (wave 3): InSync"]
    (failed,) = [line for line in lines if "Failed" in line]
    assert failed.startswith("r1 (wave 2): Failed: ExtractingBundleFailure: the arm does not answer")
    assert lines[-2:] == ["2 succeeded, 1 failed; 33.3 % failed, threshold 50 %", "Succeeded"]

    page = report_path(stored, service).read_text()
    waves = re.findall(
        r"<h3>Wave (\d).*?</h3>\s*<div class=\"wave-row\"><span class=\"name\" title=\"(\w+)\">", page, re.DOTALL
    )
    assert waves == [("1", "r0"), ("2", "r1"), ("3", "r2")]
    assert "ExtractingBundleFailure" in page
    rollout = report_of(stored, service).rollout
    assert rollout is not None
    first, second, third = (rollout.robots[robot] for robot in rollout.plan.order)
    assert (first.finished_s or 0) <= (second.offered_s or 0) <= (second.finished_s or 0) <= (third.offered_s or 0)


@pytest.mark.deep
def test_a_cancel_reaches_the_robot_over_http(
    serve: Serve, fleets: Fleets, make_fleet: MakeFleet, prefect_server: str
) -> None:
    with serve(PREFECT_API_URL=prefect_server) as served:
        fleet, robots = make_fleet(served, "stays", "good")
        order = fleets.order(
            fleet, deployable(fleets, "X86_64"), deploymentConfig={"concurrentDeploymentPercentage": 1}
        )
        with living(robots):
            arn = served.call("CreateDeploymentJob", order)["arn"]
            wait_for(lambda: robots[0].started, "the robot's download")

            served.call("CancelDeploymentJob", {"job": arn})

            job = ended(served, arn)
            assert job["status"] == "Canceled"
            assert summary(job) == {"r0": ("Failed", "RobotDeploymentAborted"), "r1": ("Registered", None)}
            wait_for(lambda: robots[0].canceled, "the robot to give up its order")
            assert robots[0].canceled == robots[0].started
            assert robots[1].started == []

            robots[0].behaviour = "good"
            second = served.call("CreateDeploymentJob", {**order, "clientRequestToken": "second"})["arn"]
            assert ended(served, second)["status"] == "Succeeded"


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
