"""A nightly batch that really runs, and the deployment that requires it."""

import secrets
from collections.abc import Callable
from typing import Any

import pytest
from helpers.deployed_robots import Yard, good
from helpers.endpoint_process import Serve
from helpers.fleet_calls import Fleets
from helpers.living_robots import LivingRobot, living
from helpers.polling_robot import PollingRobot
from helpers.processes import wait_for
from helpers.swing_fixtures import Simulate

from prefect_robomaker.tasks.fleet.attestations.envelopes import attestation_key
from prefect_robomaker.tasks.fleet.attestations.required_batches import check_deployment
from prefect_robomaker.tasks.fleet.catalog_rollouts import Rollouts
from prefect_robomaker.tasks.fleet.fleet_records import enrol
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service

Night = Callable[..., dict[str, Any]]


@pytest.fixture
def night(service: Service, swing: Simulate, prefect_server: str) -> Night:
    """Runs a batch with one job for each highest swing that is allowed, in rad; returns its description."""
    pattern = service.catalog.get(swing(perform=False)["arn"]).document["request"]

    def run(*limits: str) -> dict[str, Any]:
        requests = []
        for seed, limit in enumerate(limits):
            (simulation,) = pattern["simulationApplications"]
            launch = {**simulation["launchConfig"], "environmentVariables": {"LIMIT": limit, "TIME_LIMIT_S": "1"}}
            members = {"seed": seed, "simulationApplications": [{**simulation, "launchConfig": launch}]}
            request = {**pattern, **members}
            request.pop("clientRequestToken", None)
            requests.append(request)
        batch = call("StartSimulationJobBatch", {"createSimulationJobRequests": requests}, service)
        return registry()["StartSimulationJobBatch"].perform(batch["arn"], service)

    return run


@pytest.fixture
def yard(service: Service, night: Night) -> Yard:
    """A fleet with one robot, and version 1 of the application that the nights test."""
    pusher = service.catalog.find("robot-application", "pusher")
    assert pusher is not None
    call("CreateRobotApplicationVersion", {"application": pusher.arn}, service)
    yard = Yard(service)
    yard.robot("rover", good)
    return yard


def deploy(yard: Yard, batch: dict[str, Any], token: str) -> dict[str, Any]:
    pusher = yard.service.catalog.find("robot-application", "pusher")
    assert pusher is not None
    order = yard.fleets.order(yard.arn, pusher.arn, token, deploymentConfig={"requiresBatch": batch["arn"]})
    return yard.run(yard.fleets.call("CreateDeploymentJob", **order)["arn"])


def test_what_passed_the_night_is_deployed_and_what_failed_is_not(yard: Yard, night: Night, service: Service) -> None:
    bad = night("1000", "-1000")
    assert bad["status"] == "Completed"
    failing = bad["createdRequests"][1]["arn"].rpartition("/")[2]

    job = deploy(yard, bad, "bad")

    assert (job["status"], job["failureCode"]) == ("Failed", "MissingRobotDeploymentResource")
    assert f"job {failing} of the required batch {bad['arn']} has the verdict FAIL: low" in job["failureReason"]
    assert yard.offered == []
    assert not Rollouts(service.catalog).open_rollouts()

    passed = night("1000", "1000")
    job = deploy(yard, passed, "good")

    assert job["status"] == "Succeeded"
    assert yard.statuses() == {"rover": "InSync"}
    check = check_deployment(service.catalog.get(job["arn"]), attestation_key(service).public_key, service)
    assert (check.answer, check.seeds, check.simulated) == ("verified", 2, ["pusher/1/any"])
    assert check.jobs == [each["arn"].rpartition("/")[2] for each in passed["createdRequests"]]


@pytest.mark.endurance  # tests/tasks/fleet/runs/test_required_batches.py waits, by tag, too; above, nights really run
def test_a_deployment_over_http_waits_for_its_night_and_then_goes(
    serve: Serve, swing: Simulate, service: Service, prefect_server: str
) -> None:
    pattern = service.catalog.get(swing(perform=False)["arn"]).document["request"]
    fleets = Fleets(service)
    fleet = fleets.fleet()
    fleets.robot("rover", fleet)
    token = enrol("rover", service, secrets.token_bytes, rotate=False)
    pusher = pattern["robotApplications"][0]["application"]
    application = fleets.call("DescribeRobotApplication", application=pusher)["arn"]
    fleets.call("CreateRobotApplicationVersion", application=application)
    with serve(PREFECT_API_URL=prefect_server) as served:
        robot = LivingRobot(PollingRobot(served.url, "rover", token), "good")
        with living([robot]):
            batch = served.call("StartSimulationJobBatch", {"createSimulationJobRequests": [pattern]})["arn"]
            order = fleets.order(fleet, application, tags={"robomaker:requiresBatch": batch})
            job = served.call("CreateDeploymentJob", order)["arn"]
            described = lambda: served.call("DescribeDeploymentJob", {"job": job})  # noqa: E731
            ended = ("Succeeded", "Failed")
            wait_for(lambda: described()["status"] in ended, f"the end of {job}; {served.log.read_text()}", 200.0)

    assert service.catalog.get(job).status == "Succeeded"
    assert len(robot.started) == 1
    check = check_deployment(service.catalog.get(job), attestation_key(service).public_key, service)
    assert (check.answer, check.batch) == ("verified", batch)
