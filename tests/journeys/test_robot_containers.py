"""Jobs whose robot application is a container: what of its variables sets how the run goes, what it finds."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.application_calls import Applications
from helpers.fake_engine import FakeEngine
from helpers.paths import REPOSITORY
from helpers.small_flat import ROLE

from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import pack_tar_gz

CARTPOLE = REPOSITORY / "deployments" / "specs" / "examples" / "cartpole_bundle"
Run = Callable[..., dict[str, Any]]


@pytest.fixture
def run(service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs a job whose robot application is a container that runs a bash script."""
    fake = FakeEngine(tmp_path / "engine")
    fake.add_image("my-robot", command=["true"])
    monkeypatch.setenv("ROBOMAKER_CONTAINER_ENGINE", str(fake.program))
    for bucket in ("applications", "results"):
        service.store.ensure_bucket(bucket)
    pack_tar_gz(CARTPOLE, tmp_path / "cartpole.tar.gz")
    service.store.put_file("applications", "cartpole.tar.gz", tmp_path / "cartpole.tar.gz")
    Applications.of("Robot", service).create("driver", environment={"uri": "my-robot"})
    sources = [{"s3Bucket": "applications", "s3Key": "cartpole.tar.gz"}]
    Applications.of("Simulation", service).create("arena", sources=sources)

    def run(script: str, *, alone: bool = False, **variables: str) -> dict[str, Any]:
        launch = {"command": ["bash", "-c", script], "environmentVariables": variables}
        arena = {"packageName": "my_cartpole", "launchFile": "arena.make_environment"}
        request = {
            "maxJobDurationInSeconds": 60,
            "iamRole": ROLE,
            "outputLocation": {"s3Bucket": "results"},
            "robotApplications": [{"application": "driver", "launchConfig": launch}],
            **({} if alone else {"simulationApplications": [{"application": "arena", "launchConfig": arena}]}),
        }
        arn = call("CreateSimulationJob", request, service)["arn"]
        perform_job(arn, service)
        return call("DescribeSimulationJob", {"job": arn}, service)

    return run


def output(service: Service, job: dict[str, Any], name: str) -> str:
    place = service.catalog.get(job["arn"]).document["outputs"]
    return service.store.get_bytes(place["bucket"], f"{place['prefix']}/{name}").decode()


def test_variables_of_a_container_set_how_the_run_goes_and_its_secrets_are_not_written_down(
    service: Service, run: Run
) -> None:
    job = run("sleep 60", ROBOMAKER_AGENT_CONNECT_TIMEOUT_S="0.3", MENAGERIE_ROOT="/there", MY_TOKEN="a-secret-of-mine")

    assert job["failureCode"] == "RobotApplicationHealthCheckFailure"
    assert "did not connect within 0.3 s" in job["failureReason"]
    written = output(service, job, "provenance.json")
    assert "a-secret-of-mine" not in written
    set_by_robot = json.loads(written)["plan"]["robot_application"]["environment_variables"]
    assert set_by_robot == {"ROBOMAKER_AGENT_CONNECT_TIMEOUT_S": "0.3", "MENAGERIE_ROOT": "/there"}


def test_a_setting_that_is_none_is_refused_in_a_container_as_elsewhere(run: Run) -> None:
    job = run("sleep 60", ROBOMAKER_RECORD_CAMERA_HZ="often")

    assert job["failureCode"] == "InvalidInput"
    assert "ROBOMAKER_RECORD_CAMERA_HZ" in job["failureReason"]


@pytest.mark.parametrize("alone", [pytest.param(True, marks=pytest.mark.deep), False])
def test_only_a_container_that_drives_a_simulation_is_given_a_socket(service: Service, run: Run, alone: bool) -> None:
    job = run("env; exit 3", alone=alone)

    said = output(service, job, "logs/robot.stdout.log").splitlines()
    given = {"ROBOMAKER_AGENT_SOCKET", "MOUNT_OPT_ROBOMAKER_AGENT"} & {line.partition("=")[0] for line in said}
    assert len(given) == (0 if alone else 2)
    assert "ROBOMAKER_JOB_ROOT=/" in said


def test_a_container_that_never_connects_does_not_pass(service: Service, run: Run) -> None:
    job = run("exit 0")

    assert (job["status"], job["failureCode"]) == ("Failed", "RobotApplicationHealthCheckFailure")
    said = "robot application driver ended with exit code 0 without connecting to the simulation"
    assert said in job["failureReason"]
    assert said in output(service, job, "logs/stderr.log")
