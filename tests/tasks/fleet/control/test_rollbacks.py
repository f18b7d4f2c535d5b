"""Rollbacks: at the threshold, robots go back to the version that they had before."""

from typing import Any

import pytest
from helpers.deployed_robots import Yard, bad, deployable, good, slow
from helpers.tested_batches import Batches

from prefect_robomaker.schemas.fleet.documents import DeploymentJobDocument, RobotInstallation
from prefect_robomaker.tasks.fleet.attestations.required_batches import attestations_of
from prefect_robomaker.tasks.fleet.control.rollbacks import TAG, EndedRollouts, roll_back
from prefect_robomaker.tasks.fleet.kept_rollouts import open_rollouts
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

HALF = {"concurrentDeploymentPercentage": 25, "failureThresholdPercentage": 50}


class Fleet:
    """A fleet of four robots; its application has versions 1 to 3."""

    def __init__(self, service: Service) -> None:
        self.yard = Yard(service)
        self.robots = [self.yard.robot(f"r{number}", good) for number in range(4)]
        self.application = deployable(self.yard.fleets, "X86_64")
        for _ in range(2):
            call("UpdateRobotApplication", self._update(), self.yard.service)
            call("CreateRobotApplicationVersion", {"application": self.application}, self.yard.service)

    def _update(self) -> dict[str, Any]:
        sources = [{"s3Bucket": "apps", "s3Key": "X86_64.tar.gz", "architecture": "X86_64"}]
        suite = {"name": "General"}
        return {"application": self.application, "sources": sources, "robotSoftwareSuite": suite}

    def deploy(self, version: int, **config: Any) -> str:
        order = self.yard.fleets.order(self.yard.arn, self.application, f"v{version}", deploymentConfig=config)
        order["deploymentApplicationConfigs"][0]["applicationVersion"] = str(version)
        return call("CreateDeploymentJob", order, self.yard.service)["arn"]

    def has(self, version: int, job: str, *numbers: int) -> None:
        """Notes what robots run, as the door for robots does."""
        for number in numbers:
            installed = RobotInstallation(installed_name="mine", installed_version=str(version), installed_by=job)
            self.yard.service.catalog.update(self.robots[number], installed)

    def made(self, failed: str) -> list[str]:
        """Jobs that bring robots back, oldest first."""
        jobs = call("ListDeploymentJobs", {}, self.yard.service)["deploymentJobs"]
        described = [self.yard.fleets.described(job["arn"]) for job in reversed(jobs)]
        return [job["arn"] for job in described if job.get("tags", {}).get(TAG) == failed]

    def version(self, job: str) -> str:
        (config,) = self.yard.fleets.described(job)["deploymentApplicationConfigs"]
        return config["applicationVersion"]

    def behave(self, **behaviours: Any) -> None:
        for name, behaviour in behaviours.items():
            self.yard.behaviours[self.robots[int(name[1:])]] = behaviour


@pytest.fixture
def fleet(service: Service) -> Fleet:
    return Fleet(service)


def meant(fleet: Fleet, job: str) -> list[str]:
    document = DeploymentJobDocument.of(fleet.yard.service.catalog.get(job))
    assert document.rolls_back is not None
    return [robot.split("/")[1] for robot in document.rolls_back.robots]


def test_robots_with_the_new_version_get_the_one_before(fleet: Fleet) -> None:
    first = fleet.deploy(1, **HALF)
    fleet.yard.run(first)
    fleet.has(1, first, 0, 2, 3)  # what r1 has is not known
    fleet.behave(r2=bad, r3=bad)

    failed = fleet.deploy(2, **HALF, onThresholdBreached="ROLLBACK", maintenanceWindows=ALWAYS)
    job = fleet.yard.run(failed)

    assert (job["status"], job["failureCode"]) == ("Failed", "FailureThresholdBreached")
    (back,) = fleet.made(failed)
    assert job["rollback"] == {"jobs": [back], "robotsLeft": [fleet.robots[1]]}
    assert fleet.version(back) == "1"
    assert meant(fleet, back) == ["r0"]
    described = fleet.yard.fleets.described(back)
    assert described["status"] == "Pending"
    assert described["deploymentConfig"]["maintenanceWindows"] == ALWAYS
    assert [robot["arn"] for robot in described["robotDeploymentSummary"]] == [fleet.robots[0]]

    fleet.yard.offered.clear()
    assert fleet.yard.run(back)["status"] == "Succeeded"
    assert fleet.yard.offered == [fleet.robots[0]]
    assert fleet.made(failed) == [back]
    assert fleet.yard.statuses()["r0"] == "InSync"
    fleet.yard.act()
    assert open_rollouts(fleet.yard.service) == []


def test_a_job_that_brings_robots_back_has_the_attestation_of_the_job_before(fleet: Fleet) -> None:
    """Agents may install nothing that was not attested, and the version before was."""
    service, found = fleet.yard.service, fleet.yard.service.catalog.find
    application = found("robot-application", "mine")
    assert application is not None
    batch = Batches(service, service.store.head("apps", "X86_64.tar.gz").etag, application="mine").batch()
    first = fleet.deploy(1, **HALF, requiresBatch=batch)
    assert fleet.yard.run(first)["status"] == "Succeeded"
    fleet.has(1, first, 0, 2, 3)
    fleet.behave(r2=bad, r3=bad)
    failed = fleet.deploy(2, **HALF, onThresholdBreached="ROLLBACK")
    fleet.yard.run(failed)
    (back,) = fleet.made(failed)

    attested = [attestations_of(service.catalog.get(job), service) for job in (first, failed, back)]
    assert attested == [attested[2], (), attested[0]]
    assert len(attested[2]) == 1

    service.catalog.delete(first)
    assert attestations_of(service.catalog.get(back), service) == ()


ALWAYS = [{"startTime": "00:00", "durationInSeconds": 86400}]


def test_robots_that_had_different_versions_go_back_one_version_after_the_other(fleet: Fleet) -> None:
    first = fleet.deploy(1, **HALF)
    fleet.yard.run(first)
    second = fleet.deploy(2, **HALF)
    fleet.yard.run(second)
    fleet.has(1, first, 0)
    fleet.has(2, second, 1, 2, 3)
    fleet.behave(r2=bad, r3=bad)

    failed = fleet.deploy(3, **HALF, onThresholdBreached="ROLLBACK")
    fleet.yard.run(failed)
    (one,) = fleet.made(failed)
    assert not fleet.yard.fleets.described(failed)["rollback"].get("robotsLeft")
    fleet.yard.run(one)
    one, two = fleet.made(failed)
    fleet.yard.run(two)

    assert [(fleet.version(job), meant(fleet, job)) for job in (one, two)] == [("1", ["r0"]), ("2", ["r1"])]
    assert fleet.yard.fleets.described(failed)["rollback"] == {"jobs": [one, two]}
    assert fleet.yard.statuses()["r1"] == "InSync"
    assert fleet.made(failed) == [one, two]


def test_robots_that_had_begun_are_waited_for_and_serve_makes_the_job(fleet: Fleet) -> None:
    first = fleet.deploy(1, **HALF)
    fleet.yard.run(first)
    fleet.has(1, first, 0, 1, 2, 3)
    fleet.behave(r0=bad, r1=bad, r2=slow, r3=slow)

    failed = fleet.deploy(2, **{**HALF, "concurrentDeploymentPercentage": 100}, onThresholdBreached="ROLLBACK")
    job = fleet.yard.run(failed)
    assert job["status"] == "Failed"
    assert "rollback" not in job
    assert fleet.made(failed) == []

    fleet.behave(r2=good, r3=good)
    for _ in range(5):
        fleet.yard.act()
    tending = EndedRollouts(fleet.yard.service)
    for _ in range(2):
        tending.tend(open_rollouts(fleet.yard.service))

    (back,) = fleet.made(failed)
    assert meant(fleet, back) == ["r2", "r3"]


def test_a_rollback_is_made_once_wherever_its_maker_dies(fleet: Fleet, monkeypatch: pytest.MonkeyPatch) -> None:
    first = fleet.deploy(1, **HALF)
    fleet.yard.run(first)
    fleet.has(1, first, 0, 1, 2, 3)
    fleet.behave(r1=bad, r2=bad)
    failed = fleet.deploy(2, **HALF, onThresholdBreached="ROLLBACK")

    class Killed(BaseException):
        pass

    def die(*_: object) -> None:
        raise Killed

    with monkeypatch.context() as patched:
        patched.setattr("prefect_robomaker.tasks.fleet.control.rollbacks.settle", die)
        with pytest.raises(Killed):
            fleet.yard.run(failed)
    assert len(fleet.made(failed)) == 1
    EndedRollouts(fleet.yard.service).tend(open_rollouts(fleet.yard.service))

    assert fleet.yard.fleets.described(failed)["rollback"] == {"jobs": fleet.made(failed)}
    assert len(fleet.made(failed)) == 1
    assert not roll_back(failed, fleet.yard.service)


@pytest.mark.parametrize("action", ["STOP", None])
def test_without_a_rollback_robots_stay_as_they_are(fleet: Fleet, action: str | None) -> None:
    fleet.behave(r2=bad, r3=bad)
    failed = fleet.deploy(1, **HALF, **({} if action is None else {"onThresholdBreached": action}))

    job = fleet.yard.run(failed)

    assert job["status"] == "Failed"
    assert "rollback" not in job
    assert fleet.made(failed) == []


def test_where_no_robot_had_another_version_it_is_said(fleet: Fleet) -> None:
    fleet.behave(r2=bad, r3=bad)

    job = fleet.yard.run(fleet.deploy(1, **HALF, onThresholdBreached="ROLLBACK"))

    assert job["rollback"]["reason"] == "no robot that has the new version had another before"
    assert job["rollback"]["robotsLeft"] == fleet.robots[:2]
