"""robots enroll, robots list."""

import json
import os
from pathlib import Path

import pytest

from prefect_robomaker.schemas.fleet.documents import RobotAttributes
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.fleet.ddi.robot_tokens import hash_token
from prefect_robomaker.tasks.fleet.fleet_records import ROBOT
from prefect_robomaker.tasks.service.service import Service

ROVER = '{"name": "rover", "architecture": "ARM64", "greengrassGroupId": "g"}'


@pytest.fixture
def rover(robomaker) -> None:
    robomaker("call", "CreateRobot", "--input", ROVER)


def say_trouble() -> None:
    """Has the robot's agent say that its application kept restarting."""
    with Service.opened(Settings.from_environment(os.environ)) as service:
        (robot,) = service.catalog.list(ROBOT, limit=2).resources
        said = {"version": "1", "trouble": "version 2 kept restarting"}
        service.catalog.update(robot.arn, RobotAttributes(attributes=said))


def test_trouble_is_told_by_doctor(robomaker, rover) -> None:
    def finding() -> dict[str, str]:
        found = json.loads(robomaker("doctor", "-o", "json").out)["findings"]
        return {each["subject"]: each for each in found}["robots"]

    robomaker("robots", "enroll", "rover", "--agent")
    fine = finding()
    assert (fine["health"], fine["found"]) == ("ok", "none of 1 says that its application keeps restarting")
    say_trouble()
    told = finding()
    assert (told["health"], told["found"]) == ("warning", "rover: version 2 kept restarting")


def test_a_robot_is_told_all_that_its_updater_needs(robomaker, rover, monkeypatch) -> None:
    monkeypatch.setenv("ROBOMAKER_ROBOTS_URL", "https://fleet.example.com/")

    said = json.loads(robomaker("robots", "enroll", "rover", "-o", "json").out)

    server = f"-t DEFAULT -u https://fleet.example.com -i rover -k {said['token']}"
    assert said["swupdate"] == ["-k", "certificate.pem", "-H", "robot:1.0", "-u", server]
    assert Path(said["certificate"]).read_text().startswith("-----BEGIN CERTIFICATE-----")
    again = robomaker("robots", "enroll", "rover")
    assert (again.code, "--rotate replaces it" in again.err) == (2, True)
    shown = robomaker("robots", "enroll", "rover", "--rotate")
    assert f"swupdate -k certificate.pem -H robot:1.0 -u '{server.rpartition(' ')[0]} " in shown.out
    assert said["token"] not in shown.out
    assert len(hash_token(said["token"])) == 32


def test_robots_are_listed(robomaker, rover) -> None:
    assert robomaker("robots", "list").out.splitlines() == [
        "robot  kind  status     version  last seen     fleet",
        "rover  -     Available  -        not enrolled  -",
    ]
    robomaker("robots", "enroll", "rover")
    (robot,) = json.loads(robomaker("robots", "list", "-o", "json").out)["robots"]
    assert robot == {
        "robot": "rover",
        "kind": "updater",
        "status": "Available",
        "version": None,
        "last_seen": None,
        "enrolled": True,
        "fleet": None,
        "trouble": None,
    }
    say_trouble()
    titles, row = robomaker("robots", "list").out.splitlines()
    assert titles.split()[-1] == "trouble"
    assert row.endswith("version 2 kept restarting")


def test_where_there_are_none_it_is_said(robomaker) -> None:
    assert robomaker("robots", "list").out == "There are no robots; CreateRobot makes one.\n"


@pytest.mark.parametrize("url", ["fleet.example.com", "https://fleet.example.com/path"])
def test_an_address_that_is_none_is_refused(robomaker, rover, monkeypatch, url: str) -> None:
    monkeypatch.setenv("ROBOMAKER_ROBOTS_URL", url)
    refused = robomaker("robots", "enroll", "rover")
    assert refused.code == 2
    assert "ROBOMAKER_ROBOTS_URL" in refused.err
