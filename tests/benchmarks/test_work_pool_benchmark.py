"""Forty jobs that only wait, two at a time, on two machines of a work pool; beside them a plain pool of threads."""

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from helpers.pool_machines import deployed_pool
from helpers.postgres_server import PROGRAMS

from prefect_robomaker.schemas.documents.simulation_jobs import SimulationJobDocument
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.backends.backend import open_backend
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service

JOBS, JOB_S, AT_ONCE = 40, 2.0, 2


@pytest.fixture
def settings(tmp_path: Path, request: pytest.FixtureRequest) -> Settings:
    """Of a service whose catalog is on PostgreSQL, as that of several machines has to be."""
    variables = {"ROBOMAKER_HOME": str(tmp_path / "home"), "ROBOMAKER_MAX_JOBS": str(AT_ONCE)}
    if PROGRAMS is not None:
        variables["ROBOMAKER_CATALOG_URL"] = request.getfixturevalue("postgres_database")
    return Settings.from_environment(variables)


def batch_of(order: Callable[..., dict[str, Any]]) -> dict[str, Any]:
    """A request for a batch of jobs that wait."""
    return {
        "createSimulationJobRequests": [order({"DURATION_S": str(JOB_S)}) for _ in range(JOBS)],
        "batchPolicy": {"maxConcurrency": AT_ONCE},
    }


@pytest.mark.benchmark
@pytest.mark.timeout(900)
def test_jobs_that_wait(
    service: Service, prefect_server: str, order: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    pool = deployed_pool(service.settings, prefect_server, tmp_path)
    with pool.machine("first"), pool.machine("second"):
        time.sleep(20)  # until both Prefect workers look for runs
        began = time.monotonic()
        with ThreadPoolExecutor(AT_ONCE) as threads:
            list(threads.map(time.sleep, [JOB_S] * JOBS))
        plain_s = time.monotonic() - began
        asked = batch_of(order)
        local, _ = perform(asked, service)
        there, batch = perform(asked, replace(service, backend=open_backend(f"workers:{pool.name}")))
        starts = sorted(run.start_time for run in pool.ended(batch))

    began = service.catalog.get(batch).created_at
    service.catalog.close()
    after = ", ".join(f"{(start - began).total_seconds():.1f} s" for start in starts)
    load = os.getloadavg()[0]
    print(
        f"plain pool {plain_s:.1f} s; from the first job's start to the last one's end: local {local.jobs_s:.1f} s "
        f"({local.jobs_s / plain_s:.2f}), workers {there.jobs_s:.1f} s ({there.jobs_s / plain_s:.2f}); whole batches: "
        f"{local.whole_s:.1f} s and {there.whole_s:.1f} s; flow runs began after {after}; load {load:.1f}"
    )


@pytest.mark.benchmark
@pytest.mark.timeout(900)
def test_two_machines_against_one(
    service: Service, prefect_server: str, order: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    """Each machine has one slot."""
    pool = deployed_pool(service.settings, prefect_server, tmp_path)
    elsewhere = replace(service, backend=open_backend(f"workers:{pool.name}"))
    asked = batch_of(order)
    with pool.machine("first"):
        one, batch = perform(asked, elsewhere)
        pool.ended(batch)
        with pool.machine("second"):
            time.sleep(20)  # until it looks for runs
            two, _ = perform(asked, elsewhere)
    service.catalog.close()
    print(
        f"{JOBS} jobs of {JOB_S} s: one machine {one.jobs_s:.1f} s, two {two.jobs_s:.1f} s, "
        f"{one.jobs_s / two.jobs_s:.2f} times as fast; whole batches {one.whole_s:.1f} s and {two.whole_s:.1f} s"
    )


class Took(NamedTuple):
    """How long a batch took."""

    jobs_s: float
    """From the first job's start to the last one's end."""

    whole_s: float


def perform(asked: dict[str, Any], service: Service) -> tuple[Took, str]:
    """Carries a batch out; returns how long it took, and its ARN."""
    batch = call("StartSimulationJobBatch", asked, service)["arn"]
    began = time.monotonic()
    answer = registry()["StartSimulationJobBatch"].perform(batch, service)
    whole_s = time.monotonic() - began
    assert answer["status"] == "Completed"
    jobs = service.catalog.children(batch, kind="simulation-job")
    first = min(SimulationJobDocument.of(job).last_started_at or "" for job in jobs)
    last = max(job.updated_at for job in jobs)
    return Took((last - datetime.fromisoformat(first)).total_seconds(), whole_s), batch
