"""Robots are let in by their tokens, and not any more once these are replaced or the robots deleted."""

import secrets
from pathlib import Path

import pytest
from helpers.fleet_calls import Fleets

from prefect_robomaker.schemas.wire.errors import InvalidParameterException
from prefect_robomaker.tasks.fleet.ddi.open_orders import OpenOrders
from prefect_robomaker.tasks.fleet.fleet_records import KnownRobots, enrol
from prefect_robomaker.tasks.service.service import Service


def enrolled(name: str, service: Service, *, rotate: bool = False) -> bytes:
    return enrol(name, service, secrets.token_bytes, rotate=rotate).encode()


def test_the_table_follows_the_catalog(service: Service) -> None:
    fleets, orders = Fleets(service), OpenOrders()
    robots = KnownRobots(orders)
    arn = fleets.robot("rover")
    fleets.robot("bystander")
    first = enrolled("rover", service)
    robots.refresh(service)
    assert orders.check_token("rover", first) is not None
    assert (robots.arn("rover"), robots.id(arn)) == (arn, "rover")
    assert robots.arn("bystander") is None

    second = enrolled("rover", service, rotate=True)
    robots.refresh(service)
    assert orders.check_token("rover", first) is None
    assert orders.check_token("rover", second) is not None

    fleets.call("DeleteRobot", robot=arn)
    robots.refresh(service)
    assert orders.check_token("rover", second) is None
    assert robots.id(arn) is None


def test_another_robot_of_the_same_name_has_nothing_of_the_first(service: Service) -> None:
    fleets, orders = Fleets(service), OpenOrders()
    robots = KnownRobots(orders)
    before = fleets.robot("rover")
    first = enrolled("rover", service)
    robots.refresh(service)
    orders.ask_attributes("rover", wants_attributes=False)

    fleets.call("DeleteRobot", robot=before)
    fleets.robot("rover")
    second = enrolled("rover", service)
    robots.refresh(service)

    assert orders.check_token("rover", first) is None
    state = orders.check_token("rover", second)
    assert state is not None
    assert state.wants_attributes


def test_only_the_hash_of_a_token_is_stored(service: Service) -> None:
    Fleets(service).robot("rover")
    token = enrolled("rover", service)
    service.catalog.close()
    stored = b"".join(path.read_bytes() for path in Path(service.settings.home).glob("catalog.db*"))
    assert b"tokenSha256" in stored
    assert token not in stored


@pytest.mark.parametrize(
    ("name", "told"),
    [("stranger", "there is no robot named 'stranger'"), ("-rover", "a letter or a digit"), ("rover", "--rotate")],
)
def test_what_cannot_be_enrolled_is_explained(service: Service, name: str, told: str) -> None:
    fleets = Fleets(service)
    for each in ("-rover", "rover"):
        fleets.robot(each)
    enrolled("rover", service)
    with pytest.raises(InvalidParameterException, match=told):
        enrolled(name, service)
