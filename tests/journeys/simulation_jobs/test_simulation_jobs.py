import threading
import time
from collections.abc import Callable
from typing import Any

import pytest
from helpers.small_flat import ROLE

from prefect_robomaker.schemas.runs.plan import RunResult
from prefect_robomaker.schemas.wire.errors import InvalidParameterException, ResourceNotFoundException
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import read_manifest

Order = Callable[..., dict[str, Any]]
Simulate = Callable[[dict[str, Any]], dict[str, Any]]


def outputs(service: Service, arn: str) -> dict[str, str]:
    """Bucket and prefix of a job's outputs."""
    return service.catalog.get(arn).document["outputs"]


def test_a_job_runs_code_from_a_bundle_and_publishes_its_outputs(
    service: Service, order: Order, simulate: Simulate
) -> None:
    location = {"s3Bucket": "results", "s3Prefix": "nightly"}

    job = simulate(order(outputLocation=location, tags={"night": "1"}, seed=3))

    assert job["status"] == "Completed"
    assert "failureCode" not in job
    assert job["tags"] == {"night": "1"}
    assert set(job["networkInterface"]) == {"networkInterfaceId", "privateIpAddress", "publicIpAddress"}
    assert job["compute"] == {"simulationUnitLimit": 15, "computeType": "CPU", "gpuUnitLimit": 0}
    place = outputs(service, job["arn"])
    assert place["bucket"] == "results"
    assert place["prefix"].startswith(f"nightly/{job['name']}/")
    manifest = read_manifest(service.store, **place)
    assert {"result.json", "recording.mcap", "logs/stdout.log", "logs/stderr.log"} <= {f.path for f in manifest.files}
    log = service.store.get_bytes(place["bucket"], f"{place['prefix']}/logs/stdout.log").decode()
    assert f"agent watches {job['name']}" in log
    result = RunResult.model_validate_json(service.store.get_bytes(place["bucket"], f"{place['prefix']}/result.json"))
    assert result.seed == 3


def test_an_application_that_is_named_is_answered_with_its_arn(service: Service, order: Order) -> None:
    robot, simulation = (
        call(f"Describe{kind}Application", {"application": name}, service)["arn"]
        for kind, name in (("Robot", "watcher"), ("Simulation", "sleeper"))
    )
    job = call("CreateSimulationJob", order(), service)
    # The job's applications are those that were there when it was made.
    call("DeleteRobotApplication", {"application": robot}, service)
    described = call("DescribeSimulationJob", {"job": job["arn"]}, service)
    [in_batch] = call("BatchDescribeSimulationJob", {"jobs": [job["arn"]]}, service)["jobs"]
    for answer in (job, described, in_batch):
        assert answer["robotApplications"][0]["application"] == robot
        assert answer["simulationApplications"][0]["application"] == simulation


def test_a_crash_names_its_side_and_ends_with_the_log(order: Order, simulate: Simulate) -> None:
    job = simulate(order({"FAIL_AT_STEP": "3"}))

    assert (job["status"], job["failureCode"]) == ("Failed", "SimulationApplicationCrash")
    assert "the simulated floor gave way" in job["failureReason"]


def test_the_duration_limit_is_a_normal_end(order: Order, simulate: Simulate) -> None:
    job = simulate(order({"DURATION_S": "1000"}, maxJobDurationInSeconds=1))

    assert job["status"] == "Completed"
    assert job["simulationTimeMillis"] >= 1000


def test_a_running_job_can_be_cancelled(service: Service, order: Order, prefect_server: str) -> None:
    job = call("CreateSimulationJob", order({"DURATION_S": "60"}), service)

    def cancel_once_running() -> None:
        deadline = time.monotonic() + 120
        while call("DescribeSimulationJob", {"job": job["arn"]}, service)["status"] in ("Pending", "Preparing"):
            assert time.monotonic() < deadline
            time.sleep(0.05)
        call("CancelSimulationJob", {"job": job["arn"]}, service)

    canceller = threading.Thread(target=cancel_once_running)
    canceller.start()
    ended = registry()["CreateSimulationJob"].perform(job["arn"], service)
    canceller.join()

    assert ended["status"] == "Canceled"
    assert "failureCode" not in ended


def test_performing_an_ended_job_again_changes_nothing(service: Service, order: Order, simulate: Simulate) -> None:
    job = simulate(order())

    again = registry()["CreateSimulationJob"].perform(job["arn"], service)

    assert again == job


def test_an_archive_that_is_none_fails_the_job(service: Service, sleeper: dict[str, Any], simulate: Simulate) -> None:
    service.store.put_bytes("applications", "broken.tar.gz", b"this is no archive")
    source = [{"s3Bucket": "applications", "s3Key": "broken.tar.gz"}]
    suite = {"name": "General"}
    call("CreateRobotApplication", {"name": "broken", "sources": source, "robotSoftwareSuite": suite}, service)
    config = {"application": "broken", "launchConfig": {"packageName": "sleeper", "launchFile": "make_agent"}}

    job = simulate({**sleeper, "maxJobDurationInSeconds": 9, "iamRole": ROLE, "robotApplications": [config]})

    assert (job["status"], job["failureCode"]) == ("Failed", "InvalidBundleRobotApplication")


def test_a_job_reads_its_data_sources(service: Service, order: Order, simulate: Simulate) -> None:
    service.store.put_bytes("applications", "maps/one.txt", b"one")
    sources = [{"name": "maps", "s3Bucket": "applications", "s3Keys": ["maps/"], "type": "Prefix"}]

    job = simulate(order(dataSources=sources))

    assert job["status"] == "Completed"
    assert [key["s3Key"] for key in job["dataSources"][0]["s3Keys"]] == ["maps/one.txt"]
    assert job["dataSources"][0]["s3Keys"][0]["etag"]


@pytest.mark.parametrize(
    ("members", "error", "words"),
    [
        ({"robotApplications": [{"application": "scot", "launchConfig": {}}]}, ResourceNotFoundException, "scot"),
        (
            {"dataSources": [{"name": "x", "s3Bucket": "applications", "s3Keys": ["nothing"]}]},
            InvalidParameterException,
            r"dataSources\[0\]\.s3Keys\[0\]",
        ),
        (
            {"dataSources": [{"name": "x", "s3Bucket": "applications", "s3Keys": ["y"], "destination": "/home"}]},
            InvalidParameterException,
            r"dataSources\[0\]\.destination: '/home'",
        ),
        (
            {"robotApplications": [{"application": "watcher", "launchConfig": {}}]},
            InvalidParameterException,
            r"robotApplications\[0\]\.launchConfig: command, or packageName and launchFile",
        ),
        ({"maxJobDurationInSeconds": 0}, InvalidParameterException, "maxJobDurationInSeconds"),
    ],
)
def test_a_request_that_cannot_run_is_refused_and_nothing_is_stored(
    service: Service, order: Order, members: dict[str, Any], error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        call("CreateSimulationJob", {**order(), **members}, service)
    assert service.catalog.list("simulation-job").resources == ()


def test_several_jobs_are_described_at_once(service: Service, order: Order) -> None:
    arns = [call("CreateSimulationJob", order(), service)["arn"] for _ in range(2)]
    missing = arns[0][:-1] + ("a" if arns[0][-1] != "a" else "b")

    answer = call("BatchDescribeSimulationJob", {"jobs": [*arns, missing]}, service)

    assert [job["arn"] for job in answer["jobs"]] == arns
    assert answer["unprocessedJobs"] == [missing]
