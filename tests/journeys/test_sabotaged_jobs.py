"""Spoilt jobs do not pass: with a robot in a container, and with results taken over from an earlier night."""

import shutil
from pathlib import Path
from typing import Any

import pytest
from helpers.application_calls import Applications
from helpers.real_engine import RealEngine
from helpers.small_flat import ROLE
from helpers.yard_sabotages import SABOTAGES, YARD, asked, assert_caught

from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import pack_tar_gz

SOURCES = [{"s3Bucket": "applications", "s3Key": "yard.tar.gz"}]


def upload(service: Service, folder: Path, spoilt: str = "") -> None:
    """Stores the yard in the place of the archive of the night before."""
    bundle = shutil.copytree(YARD, folder / f"bundle-{spoilt}", ignore=shutil.ignore_patterns("__pycache__"))
    if spoilt:
        (bundle / "yard" / "spoilt.txt").write_text(spoilt)
    pack_tar_gz(bundle, folder / "yard.tar.gz")
    service.store.ensure_bucket("applications")
    service.store.put_file("applications", "yard.tar.gz", folder / "yard.tar.gz")


def order(robot: dict[str, Any], **variables: str) -> dict[str, Any]:
    launch = {"packageName": "yard", "launchFile": "make_environment", "environmentVariables": variables}
    return {
        "maxJobDurationInSeconds": 120,
        "iamRole": ROLE,
        "seed": 3,
        "requirements": asked(),
        "simulationApplications": [{"application": "yard", "launchConfig": launch}],
        "robotApplications": [robot],
    }


def performed(service: Service, request: dict[str, Any]) -> dict[str, Any]:
    """Runs a job to its end, if it is not there as soon as it is ordered."""
    arn = call("CreateSimulationJob", request, service)["arn"]
    perform_job(arn, service)
    return call("DescribeSimulationJob", {"job": arn}, service)


def assert_job_caught(service: Service, job: dict[str, Any], sabotage: str) -> None:
    place = service.catalog.get(job["arn"]).document["outputs"]
    listed = {item.key for item in service.store.list(place["bucket"], place["prefix"])}
    key = f"{place['prefix']}/result.json"
    result = service.store.get_bytes(place["bucket"], key) if key in listed else None
    assert_caught(job["status"], job.get("failureReason"), result, sabotage)


IN_A_CONTAINER = ("", "blind", "nan", "gone")
"""Nothing, and one that requirements, the physics and the job itself catch; the others are for endurance runs."""


@pytest.mark.deep
@pytest.mark.parametrize(
    "sabotage",
    [pytest.param(each, marks=() if each in IN_A_CONTAINER else pytest.mark.endurance) for each in ("", *SABOTAGES)],
)
def test_a_robot_in_a_container(
    service: Service, real_engine: RealEngine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sabotage: str
) -> None:
    monkeypatch.setenv("ROBOMAKER_CONTAINER_ENGINE", real_engine.program)
    for name, value in real_engine.environ.items():
        monkeypatch.setenv(name, value)
    upload(service, tmp_path)
    Applications.of("Simulation", service).create("yard", sources=SOURCES)
    image = real_engine.add_image("USER robo", python=True)
    Applications.of("Robot", service).create("driver", environment={"uri": image})
    code = (YARD / "drive.py").read_text()
    spoilt = {"SABOTAGE": sabotage} if sabotage else {}
    variables = {"PYTHONPATH": "/robot", **spoilt, "A": code[:1000], "B": code[1000:]}
    command = ["python3", "-c", "import os; exec(os.environ['A'] + os.environ['B'])"]
    robot = {"application": "driver", "launchConfig": {"command": command, "environmentVariables": variables}}

    job = performed(service, order(robot, **spoilt))

    assert_job_caught(service, job, sabotage)


@pytest.mark.parametrize(
    "sabotage", [pytest.param(each, marks=() if each == "reversed" else pytest.mark.deep) for each in SABOTAGES]
)
def test_results_that_are_taken_over(service: Service, tmp_path: Path, sabotage: str) -> None:
    upload(service, tmp_path)
    Applications.of("Simulation", service).create("yard", sources=SOURCES)
    Applications.of("Robot", service).create("driver", sources=SOURCES)
    robot = {"application": "driver", "launchConfig": {"packageName": "yard", "launchFile": "make_agent"}}
    honest = performed(service.ordered_by("night-1", reuse=True), order(robot))
    assert_job_caught(service, honest, "")

    upload(service, tmp_path, spoilt=sabotage)
    for night in ("night-2", "night-3"):
        job = performed(service.ordered_by(night, reuse=True), order(robot))
        assert_job_caught(service, job, sabotage)
