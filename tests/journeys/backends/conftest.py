"""Batches on clusters of real processes; only catalog and object store are common to their machines."""

import contextvars
import json
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from helpers.clusters import Cluster, cluster_of
from helpers.processes import wait_for

from prefect_robomaker.schemas.documents.simulation_jobs import SimulationJobDocument
from prefect_robomaker.tasks.backends.backend import open_backend
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service

ONE_OF_THEM = [pytest.param("dask", marks=pytest.mark.deep), pytest.param("ray", marks=pytest.mark.endurance)]
"""Of tests about what is the same on all clusters."""


@dataclass
class BatchOnCluster:
    """A batch that is being carried out."""

    arn: str
    service: Service
    ending: "Future[dict[str, Any]]"

    @property
    def description(self) -> dict[str, Any]:
        """What the service says of it."""
        return call("DescribeSimulationJobBatch", {"batch": self.arn}, self.service)

    def statuses(self) -> list[str]:
        """Statuses of its jobs."""
        return [job["status"] for job in self.description.get("createdRequests", [])]

    def await_running(self, count: int) -> None:
        """Waits until exactly as many jobs run."""
        wait_for(lambda: self.statuses().count("Running") == count, f"{count} jobs to run: {self.statuses()}", 120)

    def machines(self) -> list[str]:
        """The machine of each job that has ended, by its home."""
        homes = []
        for job in self.service.catalog.children(self.arn, kind="simulation-job"):
            if place := SimulationJobDocument.of(job).outputs:
                path = self.service.store.local_path(place.bucket, f"{place.prefix}/provenance.json")
                assert path is not None
                output = Path(json.loads(Path(path).read_text())["plan"]["output_dir"])
                homes.append(output.parents[3].name)  # HOME/jobs/JOB/RUN/output
        return homes


@pytest.fixture
def cluster(request: pytest.FixtureRequest, service: Service, tmp_path: Path) -> Iterator[Cluster]:
    """A cluster without machines; its kind is the fixture's parameter."""
    variables = {
        "ROBOMAKER_CATALOG_URL": service.settings.catalog_url,
        "ROBOMAKER_OBJECT_STORE": service.settings.object_store,
        "ROBOMAKER_MAX_JOBS": "1",
    }
    with cluster_of(request.param, tmp_path / "cluster", variables) as processes:
        yield processes


@pytest.fixture
def begin(service: Service, prefect_server: str, cluster: Cluster) -> Iterator[Callable[..., BatchOnCluster]]:
    """Begins batches on the cluster; those that have not ended by the end of the test are cancelled."""
    begun = []
    with ThreadPoolExecutor(2) as pool:

        def run(requests: list[dict[str, Any]], **policy: Any) -> BatchOnCluster:
            request = {"createSimulationJobRequests": requests, "batchPolicy": policy}
            arn = call("StartSimulationJobBatch", request, service)["arn"]
            there = replace(service, backend=open_backend(cluster.backend))
            perform = registry()["StartSimulationJobBatch"].perform
            ending = pool.submit(contextvars.copy_context().run, perform, arn, there)  # with Prefect's settings
            begun.append(BatchOnCluster(arn, service, ending))
            return begun[-1]

        try:
            yield run
        finally:
            for batch in begun:
                if not batch.ending.done():
                    call("CancelSimulationJobBatch", {"batch": batch.arn}, service)
