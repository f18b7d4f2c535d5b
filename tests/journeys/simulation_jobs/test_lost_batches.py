"""Batches that another process takes over from one that was held up: no job that still runs is lost for it."""

import contextvars
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import pytest
from helpers.processes import wait_for

from prefect_robomaker.schemas.documents.simulation_jobs import SimulationJobDocument
from prefect_robomaker.schemas.wire.errors import ServiceUnavailableException
from prefect_robomaker.tasks.execution.leases.job_leases import Lease, LeaseLostError
from prefect_robomaker.tasks.execution.leases.leased_runs import run_if_unclaimed
from prefect_robomaker.tasks.jobs.batch_runs import BatchRun
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service, Timing

pytestmark = pytest.mark.deep

Order = Callable[..., dict[str, Any]]
KIND = "simulation-job-batch"


@contextmanager
def taken_over(service: Service, requests: list[dict[str, Any]], monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A batch whose lease another process takes while its only job runs, whose own lease is kept; its ARN."""
    mine = replace(service, timing=Timing(lease_s=2.0, renew_lease_every_s=0.1))
    batch = call("StartSimulationJobBatch", {"createSimulationJobRequests": requests}, service)["arn"]
    renew, cut = mine.catalog.renew, threading.Event()

    def held_up(arn: str, owner: str, lease_s: float) -> bool:
        if arn == batch and not cut.is_set():
            raise ServiceUnavailableException("this process slept")
        return renew(arn, owner, lease_s)

    def work(lease: Lease) -> None:
        BatchRun(lease, mine).run()

    def perform() -> None:
        with pytest.raises(LeaseLostError):
            run_if_unclaimed(batch, KIND, mine, work)

    monkeypatch.setattr(mine.catalog, "renew", held_up)
    performing = threading.Thread(target=contextvars.copy_context().run, args=[perform])
    performing.start()
    wait_for(lambda: [job.status for job in jobs(service)] == ["Running"], "the job to run")
    wait_for(lambda: service.catalog.claim(batch, "another", 600), "the batch's lease to run out")
    cut.set()  # the process is awake again, and hears that it has lost the batch
    yield batch
    performing.join(200)
    assert not performing.is_alive()


def jobs(service: Service) -> list[Any]:
    return list(service.catalog.list("simulation-job").resources)


def test_a_job_that_runs_ends_as_it_would_have(
    service: Service, order: Order, prefect_server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    request = order({"DURATION_S": "8", "VERDICT": "PASS"})
    with taken_over(service, [request], monkeypatch):
        pass
    [job] = jobs(service)
    document = SimulationJobDocument.of(job)
    assert (job.status, document.failure_code, document.verdict) == ("Completed", None, "PASS")
