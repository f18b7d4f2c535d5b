"""Deployments to robots that poll `robomaker serve` over HTTP: calls in, robots in sync out; people control them."""

import re
import secrets
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from helpers.deployed_robots import deployable
from helpers.endpoint_process import Served, serving
from helpers.fleet_calls import Fleets
from helpers.living_robots import Behaviour, LivingRobot, living
from helpers.polling_robot import PollingRobot
from helpers.processes import started, wait_for
from prefect.client.orchestration import get_client
from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterState, FlowRunFilterStateName

from prefect_robomaker.schemas.fleet.documents import RobotDocument
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.fleet.control.deployment_decisions import approve
from prefect_robomaker.tasks.fleet.control.rollbacks import TAG
from prefect_robomaker.tasks.fleet.fleet_records import enrol
from prefect_robomaker.tasks.fleet.views.deployment_report import report_of, report_path
from prefect_robomaker.tasks.service.service import Service

ONE_BY_ONE = {"concurrentDeploymentPercentage": 34, "failureThresholdPercentage": 50}
ROBOMAKER = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main"]
MakeFleet = Callable[..., tuple[str, list[LivingRobot]]]
Ordered = Callable[..., dict[str, Any]]
PATIENCE_S = 180.0


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Service:
    """The service of all tests of this module: each has a fleet, robots and an application of its own names."""
    home = tmp_path_factory.mktemp("deployments") / "home"
    return Service.open(Settings.from_environment({"ROBOMAKER_HOME": str(home), "ROBOMAKER_MAX_JOBS": "2"}), {})


@pytest.fixture(scope="module")
def served(service: Service, prefect_server: str) -> Iterator[Served]:
    """Process that serves it; a server that is killed is a test's own."""
    home = service.settings.home
    with serving(home, home.parent, PREFECT_API_URL=prefect_server) as served:
        served.wait_until_ready()
        yield served


@pytest.fixture
def fleets(service: Service) -> Fleets:
    return Fleets(service)


@pytest.fixture
def make_fleet(fleets: Fleets, service: Service) -> MakeFleet:
    """Makes a fleet of robots that are enrolled, behind a server; they are named after it."""

    def make(served: Served, name: str, *behaviours: Behaviour) -> tuple[str, list[LivingRobot]]:
        fleet, robots = fleets.fleet(name), []
        for number, behaviour in enumerate(behaviours):
            robot = f"{name}-r{number}"
            fleets.robot(robot, fleet)
            token = enrol(robot, service, secrets.token_bytes, rotate=False)
            robots.append(LivingRobot(PollingRobot(served.url, robot, token), behaviour))
        return fleet, robots

    return make


@pytest.fixture
def ordered(fleets: Fleets) -> Callable[..., dict[str, Any]]:
    """Makes a request for a deployment of an application that is named after the fleet."""

    def make(fleet: str, **members: Any) -> dict[str, Any]:
        name = fleet.split("/")[1]
        return fleets.order(fleet, deployable(fleets, "X86_64", name=f"{name}-app"), name, **members)

    return make


def ended(served: Served, job: str, statuses: tuple[str, ...] = ("Succeeded", "Failed", "Canceled")) -> dict[str, Any]:
    """The job's description once it has one of some statuses."""
    described = lambda: served.call("DescribeDeploymentJob", {"job": job})  # noqa: E731
    wait_for(lambda: described()["status"] in statuses, f"the end of {job}; {served.log.read_text()}", PATIENCE_S)
    return described()


def summary(job: dict[str, Any]) -> dict[str, tuple[str, str | None]]:
    return {
        robot["arn"].split("/")[1].rpartition("-")[2]: (robot["status"], robot.get("failureCode"))
        for robot in job["robotDeploymentSummary"]
    }


@pytest.mark.endurance
def test_robots_get_a_deployment_over_http(served: Served, make_fleet: MakeFleet, ordered: Ordered) -> None:
    fleet, robots = make_fleet(served, "sync", "good", "bad", "good")
    order = ordered(fleet, deploymentConfig=ONE_BY_ONE)
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
        again = served.call("CreateDeploymentJob", {**order, "clientRequestToken": "sync-again"})["arn"]
        job = ended(served, again)
        assert (job["status"], job["failureCode"]) == ("Failed", "FailureThresholdBreached")
        assert summary(job)["r2"] == ("Registered", None)

        # Robots come right, and get it by a repetition.
        robots[0].behaviour = robots[1].behaviour = "good"
        synced = served.call("SyncDeploymentJob", {"fleet": fleet, "clientRequestToken": "synced"})["arn"]
        assert summary(ended(served, synced)) == dict.fromkeys(("r0", "r1", "r2"), ("InSync", None))


@pytest.mark.deep
def test_a_deployment_is_watched_to_its_end_and_reported(
    served: Served, fleets: Fleets, make_fleet: MakeFleet, ordered: Ordered, service: Service
) -> None:
    environ = {"ROBOMAKER_HOME": str(service.settings.home)}
    fleet, robots = make_fleet(served, "yard", "good", "bad", "good")
    order = ordered(fleet, deploymentConfig=ONE_BY_ONE)
    job = served.call("CreateDeploymentJob", order)["arn"]
    with started([*ROBOMAKER, "fleet", "watch", "yard"], environ, stdout=subprocess.PIPE) as watch, living(robots):
        told, _ = watch.communicate(timeout=240)

        # Robots poll all the time, and so were seen within the last seconds.
        ended_s = time.time()
        r0 = fleets.service.catalog.find("robot", "yard-r0")
        assert r0 is not None
        wait_for(lambda: (RobotDocument.of(service.catalog.get(r0.arn)).last_seen_s or 0) > ended_s, "a sighting")
        stored = service.catalog.get(job)
        wait_for(report_path(stored, service).exists, "the report")

    assert watch.returncode == 0
    lines = [line.partition("] ")[2] for line in told.splitlines()]
    assert lines[0] == f"yard-app 1 to yard: {job.rpartition('/')[2]}"
    assert [line for line in lines if "InSync" in line] == ["yard-r0 (wave 1): InSync", "yard-r2 (wave 3): InSync"]
    (failed,) = [line for line in lines if "Failed" in line]
    assert failed.startswith("yard-r1 (wave 2): Failed: ExtractingBundleFailure: the arm does not answer")
    assert lines[-2:] == ["2 succeeded, 1 failed; 33.3 % failed, threshold 50 %", "Succeeded"]

    page = report_path(stored, service).read_text()
    waves = re.findall(
        r"<h3>Wave (\d).*?</h3>\s*<div class=\"wave-row\"><span class=\"name\" title=\"([\w-]+)\">", page, re.DOTALL
    )
    assert waves == [("1", "yard-r0"), ("2", "yard-r1"), ("3", "yard-r2")]
    assert "ExtractingBundleFailure" in page
    rollout = report_of(stored, service).rollout
    assert rollout is not None
    first, second, third = (rollout.robots[robot] for robot in rollout.plan.order)
    assert (first.finished_s or 0) <= (second.offered_s or 0) <= (second.finished_s or 0) <= (third.offered_s or 0)


@pytest.mark.deep
def test_a_cancel_reaches_the_robot_over_http(served: Served, make_fleet: MakeFleet, ordered: Ordered) -> None:
    fleet, robots = make_fleet(served, "canceled", "stays", "good")
    order = ordered(fleet, deploymentConfig={"concurrentDeploymentPercentage": 1})
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
        second = served.call("CreateDeploymentJob", {**order, "clientRequestToken": "canceled-second"})["arn"]
        assert ended(served, second)["status"] == "Succeeded"


def waits(served: Served, job: str) -> list[str]:
    return [wait["cause"] for wait in served.call("DescribeDeploymentJob", {"job": job}).get("waitsFor", [])]


def shown_in_prefect(state: str) -> int:
    """Counts the flow runs that have a state of that name."""
    chosen = FlowRunFilter(state=FlowRunFilterState(name=FlowRunFilterStateName(any_=[state])))
    with get_client(sync_client=True) as client:
        return len(client.read_flow_runs(flow_run_filter=chosen))


@pytest.mark.deep
def test_canaries_go_first_and_the_others_wait_for_a_person(
    served: Served, make_fleet: MakeFleet, ordered: Ordered, service: Service
) -> None:
    fleet, robots = make_fleet(served, "canaries", "good", "bad", "good")
    config = {"concurrentDeploymentPercentage": 100, "canaryRobots": ["canaries-r1"], "requiresApproval": True}
    order = ordered(fleet, deploymentConfig=config)
    with living(robots):
        job = ended(served, served.call("CreateDeploymentJob", order)["arn"])
        assert (job["status"], job["failureCode"]) == ("Failed", "FailureThresholdBreached")
        assert [len(robot.started) for robot in robots] == [0, 1, 0], "only the canary"

        robots[1].behaviour = "good"
        again = served.call("CreateDeploymentJob", {**order, "clientRequestToken": "canaries-again"})["arn"]
        wait_for(lambda: waits(served, again) == ["APPROVAL"], "the question", PATIENCE_S)
        wait_for(lambda: shown_in_prefect("AwaitingApproval") == 1, "the state in Prefect", PATIENCE_S)
        assert [len(robot.started) for robot in robots] == [0, 2, 0]

        approve(again, "ada", service)

        assert ended(served, again)["status"] == "Succeeded"
        assert [len(robot.started) for robot in robots] == [1, 2, 1]
        wait_for(lambda: shown_in_prefect("AwaitingApproval") == 0, "the end in Prefect", PATIENCE_S)


@pytest.mark.endurance  # tests/tasks/fleet/control/test_rollbacks.py
def test_robots_get_the_earlier_version_when_too_many_fail(
    served: Served, fleets: Fleets, make_fleet: MakeFleet, service: Service
) -> None:
    def version(name: str) -> str | None:
        robot = service.catalog.find("robot", name)
        assert robot is not None
        return RobotDocument.of(robot).installed_version

    fleet, robots = make_fleet(served, "back", "good", "good")
    application = deployable(fleets, "X86_64", name="back-app")
    config = {"concurrentDeploymentPercentage": 50, "failureThresholdPercentage": 50}
    order = fleets.order(fleet, application, "back", deploymentConfig=config)
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
            "back-second",
            deploymentConfig={**config, "onThresholdBreached": "ROLLBACK"},
            config={"applicationVersion": "2"},
        )

        failed = ended(served, served.call("CreateDeploymentJob", second)["arn"])

        assert failed["failureCode"] == "FailureThresholdBreached"
        made = lambda: served.call("DescribeDeploymentJob", {"job": failed["arn"]}).get("rollback", {}).get("jobs", [])  # noqa: E731
        wait_for(made, "the job that brings robots back", PATIENCE_S)
        (back,) = made()
        job = ended(served, back)
        assert (job["status"], job["tags"]) == ("Succeeded", {TAG: failed["arn"]})
        assert [robot["arn"].split("/")[1] for robot in job["robotDeploymentSummary"]] == ["back-r0"]
        wait_for(lambda: version("back-r0") == "1", "what the robot has", PATIENCE_S)
        assert len(robots[0].started) == 3
