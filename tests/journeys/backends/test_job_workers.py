"""Batches whose jobs run in job workers with homes of their own; only catalog and object store are common."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers.job_worker_backend import HomesBackend

from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service

Order = Callable[..., dict[str, Any]]


@pytest.fixture
def homes(service: Service, tmp_path: Path) -> HomesBackend:
    """Two machines with room for one job each."""
    variables = {
        "ROBOMAKER_CATALOG_URL": service.settings.catalog_url,
        "ROBOMAKER_OBJECT_STORE": service.settings.object_store,
        "ROBOMAKER_MAX_JOBS": "1",
    }
    return HomesBackend([tmp_path / "first", tmp_path / "second"], variables)


@pytest.fixture
def run_batch(service: Service, prefect_server: str, homes: HomesBackend) -> Callable[..., dict[str, Any]]:
    """Runs a batch on the homes and returns its description."""

    def run(requests: list[dict[str, Any]], notes: list[str], **policy: Any) -> dict[str, Any]:
        request = {"createSimulationJobRequests": requests, "batchPolicy": policy}
        batch = call("StartSimulationJobBatch", request, service)
        watched = replace(service, backend=homes, report_note=notes.append)
        return registry()["StartSimulationJobBatch"].perform(batch["arn"], watched)

    return run


def counts(homes: HomesBackend) -> list[int]:
    """How many jobs each worker says it ran."""
    return [int(re.search(r"ran (\d+) jobs?", ended.last_words)[1]) for ended in homes.ended]  # type: ignore[index]


def test_jobs_of_a_batch_run_on_both_machines_and_nothing_of_it_here(
    service: Service, order: Order, homes: HomesBackend, run_batch: Callable[..., dict[str, Any]]
) -> None:
    notes: list[str] = []

    batch = run_batch([order({"DURATION_S": "1"}) for _ in range(6)], notes, maxConcurrency=2)

    assert batch["status"] == "Completed"
    assert [job["status"] for job in batch["createdRequests"]] == ["Completed"] * 6
    assert [ended.exit_code for ended in homes.ended] == [0, 0], homes.ended
    assert sum(counts(homes)) == 6
    assert all(counts(homes))
    assert any("2 job workers on this machine" in note for note in notes)
