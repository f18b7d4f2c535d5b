import logging
import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from helpers.processes import wait_for

from prefect_robomaker.schemas.documents.document_base import Changes
from prefect_robomaker.schemas.wire.errors import LeaseLostError, ServiceUnavailableException, StateConflictError
from prefect_robomaker.tasks.execution.leases.job_leases import Lease
from prefect_robomaker.tasks.execution.leases.leased_runs import run_if_unclaimed, run_under_lease
from prefect_robomaker.tasks.jobs.job_runs import JobRun
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service, Timing

KIND = "world-generation-job"


@pytest.fixture
def job(service: Service, template: str) -> str:
    """ARN of a job that waits to be performed."""
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}
    return call("CreateWorldGenerationJob", {"template": template, "worldCount": count}, service)["arn"]


def test_a_worker_that_was_held_up_learns_that_another_took_over(
    service: Service, job: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    service = replace(service, timing=Timing(lease_s=0.3, renew_lease_every_s=0.05))

    def unavailable(*_: object) -> bool:
        raise ServiceUnavailableException("the catalog does not answer")

    def work(lease: Lease) -> None:
        assert not lease.lost
        with monkeypatch.context() as patch:
            patch.setattr(service.catalog, "renew", unavailable)
            wait_for(lambda: service.catalog.claim(job, "another", 600), "the lease to run out")
        wait_for(lambda: lease.lost, "it to notice")
        lease.transition("start")

    with pytest.raises(LeaseLostError, match="taken over by another process"):
        run_if_unclaimed(job, KIND, service, work)

    assert service.catalog.get(job).status == "Pending"
    assert not service.catalog.claim(job, "a third", 60)


def test_a_change_that_is_refused_tells_at_once_that_another_took_over(service: Service, job: str) -> None:
    """One that was asleep, with its machine, changes the job before it next renews its lease."""
    service = replace(service, timing=Timing(lease_s=0.2, renew_lease_every_s=200.0))
    was_lost = []

    def work(lease: Lease) -> None:
        with pytest.raises(StateConflictError, match="cannot happen"):
            lease.transition("complete")
        was_lost.append(lease.lost)
        wait_for(lambda: service.catalog.claim(job, "another", 600), "the lease to run out")
        for change in (lambda: lease.transition("start"), lambda: lease.update(lambda document: Changes())):
            with pytest.raises(StateConflictError, match="another"):
                change()
            was_lost.append(lease.lost)

    run_under_lease(job, KIND, service, work)

    assert was_lost == [False, True, True]


def test_a_lease_is_kept_while_the_work_goes_on_and_given_back_after(
    service: Service, job: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    service = replace(service, timing=Timing(lease_s=600.0, renew_lease_every_s=0.01))
    catalog, renewed = service.catalog, list[tuple[bool, float]]()
    renew = catalog.renew

    def noted(arn: str, owner: str, lease_s: float) -> bool:
        renewed.append((renew(arn, owner, lease_s), lease_s))
        return renewed[-1][0]

    monkeypatch.setattr(catalog, "renew", noted)

    def work(lease: Lease) -> None:
        wait_for(lambda: len(renewed) > 2, "it to be renewed again and again")
        assert not catalog.claim(job, "another", 60)
        assert not lease.lost

    run_under_lease(job, KIND, service, work)
    assert set(renewed) == {(True, 600.0)}

    assert service.catalog.claim(job, "another", 60)


def test_a_job_that_somebody_performs_is_left_to_them(service: Service, job: str) -> None:
    worked = []
    assert service.catalog.claim(job, "another", 60)

    assert not run_if_unclaimed(job, KIND, service, worked.append)
    assert worked == []

    service.catalog.release(job, "another")
    assert run_if_unclaimed(job, KIND, service, lambda lease: worked.append(lease.transition("cancel")))
    service.catalog.transition(job, "canceled")
    assert run_if_unclaimed(job, KIND, service, worked.append)
    assert [entry.status for entry in worked] == ["Canceling"]


def test_a_lease_that_was_lost_is_said_in_one_line_and_the_end_of_the_job_is_waited_for(
    service: Service, order: Callable[..., dict[str, Any]], caplog: pytest.LogCaptureFixture
) -> None:
    """A laptop that slept, while another machine went on with its job."""
    arn = call("CreateSimulationJob", order(), service)["arn"]
    tried: list[str] = []

    def work(lease: Lease) -> None:
        tried.append("once")
        service.catalog.expire_leases("")
        assert service.catalog.claim(arn, "another machine", 60.0)
        with caplog.at_level(logging.WARNING):
            threading.Timer(0.2, others_end).start()
            JobRun(lease, service).run()

    def others_end() -> None:
        for event in ("terminate", "cancel"):
            service.catalog.transition(arn, event, owner="another machine")
        service.catalog.release(arn, "another machine")

    run_under_lease(arn, "simulation-job", service, work)

    assert tried == ["once"]
    assert service.catalog.get(arn).status == "Canceled"
    (said,) = [record for record in caplog.records if record.levelno >= logging.WARNING]
    assert said.getMessage() == f"{arn} was taken over by another process, which goes on with it; its end is waited for"
    assert said.exc_info is None
