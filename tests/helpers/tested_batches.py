"""Simulation job batches in the catalog, as they are after they ran: no simulation runs for them."""

from dataclasses import dataclass, field
from typing import Any

from helpers.fleet_calls import Fleets
from prefect_robomaker.schemas.documents.simulation_jobs import (
    FailedRequest,
    MadeOf,
    SimulationJobBatchDocument,
    SimulationJobDocument,
    StoredBatchPolicy,
)
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.planning.applications import find_application

WORLD = "arn:aws:robomaker:us-west-2:000000000000:world/generation-1/world-1"


def courier(service: Service, **architectures: str | None) -> Resource:
    """Version 1 of an application with an archive for each architecture, by key; `None`: for any."""
    fleets = Fleets(service)
    service.store.ensure_bucket("apps")
    sources = []
    for key, architecture in (architectures or {"any": None}).items():
        service.store.put_bytes("apps", key, f"archive {key}".encode())
        source = {"s3Bucket": "apps", "s3Key": key}
        sources.append(source if architecture is None else {**source, "architecture": architecture})
    fleets.application("courier", sources=sources)
    return find_application("courier", "robot", "1", service)


def etag(service: Service, key: str = "any") -> str:
    return service.store.head("apps", key).etag


@dataclass
class Batches:
    """Stores batches that tested an archive of an application."""

    service: Service
    etag: str
    requirement: str = "arrives"
    application: str = "courier"
    stored: list[str] = field(default_factory=list)

    def batch(self, *jobs: dict[str, Any], status: str = "Completed", **members: Any) -> str:
        """Stores a batch with jobs, one that passed if none is given, and returns its ARN."""
        return self.of(*(jobs or ({},)), status=status, **members)

    def of(self, *jobs: dict[str, Any], status: str = "Completed", failed: int = 0, missing: int = 0) -> str:
        """Stores a batch with exactly these jobs; `failed` and `missing` requests have no jobs."""
        requests = [self._request() for _ in range(len(jobs) + failed + missing)]
        why = FailedRequest(failure_code="ResourceNotFound", failure_reason="no such world", failed_at="2026-01-02")
        document = SimulationJobBatchDocument(
            request={"createSimulationJobRequests": requests},
            batch_policy=StoredBatchPolicy(timeout_in_seconds=60, max_concurrency=2),
            request_count=len(requests),
            failed={str(len(jobs) + number): why for number in range(failed)},
        )
        batch = self.service.store_job("simulation-job-batch", "batch", document, tags=None, token=None, status=status)
        for index, job in enumerate(jobs):
            self.stored.append(self.job(batch.arn, **{"request_index": index, **job}))
        return batch.arn

    def job(self, batch: str, status: str = "Completed", request_index: int = 0, **members: Any) -> str:
        """Stores a job of a batch that passed, unless `members` of its document say otherwise; returns its id."""
        passed = {
            "request": self._request(),
            "request_index": request_index,
            "seed": request_index,
            "verdict": "PASS",
            "requirements": [{"kind": "time_limit", "name": self.requirement, "limit_s": 9.0}],
            "made_of": MadeOf(robot=f"archive {self.etag}"),
        }
        document = SimulationJobDocument.model_validate({**passed, **members})
        return self.service.store_job(
            "simulation-job", "sim", document, tags=None, token=None, parent=batch, status=status
        ).id

    def _request(self) -> dict[str, Any]:
        return {
            "robotApplications": [{"application": self.application, "launchConfig": {}}],
            "simulationApplications": [
                {"application": "arena", "launchConfig": {}, "worldConfigs": [{"world": WORLD}]}
            ],
        }
