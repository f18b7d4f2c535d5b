"""Jobs of ROS 2 at the same time are kept apart, whatever their programs are.

`ros2` is a program that says what it was started with, and waits for those of other jobs.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from helpers.application_calls import Applications
from helpers.fake_engine import FakeEngine
from helpers.small_flat import ROLE

from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import pack_tar_gz

ROS2 = """#!/bin/bash
echo "$1 $(basename "$2") in $ROS_DOMAIN_ID"
touch "$MEET/$AWS_ROBOMAKER_SIMULATION_JOB_ID-$1-$RANDOM"
until [ "$(ls "$MEET" | wc -l)" -ge "$AWAITED" ]; do sleep 0.05; done
"""
LAUNCH = "def generate_launch_description():\n    return None\n"

Config = Callable[..., dict[str, Any]]


@pytest.fixture
def launch(service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Config:
    """Makes an application's entry in a request, whose programs wait until as many have begun as `awaited`."""
    for name, text in (("bin/ros2", ROS2), ("bundle/my_robot/launch/drive.launch.py", LAUNCH)):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).write_text(text)
    (tmp_path / "bin/ros2").chmod(0o755)
    (tmp_path / "meet").mkdir()
    monkeypatch.setenv("PATH", f"{tmp_path}/bin:/usr/bin:/bin")
    monkeypatch.setenv("ROS_DOMAIN_ID", "77")  # of the job worker
    monkeypatch.setenv("ROBOMAKER_SANDBOX", "off")  # programs of several jobs meet in a folder
    pack_tar_gz(tmp_path / "bundle", tmp_path / "bundle.tar.gz")
    for bucket in ("applications", "results"):
        service.store.ensure_bucket(bucket)
    service.store.put_file("applications", "ros.tar.gz", tmp_path / "bundle.tar.gz")
    source = {"sources": [{"s3Bucket": "applications", "s3Key": "ros.tar.gz"}]}
    for role in ("Robot", "Simulation"):
        Applications.of(role, service).create(role.lower(), **source)

    def make(role: str, awaited: int, command: list[str] | None = None, **variables: str) -> dict[str, Any]:
        what = {"command": command} if command else {"packageName": "my_robot", "launchFile": "drive.launch.py"}
        told = {"MEET": str(tmp_path / "meet"), "AWAITED": str(awaited), **variables}
        return {"application": role, "launchConfig": {**what, "environmentVariables": told}}

    return make


def performed(service: Service, jobs: list[dict[str, Any]]) -> list[dict[str, str]]:
    """Performs jobs at the same time; what their applications said, by role."""
    request = {"maxJobDurationInSeconds": 60, "iamRole": ROLE, "outputLocation": {"s3Bucket": "results"}}
    arns = [
        call(
            "CreateSimulationJob",
            {**request, **{f"{role}Applications": [config] for role, config in job.items()}},
            service,
        )["arn"]
        for job in jobs
    ]
    with ThreadPoolExecutor() as pool:
        list(pool.map(lambda arn: perform_job(arn, service), arns))
    told = []
    for arn, job in zip(arns, jobs, strict=True):
        described = call("DescribeSimulationJob", {"job": arn}, service)
        assert described["status"] == "Completed", described.get("failureReason")
        place = service.catalog.get(arn).document["outputs"]
        logs = {role: f"{place['prefix']}/logs/{role}.stdout.log" for role in job}
        told.append({role: service.store.get_bytes("results", log).decode().strip() for role, log in logs.items()})
    return told


def test_programs_of_a_job_share_a_domain_and_two_jobs_do_not(service: Service, launch: Config) -> None:
    script = ["bash", "-c", 'exec ros2 run "x"']

    two, alone, own = performed(
        service,
        [
            {"simulation": launch("simulation", 4), "robot": launch("robot", 4, script)},
            {"robot": launch("robot", 4)},
            {"robot": launch("robot", 4, ROS_DOMAIN_ID="5")},
        ],
    )

    said, domain = two["simulation"].rsplit(" ", 1)
    assert (said, two["robot"]) == ("launch drive.launch.py in", f"run x in {domain}")
    assert 1 <= int(domain) <= 101
    assert 1 <= int(alone["robot"].rsplit(" ", 1)[1]) <= 101
    assert alone["robot"] != two["simulation"]
    assert own["robot"].endswith(" in 5")


@pytest.mark.deep
def test_containers_have_the_domain_of_their_job(
    service: Service, launch: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    engine = FakeEngine(tmp_path / "engine")
    monkeypatch.setenv("ROBOMAKER_CONTAINER_ENGINE", str(engine.program))
    engine.add_image("my-sim:1", command=["false"])
    Applications.of("Simulation", service).create("image", environment={"uri": "my-sim:1"})
    look = ["ros2", "run", "x"]

    one, other = performed(
        service,
        [
            {"simulation": launch("image", 3, look), "robot": launch("robot", 3)},
            {"simulation": launch("image", 3, look, ROS_DOMAIN_ID="5")},
        ],
    )

    domain = one["robot"].removeprefix("launch drive.launch.py in ")
    assert domain.isdecimal()
    assert one["simulation"] == f"run x in {domain}"
    assert other["simulation"] == "run x in 5"
