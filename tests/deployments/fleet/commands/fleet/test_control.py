"""fleet plan, pause, resume, approve, reject."""

import json
from datetime import UTC, datetime
from typing import Any

import pytest
from helpers.deployed_robots import Yard, deployable, good

from prefect_robomaker.schemas.fleet.documents import RobotInstallation, RobotSighting
from prefect_robomaker.tasks.fleet.fleet_records import enrol
from prefect_robomaker.tasks.service.service import Service


@pytest.fixture
def yard(service: Service) -> Yard:
    yard = Yard(service, now=datetime.now(UTC))  # commands have the clock of the machine
    for number in range(3):
        yard.robot(f"r{number}", good)
    return yard


def request(yard: Yard, **config: Any) -> dict[str, Any]:
    found = yard.service.catalog.find("robot-application", "mine")
    application = deployable(yard.fleets, "X86_64") if found is None else found.arn
    return yard.fleets.order(yard.arn, application, deploymentConfig=config)


def deployed(yard: Yard, **config: Any) -> str:
    return yard.fleets.call("CreateDeploymentJob", **request(yard, **config))["arn"]


def waits(yard: Yard, job: str) -> list[tuple[str, str | None]]:
    return [(wait["cause"], wait.get("by")) for wait in yard.fleets.described(job).get("waitsFor", [])]


def test_a_plan_says_what_each_robot_would_get_and_stores_nothing(robomaker, yard: Yard) -> None:
    yard.robot("old", good, architecture="ARMHF")
    for number in range(2):
        enrol(f"r{number}", yard.service, lambda count: b"x" * count, rotate=False)
    now_s = yard.fleets.service.clock().timestamp()
    r0, r1 = (yard.service.catalog.find("robot", name) for name in ("r0", "r1"))
    assert r0 is not None
    assert r1 is not None
    yard.service.catalog.update(r0.arn, RobotInstallation(installed_name="mine", installed_version="1"))
    yard.service.catalog.update(r1.arn, RobotSighting(last_seen_s=now_s - 1e6))
    given = json.dumps(request(yard, concurrentDeploymentPercentage=50, canaryRobots=["r2"], requiresApproval=True))

    said = robomaker("fleet", "plan", "--input", given)

    away = said.out.splitlines()[3].partition("away since ")[2]
    assert away.startswith("202")
    assert said.out.splitlines() == [
        "wave  robot  has     would get  notes",
        "1     r2     -       mine 1     canary; not enrolled",
        "2     r0     mine 1  mine 1     never seen; has this version",
        f"2     r1     -       mine 1     away since {away}",
        "-     old    -       -          "
        "version 1 of the application has no source for ARMHF; add one in another version; not enrolled",
        "2 of 4 robots at the same time.",
        "Waits for approval after the canaries.",
    ]
    assert yard.fleets.call("ListDeploymentJobs")["deploymentJobs"] == []
    assert yard.statuses() == dict.fromkeys(("r0", "r1", "r2", "old"), "Registered")


def test_a_plan_tells_windows_rollback_and_what_is_in_the_way_and_is_json_too(robomaker, yard: Yard) -> None:
    job = deployed(yard)
    soon = {"startTime": "12:00", "durationInSeconds": 60, "days": ["MONDAY"]}
    given = json.dumps(request(yard, maintenanceWindows=[soon], onThresholdBreached="ROLLBACK"))

    text = robomaker("fleet", "plan", "--input", given).out
    plan = json.loads(robomaker("fleet", "plan", "--input", given, "-o", "json").out)

    assert f"It would be refused now: the fleet has the deployment {job}." in text
    assert "go back to the one before" in text
    assert (plan["blocked_by"], plan["rolls_back"], plan["windows"]) == (job, True, [soon])
    assert [change["wave"] for change in plan["changes"]] == [1, 2, 3]


def test_a_plan_refuses_what_a_deployment_refuses(robomaker, yard: Yard) -> None:
    said = robomaker("fleet", "plan", "--input", json.dumps(request(yard, canaryRobots=["r9"])))
    assert said.code == 2
    assert "canaryRobots[0]: r9 is not a robot of" in said.err


def test_a_deployment_is_paused_and_resumed(robomaker, yard: Yard) -> None:
    job = deployed(yard)
    assert "lets it go on" in robomaker("fleet", "pause", job, "--by", "ada").out
    assert waits(yard, job) == [("PAUSED", "ada")]
    assert robomaker("fleet", "resume", job).code == 0
    assert waits(yard, job) == []


def test_a_deployment_is_approved_or_not(robomaker, yard: Yard) -> None:
    job = deployed(yard, requiresApproval=True)
    early = robomaker("fleet", "approve", job)
    assert (early.code, "it has not begun" in early.err) == (2, True)
    yard.at_look[4] = lambda: robomaker("fleet", "approve", job, "--by", "ada")
    assert yard.run(job)["status"] == "Succeeded"

    again = yard.fleets.call(
        "CreateDeploymentJob", **{**request(yard, requiresApproval=True), "clientRequestToken": "b"}
    )
    yard.at_look[yard.looks + 4] = lambda: robomaker("fleet", "reject", again["arn"], "--by", "ada")
    assert yard.run(again["arn"])["status"] == "Canceled"


def test_what_has_ended_or_is_none_is_refused(robomaker, yard: Yard) -> None:
    job = deployed(yard)
    yard.fleets.cancel(job)
    for command in ("pause", "resume", "approve", "reject"):
        said = robomaker("fleet", command, job)
        assert (said.code, "has ended: it is Canceled" in said.err) == (2, True)
    assert robomaker("fleet", "pause", yard.arn).code == 2
