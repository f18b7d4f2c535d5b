"""A job that its process orders for itself is nobody else's, from the transaction that stores it until its end."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers.paths import BUNDLES
from helpers.processes import wait_for
from helpers.small_flat import ROLE

from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.execution.leases.held_leases import HeldLeases
from prefect_robomaker.tasks.execution.leases.leased_runs import run_if_unclaimed
from prefect_robomaker.tasks.jobs.job_owners import (
    OwnOrder,
    environment_needed,
    left_jobs,
    needs_elsewhere,
    standing_of,
    standings_of,
)
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service, Timing

KIND = "simulation-job"
SUITE = {"name": "General"}
Order = Callable[..., dict[str, Any]]


@pytest.fixture
def held() -> HeldLeases:
    """The leases of a process that has just started: none."""
    return HeldLeases()


def ordered(own: OwnOrder, request: dict[str, Any], service: Service) -> str:
    arn = registry()["CreateSimulationJob"].ordered(request, own.through, service)["arn"]
    own.keep(arn)
    return arn


def test_nobody_takes_it_before_it_is_carried_out_or_meanwhile(
    service: Service, order: Order, held: HeldLeases, monkeypatch: pytest.MonkeyPatch
) -> None:
    service = replace(service, timing=Timing(lease_s=600.0, renew_lease_every_s=0.01))
    begun, renewed, renew = list[str](), list[bool](), service.catalog.renew

    def noted(arn: str, owner: str, lease_s: float) -> bool:
        renewed.append(renew(arn, owner, lease_s))
        return renewed[-1]

    monkeypatch.setattr(service.catalog, "renew", noted)
    with OwnOrder(service, held) as own:
        arn = registry()["CreateSimulationJob"].ordered(order(), own.through, service)["arn"]
        assert service.catalog.unfinished([KIND]) == ()
        own.keep(arn)
        wait_for(lambda: len(renewed) > 2, "it to be renewed again and again")
        assert set(renewed) == {True}
        assert not service.catalog.claim(arn, "another", 600)
        run_if_unclaimed(arn, KIND, service, lambda lease: begun.append(lease.job.arn), held)

    assert begun == [arn]
    assert service.catalog.lease_of(arn)[0] is None
    assert service.catalog.lost_workers(arn) == 0


def test_an_order_that_is_never_begun_is_given_back(service: Service, order: Order, held: HeldLeases) -> None:
    with OwnOrder(service, held) as own:
        arn = ordered(own, order(), service)

    standing = standing_of(service.catalog.get(arn), service)
    assert standing is not None
    assert (standing.state, standing.owner.process_id) == ("left", os.getpid())
    assert [job.arn for job, _ in left_jobs(service)] == [arn]
    assert [job.arn for job in service.catalog.unfinished([KIND])] == [arn]


@pytest.mark.parametrize(("error", "is_cancelled"), [(KeyboardInterrupt, True), (RuntimeError, False)])
def test_an_order_that_is_interrupted_before_it_begins_is_cancelled(
    service: Service, order: Order, held: HeldLeases, error: type[BaseException], is_cancelled: bool
) -> None:
    own = OwnOrder(service, held)
    arn = ordered(own, order(), service)
    with pytest.raises(error), own:
        raise error

    assert service.catalog.cancel_requested(arn) == is_cancelled
    assert service.catalog.lease_of(arn)[0] is None


def test_an_equal_order_of_another_stays_his(service: Service, order: Order, held: HeldLeases) -> None:
    request = order(clientRequestToken="once")
    others = HeldLeases()
    with OwnOrder(service, others) as first:
        arn = ordered(first, request, service)
        owner = service.catalog.lease_of(arn)[0]
        with OwnOrder(service, held) as second:
            assert ordered(second, request, service) == arn
            assert not run_if_unclaimed(arn, KIND, service, lambda lease: None, held)
        assert service.catalog.lease_of(arn)[0] == owner


def test_what_another_thread_of_the_process_carries_out_stays_its(
    service: Service, order: Order, held: HeldLeases
) -> None:
    arn = call("CreateSimulationJob", order(), service)["arn"]
    with held.owner_of(arn) as owner:
        assert service.catalog.claim(arn, owner, 600)
        with OwnOrder(service, held) as own:
            own.keep(arn)
        assert service.catalog.lease_of(arn)[0] == owner

    held.give_back_all(service.catalog)
    assert not held.adopt(arn, "a process that ends")


def test_parts_of_a_batch_are_no_orders(service: Service, order: Order, held: HeldLeases) -> None:
    requests = {"createSimulationJobRequests": [order()]}
    with OwnOrder(service, held) as own:
        batch = registry()["StartSimulationJobBatch"].ordered(requests, own.through, service)["arn"]

    assert service.first_lease is None
    assert [job.arn for job in service.catalog.ordered_for_oneself()] == [batch]


def test_an_order_that_has_ended_when_it_is_stored_is_held_by_no_process(service: Service, held: HeldLeases) -> None:
    with OwnOrder(service, held) as own:
        through = own.through("CreateSimulationJob", {})
        job = through.store_job(KIND, "sim", {}, tags=None, token=None, status="Completed")

    assert service.catalog.lease_of(job.arn)[0] is None
    assert standing_of(job, service) is None


def test_a_job_of_a_client_needs_nothing(service: Service, order: Order) -> None:
    job = service.catalog.get(call("CreateSimulationJob", order(), service)["arn"])

    assert standing_of(job, service) is None
    assert needs_elsewhere(service.catalog.ownerships([job.arn])[job.arn].needed_environment, service) == []
    assert left_jobs(service) == []


@pytest.fixture
def imported(service: Service, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """A request whose applications lie on PYTHONPATH."""
    monkeypatch.setenv("PYTHONPATH", str(BUNDLES / "sleeper"))
    monkeypatch.syspath_prepend(str(BUNDLES / "sleeper"))
    suites = {"robotSoftwareSuite": SUITE, "environment": {"uri": "python://sleeper"}}
    call("CreateRobotApplication", {"name": "mine", **suites}, service)
    robot = {"application": "mine", "launchConfig": {"launchFile": "make_agent"}}
    return {"maxJobDurationInSeconds": 60, "iamRole": ROLE, "robotApplications": [robot]}


def test_what_a_job_needs_of_its_environment(service: Service, imported: dict[str, Any], order: Order) -> None:
    batch = {"createSimulationJobRequests": [imported, imported]}
    needed = environment_needed("StartSimulationJobBatch", batch, service)
    assert needed.python_path == (str(BUNDLES / "sleeper"),)
    assert list(needed.packages) == ["sleeper"]
    assert needed.variables["ROBOMAKER_BACKEND"] == "local"
    assert needed.variables["ROBOMAKER_ROLES_FILE"] == ""

    # What is built in, and worlds, need no import path; archives bring their code and may import more.
    scout = {"robotApplications": [{"application": "scout", "launchConfig": {}}]}
    built_in = environment_needed("CreateSimulationJob", scout, service)
    assert (built_in.python_path, built_in.packages) == (None, {})
    assert "ROBOMAKER_ROLES_FILE" not in built_in.variables
    assert environment_needed("CreateSimulationJob", order(), service).python_path == needed.python_path
    worlds = environment_needed("CreateWorldGenerationJob", {}, service)
    assert worlds.variables == {"ROBOMAKER_MAX_WORLDS_PER_JOB": "50"}
    nothing = {"robotApplications": [{"application": "nobody", "launchConfig": {}}]}
    assert environment_needed("CreateSimulationJob", nothing, service).packages == {}


@pytest.mark.parametrize(
    ("variables", "changed", "difference"),
    [
        ({}, {}, ""),
        ({"ROBOMAKER_MAX_JOBS": "1"}, {"max_jobs": 1}, ""),
        ({}, {"nice": 4}, "ROBOMAKER_NICE is 4, not 0"),
        ({}, {"sandbox": "off"}, "ROBOMAKER_SANDBOX is off, not auto"),
        ({}, {"sandbox_show": (Path("/a"), Path("/b"))}, "ROBOMAKER_SANDBOX_SHOW is /a:/b, not unset"),
        ({"MENAGERIE_ROOT": "/m"}, {}, "MENAGERIE_ROOT is /m, not unset"),
        ({"PYTHONPATH": ""}, {}, f"PYTHONPATH is not set, not {BUNDLES / 'sleeper'}"),
    ],
)
def test_another_process_compares(
    service: Service,
    imported: dict[str, Any],
    held: HeldLeases,
    monkeypatch: pytest.MonkeyPatch,
    variables: dict[str, str],
    changed: dict[str, Any],
    difference: str,
) -> None:
    with OwnOrder(service, held) as own:
        job: Resource = service.catalog.get(ordered(own, imported, service))
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    other = replace(service, settings=Settings.model_validate({**dict(service.settings), **changed}))
    needed = other.catalog.ownerships([job.arn])[job.arn].needed_environment

    assert needs_elsewhere(needed, other) == ([difference] if difference else [])
    standing = standings_of([job], other)[job.arn]
    assert standing.waits_for_command == bool(difference)
    assert str(standing.command).endswith(f"robomaker perform {job.arn}")
