"""A job worker that ends gives its jobs back; one that keeps dying loses them."""

import os
from collections.abc import Callable
from typing import Any

import pytest

from prefect_robomaker.schemas.operations.simulation_jobs import SimulationJobRequest
from prefect_robomaker.schemas.wire.errors import LeaseLostError
from prefect_robomaker.tasks.execution.leases.giving_up import MAX_LOST_WORKERS
from prefect_robomaker.tasks.execution.leases.held_leases import (
    HeldLeases,
    WorkerStopping,
    died_here,
    new_owner,
    owners_of,
    role_of,
)
from prefect_robomaker.tasks.execution.leases.job_leases import Lease
from prefect_robomaker.tasks.execution.leases.leased_runs import run_under_lease
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.operations.simulation_jobs import store_job
from prefect_robomaker.tasks.service.service import Service

KIND = "world-generation-job"


@pytest.fixture
def held() -> HeldLeases:
    """What a process that has just started holds: nothing."""
    return HeldLeases()


@pytest.fixture
def job(service: Service, template: str) -> str:
    """ARN of a job that waits to be performed."""
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}
    return call("CreateWorldGenerationJob", {"template": template, "worldCount": count}, service)["arn"]


def test_what_is_given_back_cannot_be_changed_any_more_and_nothing_new_begins(
    service: Service, job: str, held: HeldLeases
) -> None:
    def work(lease: Lease) -> None:
        lease.transition("start")
        assert held.give_back_all(service.catalog) == (job,)
        with pytest.raises(LeaseLostError):
            lease.transition("complete")
        lease.transition("complete")

    for _ in range(2):
        with pytest.raises(WorkerStopping):
            run_under_lease(job, KIND, service, work, held)

    assert service.catalog.get(job).status == "Running"
    assert [each.arn for each in service.catalog.unfinished([KIND])] == [job]
    assert service.catalog.lost_workers(job) == 0


def test_a_reserved_job_is_performed_under_its_reservation(service: Service, job: str, held: HeldLeases) -> None:
    assert held.reserve(job, service.catalog, 30)
    assert not held.reserve(job, service.catalog, 30)
    assert not HeldLeases().reserve(job, service.catalog, 30)
    assert service.catalog.unfinished([KIND]) == ()
    begun: list[str] = []

    run_under_lease(job, KIND, service, lambda lease: begun.append(lease.job.arn), held)
    held.cancel_reservation(job, service.catalog)

    assert begun == [job]
    assert HeldLeases().reserve(job, service.catalog, 30)
    assert service.catalog.lost_workers(job) == 0


def test_a_job_that_takes_its_worker_along_fails(service: Service, job: str, held: HeldLeases) -> None:
    for number in range(MAX_LOST_WORKERS):
        assert service.catalog.claim(job, f"{owners_of(os.getpid())}{number}", -1)
    begun: list[str] = []

    run_under_lease(job, KIND, service, lambda lease: begun.append(lease.job.arn), held)

    assert begun == []
    described = call("DescribeWorldGenerationJob", {"job": job}, service)
    assert (described["status"], described["failureCode"]) == ("Failed", "InternalServiceError")
    assert "3 job workers died" in described["failureReason"]


def test_a_batch_outlives_more_worker_and_takes_its_jobs_along_when_it_is_given_up(
    service: Service, held: HeldLeases, order: Callable[..., dict[str, Any]]
) -> None:
    kind = "simulation-job-batch"
    batch = call("StartSimulationJobBatch", {"createSimulationJobRequests": [order()]}, service)["arn"]
    job = store_job(SimulationJobRequest.model_validate(order()), service, token=None, batch=(batch, 0)).arn
    for number in range(5):
        service.catalog.claim(batch, str(number), -1)
    run_under_lease(batch, kind, service, lambda lease: lease.transition("start"), held)
    assert service.catalog.get(batch).status == "InProgress"
    for number in range(5, 10):
        service.catalog.claim(batch, str(number), -1)

    run_under_lease(batch, kind, service, lambda lease: lease.transition("drain"), held)

    assert service.catalog.get(batch).status == "Failed"
    assert service.catalog.cancel_requested(job)


def test_a_simulation_job_is_given_up_with_its_reason(
    service: Service, held: HeldLeases, order: Callable[..., dict[str, Any]]
) -> None:
    job = call("CreateSimulationJob", order(), service)["arn"]
    for number in range(MAX_LOST_WORKERS):
        service.catalog.claim(job, str(number), -1)

    run_under_lease(job, "simulation-job", service, lambda lease: lease.transition("prepare"), held)

    described = call("DescribeSimulationJob", {"job": job}, service)
    assert (described["status"], described["failureCode"]) == ("Failed", "InternalServiceError")


def test_a_job_that_is_taken_while_all_are_given_back_is_given_back_too(
    service: Service, job: str, held: HeldLeases
) -> None:
    def take(owner: str) -> str:
        assert service.catalog.claim(job, owner, 30)
        held.give_back_all(service.catalog)
        return job

    assert held.reserve_any(take, service.catalog) is None
    assert service.catalog.lease_of(job)[0] is None
    assert held.reserve_any(take, service.catalog) is None


def test_a_lease_is_ours_until_another_takes_it_also_when_it_has_run_out(
    service: Service, job: str, held: HeldLeases
) -> None:
    with held.owner_of(job) as owner:
        service.catalog.claim(job, owner, lease_s=0.0)
        assert held.are_ours(service.catalog)
        service.catalog.claim(job, "another", lease_s=60.0)
        assert not held.are_ours(service.catalog)


@pytest.mark.parametrize(
    ("main", "words", "role"),
    [
        ("prefect_robomaker.deployments.worker.__main__", ["x", "5"], "robomaker serve"),
        ("prefect_robomaker.deployments.cli.ordered_run.__main__", ["x", "5"], "a run of the console"),
        ("prefect_robomaker.deployments.cli.main", ["main.py", "run", "a.yaml"], "robomaker run"),
        ("", ["/venv/bin/robomaker", "rerun", "night-1"], "robomaker rerun"),
        ("", ["/venv/bin/robomaker"], "robomaker"),
        ("prefect.flow_engine", ["x"], "a run of a Prefect worker"),
        ("", ["night.py", "secret"], "a Python program"),
        ("", [], "a Python program"),
    ],
)
def test_an_owner_says_what_it_is(main: str, words: list[str], role: str) -> None:
    assert role_of(main, words) == role


def test_a_new_owner_is_found_by_its_process() -> None:
    assert new_owner().startswith(owners_of(os.getpid()))
    assert not died_here(new_owner())
    assert new_owner() != new_owner()
