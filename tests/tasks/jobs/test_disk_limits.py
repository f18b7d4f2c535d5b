"""The disk limit of whole jobs: what is fetched for them is no use of theirs."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.planning import run_plans

MB = 10**6


@pytest.mark.parametrize(
    "source",
    [pytest.param({}, marks=pytest.mark.deep), {"destination": "/home/robomaker/maps"}],
    ids=["data", "data elsewhere"],
)
def test_data_may_be_larger_than_what_the_job_may_write(
    service: Service,
    order: Callable[..., dict[str, Any]],
    monkeypatch: pytest.MonkeyPatch,
    source: dict[str, str],
) -> None:
    request = order({"DURATION_S": "0.2"})
    service.store.put_bytes("applications", "maps/flat.bin", bytes(30 * MB))
    request["dataSources"] = [{"name": "maps", "s3Bucket": "applications", "s3Keys": ["maps/flat.bin"], **source}]
    fetched_bytes: list[int] = []

    def twenty_megabytes(folder: Path, most_bytes: int) -> int:
        fetched_bytes.append(sum(path.stat().st_size for path in folder.rglob("flat.bin")))
        return 20 * MB

    monkeypatch.setattr(run_plans, "disk_limit", twenty_megabytes)

    arn = call("CreateSimulationJob", request, service)["arn"]
    perform_job(arn, service)

    job = service.catalog.get(arn)
    assert (job.status, job.document.get("failureReason")) == ("Completed", None)
    assert fetched_bytes == [30 * MB], "what is free is known when the data is there"
