"""Fleets: made, described, listed and deleted."""

from datetime import datetime

import pytest
from helpers.fleet_calls import Fleets

from prefect_robomaker.schemas.wire.errors import InvalidParameterException, ResourceNotFoundException
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

NOWHERE = "arn:aws:robomaker:us-east-1:000000000000:deployment-fleet/none/1539894765711"


@pytest.fixture
def fleets(service: Service) -> Fleets:
    return Fleets(service)


def test_what_was_made_is_answered_described_and_listed(fleets: Fleets) -> None:
    made = fleets.call("CreateFleet", name="yard", tags={"site": "north"})

    assert made["arn"].startswith("arn:aws:robomaker:us-east-1:000000000000:deployment-fleet/yard/")
    assert isinstance(made["createdAt"], datetime)
    assert made == {"arn": made["arn"], "name": "yard", "createdAt": made["createdAt"], "tags": {"site": "north"}}
    assert fleets.described(made["arn"]) == {**made, "robots": []}
    summary = {key: made[key] for key in ("arn", "name", "createdAt")}
    assert fleets.call("ListFleets") == {"fleetDetails": [summary]}


def test_fleets_of_one_name_are_different_fleets(fleets: Fleets) -> None:
    arns = [fleets.fleet("yard") for _ in range(20)]

    assert len(set(arns)) == 20
    assert [entry["arn"] for entry in fleets.call("ListFleets")["fleetDetails"]] == arns[::-1]


@pytest.mark.parametrize("name", ["two words", "a/b", "", "x" * 256, "dot.ted", None])
def test_a_name_that_is_none_is_refused(fleets: Fleets, name: str | None) -> None:
    with pytest.raises(InvalidParameterException, match="name"):
        fleets.call("CreateFleet", name=name)
    assert fleets.call("ListFleets") == {"fleetDetails": []}


def test_lists_have_pages_and_find_a_name(fleets: Fleets) -> None:
    arns = [fleets.fleet(name) for name in ("a", "b", "a", "ab")]

    first = fleets.call("ListFleets", maxResults=3)
    second = fleets.call("ListFleets", maxResults=3, nextToken=first["nextToken"])
    named = fleets.call("ListFleets", filters=[{"name": "name", "values": ["a"]}])

    listed = [entry["arn"] for page in (first, second) for entry in page["fleetDetails"]]
    assert listed == arns[::-1]
    assert "nextToken" not in second
    assert [entry["arn"] for entry in named["fleetDetails"]] == [arns[2], arns[0]]


@pytest.mark.parametrize(
    ("members", "says"),
    [
        ({"maxResults": 0}, "maxResults"),
        ({"maxResults": 201}, "maxResults.*200"),
        ({"nextToken": "abc"}, "nextToken"),
        ({"filters": [{"name": "status", "values": ["Failed"]}]}, "'status' is not known.*name"),
        ({"filters": [{"name": "name", "values": ["a", "b"]}]}, "filters"),
    ],
)
def test_a_list_that_cannot_be_made_is_refused(fleets: Fleets, members: dict[str, object], says: str) -> None:
    with pytest.raises(InvalidParameterException, match=says):
        fleets.call("ListFleets", **members)


def test_a_page_has_two_hundred_entries_unless_fewer_are_asked_for(fleets: Fleets) -> None:
    for _ in range(201):
        fleets.fleet()

    first = fleets.call("ListFleets")

    assert len(first["fleetDetails"]) == 200
    assert len(fleets.call("ListFleets", nextToken=first["nextToken"])["fleetDetails"]) == 1
    assert len(fleets.call("ListFleets", maxResults=200)["fleetDetails"]) == 200


def test_a_deleted_fleet_leaves_its_robots_free(fleets: Fleets) -> None:
    yard, hall = fleets.fleet("yard"), fleets.fleet("hall")
    rover, crane = fleets.robot("rover", yard), fleets.robot("crane", hall)

    assert fleets.call("DeleteFleet", fleet=yard) == {}

    free = fleets.described(rover)
    assert free["status"] == "Available"
    assert "fleetArn" not in free
    assert fleets.described(crane)["fleetArn"] == hall
    with pytest.raises(ResourceNotFoundException, match="yard"):
        fleets.described(yard)
    fleets.register(hall, rover)
    assert fleets.members(hall) == ["crane", "rover"]


def test_a_deleted_fleet_fails_its_deployment(fleets: Fleets) -> None:
    yard = fleets.fleet()
    fleets.robot("rover", yard)
    job = fleets.deploy(yard, fleets.application())["arn"]

    fleets.call("DeleteFleet", fleet=yard)

    ended = fleets.described(job)
    assert (ended["status"], ended["failureCode"]) == ("Failed", "DeploymentFleetDoesNotExist")
    assert "was deleted" in ended["failureReason"]
    assert ended["robotDeploymentSummary"] == []
    assert ended["fleet"] == yard
    fleets.cancel(job)
    assert fleets.described(job) == ended


def test_deleting_what_is_not_there_succeeds(fleets: Fleets) -> None:
    yard = fleets.fleet()

    for arn in (yard, yard, NOWHERE):
        assert fleets.call("DeleteFleet", fleet=arn) == {}


@pytest.mark.parametrize("operation", ["DescribeFleet", "DeleteFleet"])
@pytest.mark.parametrize("arn", ["arn:aws:robomaker", "arn:aws:robomaker:us-east-1:000000000000:robot/yard/1"])
def test_an_arn_that_names_no_fleet_is_refused(service: Service, operation: str, arn: str) -> None:
    with pytest.raises(InvalidParameterException, match=r"deployment-fleet|has to look like"):
        call(operation, {"fleet": arn}, service)


def test_the_last_deployment_is_told_of_each_fleet(fleets: Fleets) -> None:
    yard, hall = fleets.fleet("yard"), fleets.fleet("hall")
    fleets.robot("rover", yard)
    job = fleets.deploy(yard, fleets.application())

    last = {"lastDeploymentStatus": "Pending", "lastDeploymentJob": job["arn"], "lastDeploymentTime": job["createdAt"]}
    assert last.items() <= fleets.described(yard).items()
    listed = {entry["arn"]: entry for entry in fleets.call("ListFleets")["fleetDetails"]}
    assert last.items() <= listed[yard].items()
    assert not last.keys() & listed[hall].keys()

    fleets.cancel(job["arn"])
    assert fleets.described(yard)["lastDeploymentStatus"] == "Canceled"
    again = fleets.call("SyncDeploymentJob", fleet=yard, clientRequestToken="again")
    assert fleets.described(yard)["lastDeploymentJob"] == again["arn"]
