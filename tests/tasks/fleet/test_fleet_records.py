"""Who may change a fleet, and what a change that broke off leaves to the next."""

import pytest
from helpers.fleet_calls import Fleets

from prefect_robomaker.schemas.wire.errors import (
    InvalidParameterException,
    ResourceNotFoundException,
    ThrottlingException,
)
from prefect_robomaker.tasks.fleet import fleet_records
from prefect_robomaker.tasks.fleet.fleet_records import fleet_held, last_deployment, robots_of
from prefect_robomaker.tasks.service.service import Service


@pytest.fixture
def fleets(service: Service) -> Fleets:
    return Fleets(service)


def test_a_change_waits_for_the_one_before(fleets: Fleets, service: Service) -> None:
    yard, rover = fleets.fleet(), fleets.robot()
    assert service.catalog.claim(yard, "another process", 0.3)

    fleets.register(yard, rover)

    assert fleets.members(yard) == ["rover"]
    assert service.catalog.claim(yard, "the next", 1)  # it was given back


def test_a_fleet_that_others_keep_is_to_be_asked_for_again(
    fleets: Fleets, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fleet_records, "PATIENCE_S", 0.05)
    yard, rover = fleets.fleet(), fleets.robot()
    service.catalog.claim(yard, "another process", 60)

    with pytest.raises(ThrottlingException, match="being changed by others; try again"):
        fleets.register(yard, rover)
    with pytest.raises(ThrottlingException):
        fleets.call("DeleteFleet", fleet=yard)

    assert fleets.described(rover)["status"] == "Available"


def test_the_lease_is_given_back_after_a_refusal(fleets: Fleets, service: Service) -> None:
    yard = fleets.fleet()

    with pytest.raises(RuntimeError), fleet_held(yard, service):
        raise RuntimeError

    with fleet_held(yard, service) as fleet:
        assert (fleet.arn, fleet.name) == (yard, "yard")


def test_only_fleets_that_exist_are_held(fleets: Fleets, service: Service) -> None:
    rover = fleets.robot()

    with pytest.raises(InvalidParameterException, match="deployment-fleet"), fleet_held(rover, service):
        pass
    with pytest.raises(ResourceNotFoundException), fleet_held(service.arn("deployment-fleet", "none/1"), service):
        pass


def test_a_change_that_broke_off_is_finished_by_the_next(
    fleets: Fleets, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    yard, application = fleets.fleet(), fleets.application()
    for name in ("rover", "crane"):
        fleets.robot(name, yard)

    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("prefect_robomaker.tasks.fleet.operations.deployment_jobs.settle", killed)
        with pytest.raises(KeyboardInterrupt):
            fleets.deploy(yard, application)
    job = last_deployment(yard, service)
    assert job is not None
    assert [robot.status for robot in robots_of(yard, service)] == ["Registered", "Registered"]

    fleets.robot("truck", yard)
    fleets.cancel(job.arn)

    assert fleets.described(yard)["lastDeploymentJob"] == job.arn
    assert {robot.status for robot in robots_of(yard, service)} == {"Registered"}


def test_the_robots_of_a_fleet_are_found_over_many_pages(fleets: Fleets, service: Service) -> None:
    yard, namesake = fleets.fleet("yard"), fleets.fleet("yard")
    for number in range(7):
        fleets.robot(f"robot-{number}", namesake if number % 3 == 1 else yard)

    found = robots_of(yard, service, page=2)

    assert [robot.name for robot in found] == ["robot-6", "robot-5", "robot-3", "robot-2", "robot-0"]
