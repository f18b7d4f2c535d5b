"""Robots: made, described, listed, registered with fleets and deleted."""

from typing import Any

import pytest
from helpers.application_calls import at_once
from helpers.fleet_calls import Fleets

from prefect_robomaker.schemas.wire.errors import (
    InvalidParameterException,
    ResourceAlreadyExistsException,
    ResourceNotFoundException,
)
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

PREFIX = "arn:aws:robomaker:us-east-1:000000000000"


@pytest.fixture
def fleets(service: Service) -> Fleets:
    return Fleets(service)


def test_what_was_made_is_answered_described_and_listed(fleets: Fleets) -> None:
    request = {"name": "rover", "architecture": "ARM64", "greengrassGroupId": "any text: 7/8"}

    made = fleets.call("CreateRobot", **request, tags={"bay": "3"})

    assert made["arn"].startswith(f"{PREFIX}:robot/rover/")
    assert made == {**request, "arn": made["arn"], "createdAt": made["createdAt"], "tags": {"bay": "3"}}
    described = fleets.described(made["arn"])
    assert described == {**made, "status": "Available"}
    # The service spelled the group with a capital G in lists, and nowhere else.
    described["greenGrassGroupId"] = described.pop("greengrassGroupId")
    del described["tags"]
    assert fleets.call("ListRobots") == {"robots": [described]}


def test_a_name_is_taken_until_its_robot_is_deleted(fleets: Fleets) -> None:
    first = fleets.robot("rover")

    with pytest.raises(ResourceAlreadyExistsException, match="'rover'"):
        fleets.robot("rover", architecture="ARMHF")
    assert len(fleets.call("ListRobots")["robots"]) == 1
    fleets.call("DeleteRobot", robot=first)
    assert fleets.robot("rover") != first


@pytest.mark.parametrize(
    "members",
    [{"name": "a b"}, {"architecture": "RISCV"}, {"architecture": None}, {"greengrassGroupId": ""}, {"tags": {"": ""}}],
)
def test_a_robot_that_makes_no_sense_is_refused(fleets: Fleets, members: dict[str, Any]) -> None:
    (member,) = members
    with pytest.raises(InvalidParameterException, match=member):
        fleets.robot(**members)


def test_a_registered_robot_is_in_its_fleet(fleets: Fleets) -> None:
    yard = fleets.fleet()
    rover = fleets.robot("rover", yard)

    described = fleets.described(rover)
    assert (described["fleetArn"], described["status"]) == (yard, "Registered")
    (entry,) = fleets.described(yard)["robots"]
    assert entry == fleets.call("ListRobots")["robots"][0]
    assert (entry["arn"], entry["fleetArn"], entry["greenGrassGroupId"]) == (rover, yard, "group-1")


def test_registering_again_changes_nothing(fleets: Fleets) -> None:
    yard = fleets.fleet()
    rover = fleets.robot("rover", yard)
    before = fleets.described(yard)

    fleets.register(yard, rover)

    assert fleets.described(yard) == before


def test_a_robot_of_one_fleet_is_refused_in_another(fleets: Fleets) -> None:
    yard, hall = fleets.fleet("same"), fleets.fleet("same")
    rover = fleets.robot("rover", yard)

    with pytest.raises(InvalidParameterException, match=f"registered with {yard}; deregister"):
        fleets.register(hall, rover)
    with pytest.raises(InvalidParameterException, match=f"registered with {yard}, not with {hall}"):
        fleets.deregister(hall, rover)
    assert (fleets.members(yard), fleets.members(hall)) == (["rover"], [])


def test_a_deregistered_robot_is_free_for_another_fleet(fleets: Fleets) -> None:
    yard, hall = fleets.fleet("yard"), fleets.fleet("hall")
    rover = fleets.robot("rover", yard)

    for _ in range(2):  # the second time it is in no fleet any more
        fleets.deregister(yard, rover)
        assert fleets.described(rover)["status"] == "Available"
        assert fleets.members(yard) == []

    fleets.register(hall, rover)
    assert fleets.members(hall) == ["rover"]


def test_of_many_fleets_that_want_a_robot_at_once_one_gets_it(fleets: Fleets) -> None:
    homes = [fleets.fleet(f"fleet-{number}") for number in range(6)]
    rover = fleets.robot()

    outcomes = at_once([lambda home=home: fleets.register(home, rover) for home in homes])

    owner = fleets.described(rover)["fleetArn"]
    assert sum(outcome is None for outcome in outcomes) == 1
    assert [outcome is None for outcome in outcomes] == [home == owner for home in homes]
    assert [home for home in homes if fleets.members(home)] == [owner]


def test_a_deleted_robot_leaves_its_fleet_and_deleting_it_again_succeeds(fleets: Fleets) -> None:
    yard = fleets.fleet()
    rover = fleets.robot("rover", yard)
    fleets.robot("crane", yard)

    for _ in range(2):
        assert fleets.call("DeleteRobot", robot=rover) == {}

    assert fleets.members(yard) == ["crane"]
    with pytest.raises(ResourceNotFoundException, match="rover"):
        fleets.described(rover)


@pytest.mark.parametrize(
    "filters", [[{"name": "name", "values": ["rover"]}], [{"name": "status"}], [{"name": "fleetArn", "values": ["x"]}]]
)
def test_filters_that_are_not_known_are_refused(fleets: Fleets, filters: list[dict[str, Any]]) -> None:
    with pytest.raises(InvalidParameterException, match="filter"):
        fleets.call("ListRobots", filters=filters)


def test_lists_find_robots_by_status_and_by_the_name_of_their_fleet(fleets: Fleets) -> None:
    yards, hall = [fleets.fleet("yard"), fleets.fleet("yard")], fleets.fleet("hall")
    for index, fleet in enumerate([*yards, hall, None]):
        fleets.robot(f"robot-{index}", fleet)

    def names(name: str, value: str) -> list[str]:
        return [
            robot["name"] for robot in fleets.call("ListRobots", filters=[{"name": name, "values": [value]}])["robots"]
        ]

    assert names("fleetName", "yard") == ["robot-1", "robot-0"]
    assert names("fleetName", "hall") == ["robot-2"]
    assert names("status", "Available") == ["robot-3"]
    assert names("status", "Registered") == ["robot-2", "robot-1", "robot-0"]
    fleets.deregister(hall, fleets.described(hall)["robots"][0]["arn"])
    assert names("fleetName", "hall") == []
    assert names("status", "Available") == ["robot-3", "robot-2"]


@pytest.mark.parametrize("operation", ["RegisterRobot", "DeregisterRobot"])
def test_what_is_not_there_is_not_found_and_what_names_something_else_is_refused(
    fleets: Fleets, operation: str
) -> None:
    yard, rover = fleets.fleet(), fleets.robot()

    for missing in ({"fleet": f"{PREFIX}:deployment-fleet/none/1"}, {"robot": f"{PREFIX}:robot/none/1"}):
        with pytest.raises(ResourceNotFoundException, match="none/1"):
            fleets.call(operation, **{"fleet": yard, "robot": rover, **missing})
    for wrong in ({"fleet": rover}, {"robot": yard}, {"robot": "arn:rover"}):
        with pytest.raises(InvalidParameterException, match=r"names a|has to look like"):
            fleets.call(operation, **{"fleet": yard, "robot": rover, **wrong})


@pytest.mark.parametrize("operation", ["DescribeRobot", "DeleteRobot"])
def test_an_arn_that_names_no_robot_is_refused(service: Service, operation: str) -> None:
    with pytest.raises(InvalidParameterException, match="has to name a robot"):
        call(operation, {"robot": f"{PREFIX}:deployment-fleet/yard/1"}, service)
