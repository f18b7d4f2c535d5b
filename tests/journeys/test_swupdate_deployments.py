"""Debian's `swupdate`, unmodified, takes a deployment job to its end at `robomaker serve`."""

import io
import json
import subprocess
import sys
import tarfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from helpers.endpoint_process import Serve, Served
from helpers.fleet_calls import Fleets
from helpers.polling_robot import PollingRobot
from helpers.processes import wait_for
from helpers.swupdate_robot import SwupdateRobot, needs_swupdate, swupdate_robot

from prefect_robomaker.tasks.service.service import Service

pytestmark = [pytest.mark.deep, needs_swupdate]


def archive(text: bytes) -> bytes:
    """An application of one file."""
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w:gz") as tar:
        member = tarfile.TarInfo("bin/program")
        member.size = len(text)
        tar.addfile(member, io.BytesIO(text))
    return packed.getvalue()


def robomaker(service: Service, *words: str) -> dict[str, Any]:
    """What a command prints."""
    said = subprocess.run(
        [sys.executable, "-m", "prefect_robomaker.deployments.cli.main", *words, "-o", "json"],
        env={"ROBOMAKER_HOME": str(service.settings.home), "PATH": ""},
        check=True,
        capture_output=True,
        text=True,
    )
    return json.loads(said.stdout)


def summary(served: Served, job: str) -> Mapping[str, Any]:
    """How the one robot of a job stands."""
    (robot,) = served.call("DescribeDeploymentJob", {"job": job})["robotDeploymentSummary"]
    return robot


def confirm(robot: SwupdateRobot, site: PollingRobot, *, is_healthy: bool) -> None:
    """What a health check on a robot does: it asks for the number of the order, and says how the version works."""
    number = site.wait_for_link("deploymentBase").rpartition("/")[2]
    robot.confirm(int(number), is_healthy=is_healthy)


@pytest.mark.endurance
@pytest.mark.parametrize("is_healthy", [True, False])
def test_a_deployment_installs_and_a_health_check_decides(
    serve: Serve, service: Service, prefect_server: str, tmp_path: Path, is_healthy: bool
) -> None:
    fleets = Fleets(service)
    fleet = fleets.fleet()
    fleets.robot("rover", fleet)
    enrolment = robomaker(service, "robots", "enroll", "rover")
    service.store.ensure_bucket("apps")
    service.store.put_bytes("apps", "courier.tar.gz", archive(b"drive"))
    application = fleets.application("courier", sources=[{"s3Bucket": "apps", "s3Key": "courier.tar.gz"}])
    robot_folder = tmp_path / "robot"
    with serve(PREFECT_API_URL=prefect_server, ROBOMAKER_ROBOT_FOLDER=str(robot_folder)) as served:
        port = int(served.url.rpartition(":")[2])
        job = served.call("CreateDeploymentJob", fleets.order(fleet, application))["arn"]
        site = PollingRobot(served.url, "rover", enrolment["token"])
        wait_for(lambda: site.poll_status() == 200 and "deploymentBase" in site.links(), "an order", 120)
        certificate = Path(enrolment["certificate"]).read_bytes()
        with swupdate_robot("rover", enrolment["token"], port, certificate, revision="7.3") as robot:
            robot.wait_until_installed()
            assert (robot_folder / "courier" / "1" / "bin" / "program").read_bytes() == b"drive"
            wait_for(
                lambda: summary(served, job).get("progressDetail", {}).get("currentProgress") == "ExecutingPostLaunch",
                "the progress",
            )
            assert summary(served, job)["status"] == "Deploying"
            confirm(robot, site, is_healthy=is_healthy)
            wanted = "Succeeded" if is_healthy else "Failed"
            wait_for(lambda: served.call("DescribeDeploymentJob", {"job": job})["status"] == wanted, "the job's end")
        end = summary(served, job)
        assert end["status"] == ("InSync" if is_healthy else "Failed")
        assert end.get("failureCode") == (None if is_healthy else "PostLaunchFileFailure")
        assert end.get("failureReason") == (None if is_healthy else "health check failed")
        (shown,) = robomaker(service, "robots", "list")["robots"]
        assert shown["version"] == ("courier 1" if is_healthy else None)


def test_a_rollback_takes_a_robot_back_that_has_the_newer_version(
    serve: Serve, service: Service, prefect_server: str, tmp_path: Path
) -> None:
    """One robot says that the new version does not work, and the other, which has it already, gets the one before."""
    fleets = Fleets(service)
    fleet = fleets.fleet()
    tokens: dict[str, str] = {}
    for name in ("rover", "spare"):
        fleets.robot(name, fleet)
        enrolment = robomaker(service, "robots", "enroll", name)
        tokens[name] = enrolment["token"]
    certificate = Path(enrolment["certificate"]).read_bytes()
    service.store.ensure_bucket("apps")
    for name, text in (("first", b"drive"), ("second", b"drive faster")):
        service.store.put_bytes("apps", f"{name}.tar.gz", archive(text))
    application = fleets.application("courier", sources=[{"s3Bucket": "apps", "s3Key": "first.tar.gz"}])
    sources, suite = [{"s3Bucket": "apps", "s3Key": "second.tar.gz"}], {"name": "General"}
    fleets.call("UpdateRobotApplication", application=application, sources=sources, robotSoftwareSuite=suite)
    fleets.call("CreateRobotApplicationVersion", application=application)
    robot_folder = tmp_path / "robot"
    config = {"concurrentDeploymentPercentage": 100, "failureThresholdPercentage": 50}
    with serve(PREFECT_API_URL=prefect_server, ROBOMAKER_ROBOT_FOLDER=str(robot_folder)) as served:
        port = int(served.url.rpartition(":")[2])
        rover, spare = (PollingRobot(served.url, name, token) for name, token in tokens.items())

        def deploy(version: str, **more: str) -> str:
            order = fleets.order(
                fleet,
                application,
                f"to-{version}",
                deploymentConfig={**config, **more},
                config={"applicationVersion": version},
            )
            return served.call("CreateDeploymentJob", order)["arn"]

        def ends(job: str) -> str:
            status = lambda: served.call("DescribeDeploymentJob", {"job": job})["status"]  # noqa: E731
            wait_for(lambda: status() in ("Succeeded", "Failed"), f"the end of {job}")
            return status()

        def installs(robot: SwupdateRobot, program: bytes, version: str) -> None:
            robot.wait_until_installed()
            assert (robot_folder / "courier" / version / "bin" / "program").read_bytes() == program
            confirm(robot, rover, is_healthy=True)

        def spare_says(end: str) -> None:
            order = spare.fetch_order()
            spare.say_of(order, "proceeding")
            spare.say_of(order, "closed", end)

        first = deploy("1")
        wait_for(lambda: rover.poll_status() == 200 and "deploymentBase" in rover.links(), "an order", 120)
        with swupdate_robot("rover", tokens["rover"], port, certificate) as robot:
            installs(robot, b"drive", "1")
            spare_says("success")
            assert ends(first) == "Succeeded"
            second = deploy("2", onThresholdBreached="ROLLBACK")
            installs(robot, b"drive faster", "2")
            spare_says("failure")
            assert ends(second) == "Failed"

            def made() -> list[str]:
                found = served.call("DescribeDeploymentJob", {"job": second})
                return found.get("rollback", {}).get("jobs", [])

            back = wait_for(made, "the job that takes the robot back")
            installs(robot, b"drive", "1")
            assert [ends(job) for job in back] == ["Succeeded"]
        taken_back = served.call("DescribeDeploymentJob", {"job": back[0]})
    assert [each["arn"].split("/")[1] for each in taken_back["robotDeploymentSummary"]] == ["rover"]
    shown = {each["robot"]: each["version"] for each in robomaker(service, "robots", "list")["robots"]}
    assert shown["rover"] == "courier 1"
