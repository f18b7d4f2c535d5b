"""Runs of a robot of one's own that a program drives are repeated with that robot, not with Scout."""

import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.robot_stands import CART_MAPPING, write_robot
from helpers.small_flat import BODY, ROLE
from helpers.swing_fixtures import SUITE, forget_archives, outputs_of

from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.tasks.inspection.replays import reproduce_run, verify_run
from prefect_robomaker.tasks.jobs.job_runs import launcher, perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.runtime.replay.repro import Reproduction
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import pack_tar_gz
from prefect_robomaker.tasks.worldforge.generator import generate_world
from prefect_robomaker.tasks.worlds.keeping import keep_world

pytestmark = pytest.mark.deep  # a generated world, and three runs in it
DRIVER = """
import os
from prefect_robomaker.tasks.runtime.agents.agent_client import connect

with connect() as simulation:
    for step in simulation:
        simulation.act([os.urandom(1)[0] / 1000, 0.1])
"""
COMMAND = {"command": ["python3", "drive.py"]}
NAMED = {**COMMAND, "environmentVariables": {"ROBOMAKER_ROBOT": "robot.yaml"}}
LAUNCH_FILE = {"packageName": "cart", "launchFile": "drive.launch.py"}
Drive = Callable[..., dict[str, Any]]


@pytest.fixture
def drive(service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Drive:
    """Runs a job of a second in which a program drives a cart; both are in the top folder of an archive."""
    bundle = tmp_path / "cart"
    write_robot(bundle, CART_MAPPING)
    for file in (bundle / "my_cart").iterdir():
        file.rename(bundle / file.name)
    (bundle / "drive.py").write_text(DRIVER)
    (bundle / "cart" / "launch").mkdir(parents=True)
    (bundle / "cart" / "launch" / "drive.launch.py").touch()
    ros2 = tmp_path / "ros" / "bin" / "ros2"  # it stands for a ROS whose node drives
    ros2.parent.mkdir(parents=True)
    ros2.write_text(f"#!/bin/sh\nexec {sys.executable} drive.py\n")
    ros2.chmod(0o755)
    monkeypatch.setenv("PATH", str(ros2.parent), prepend=os.pathsep)
    monkeypatch.setenv("ROBOMAKER_SANDBOX_SHOW", str(tmp_path / "ros"))
    service.store.ensure_bucket("applications")
    pack_tar_gz(bundle, tmp_path / "cart.tar.gz")
    service.store.put_file("applications", "cart.tar.gz", tmp_path / "cart.tar.gz")
    source = [{"s3Bucket": "applications", "s3Key": "cart.tar.gz"}]
    call("CreateRobotApplication", {"name": "cart", "sources": source, "robotSoftwareSuite": SUITE}, service)
    body = WorldTemplateBody.model_validate({**BODY, "Version": "2"})
    world = keep_world(generate_world(body, 1, 2), "import", {}, service)

    package = tmp_path / "site" / "carts"
    shutil.copytree(bundle, package)
    (package / "__init__.py").touch()
    monkeypatch.setenv("PYTHONPATH", str(package.parent))
    monkeypatch.syspath_prepend(package.parent)
    installed = {"name": "carts", "environment": {"uri": "python://carts"}, "robotSoftwareSuite": SUITE}
    call("CreateRobotApplication", installed, service)

    def run(launch: dict[str, Any], application: str = "cart") -> dict[str, Any]:
        request = {
            "maxJobDurationInSeconds": 60,
            "iamRole": ROLE,
            "robotApplications": [{"application": application, "launchConfig": launch}],
            "simulationApplications": [
                {
                    "application": "indoor-navigation",
                    "launchConfig": {"environmentVariables": {"ROBOMAKER_SIM_TIME_LIMIT_S": "1"}},
                    "worldConfigs": [{"world": world.arn}],
                }
            ],
        }
        arn = call("CreateSimulationJob", request, service)["arn"]
        perform_job(arn, service)
        job = call("DescribeSimulationJob", {"job": arn}, service)
        assert job["status"] == "Completed", job.get("failureReason")
        return job

    return run


def said(outputs: Path) -> str:
    return (outputs / "logs" / "stdout.log").read_text()


@pytest.mark.parametrize("launch", [COMMAND, NAMED, LAUNCH_FILE])
def test_the_robot_of_its_archive_is_in_the_rerun_though_its_program_is_not_run(
    service: Service, drive: Drive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, launch: dict[str, Any]
) -> None:
    job = drive(launch)
    first = said(outputs_of(service, job))
    assert first.startswith("Robot: cart, ")
    service.store.delete("applications", "cart.tar.gz")
    monkeypatch.setenv("PATH", "/usr/bin:/bin")  # without ROS
    shutil.rmtree(service.settings.home / "cache" / "applications")  # another machine has the kept archive only

    answer = verify_run(job["arn"], service)
    made = reproduce_run(job["arn"], tmp_path / "repro", service, video="none")

    assert (answer.answer, answer.robot) == ("bit-identical", "recorded actions"), str(answer)
    assert made.same_ending, made.ending
    assert said(made.folder / "rerun" / "output") == first
    elsewhere = made.folder.rename(tmp_path / "elsewhere")
    shutil.rmtree(service.settings.home)
    rerun = Reproduction(elsewhere).rerun(tmp_path / "rerun", launcher=launcher())
    assert rerun.state_digest == answer.digest


def test_without_the_archive_nothing_is_said_of_the_run(service: Service, drive: Drive, tmp_path: Path) -> None:
    job = drive(COMMAND)
    service.store.delete("applications", "cart.tar.gz")
    forget_archives(service)

    answer = verify_run(job["arn"], service)
    made = reproduce_run(job["arn"], tmp_path / "repro", service, video="none")

    gone = "the archive of robot application cart is not here any more, and its robot is another one without"
    assert (answer.answer, answer.reasons) == ("not comparable", [gone])
    assert made.other_inputs == [gone]
    assert "the robot application cart has no files here" in said(made.folder / "rerun" / "output")


def test_the_robot_of_an_installed_package_is_in_the_rerun(service: Service, drive: Drive) -> None:
    job = drive({"command": [sys.executable, "-m", "carts.drive"]}, "carts")
    assert said(outputs_of(service, job)).startswith("Robot: carts, from robot.yaml of the robot application carts.")

    assert verify_run(job["arn"], service).answer == "bit-identical"
