"""The console without a server, and jobs in the catalog as they are after they ran."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.client_environments import node_modules
from helpers.console_visitors import browser, visitor  # noqa: F401 - fixtures

from prefect_robomaker.schemas.documents.simulation_jobs import (
    SimulationJobBatchDocument,
    SimulationJobDocument,
    StoredBatchPolicy,
)
from prefect_robomaker.schemas.documents.worlds import StoredPlace
from prefect_robomaker.tasks.files.untrusted_folders import regular_files
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import publish

StoreJob = Callable[..., str]
BATCH, JOB = "simulation-job-batch", "simulation-job"


@pytest.fixture
def store_job(service: Service, tmp_path: Any) -> StoreJob:
    """Stores a job that has ended, with outputs if files are given, and returns its id."""

    def store(
        status: str = "Completed",
        batch: str | None = None,
        tags: dict[str, str] | None = None,
        files: dict[str, bytes] | None = None,
        **members: Any,
    ) -> str:
        if files is not None:
            folder = tmp_path / f"outputs-{len(list(tmp_path.iterdir()))}"
            for name, content in files.items():
                path = folder / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
            service.store.ensure_bucket("out")
            publish(service.store, "out", folder.name, regular_files(folder), about={}, created_at=service.clock())
            members["outputs"] = StoredPlace(bucket="out", prefix=folder.name)
        document = SimulationJobDocument.model_validate({"request": {}, "seed": 3, **members})
        return service.store_job(JOB, "sim", document, tags=tags, token=None, parent=batch, status=status).id

    return store


@pytest.fixture
def store_batch(service: Service) -> Callable[..., str]:
    """Stores a batch of some requests and returns its ARN."""

    def store(requests: int, status: str = "InProgress", tags: dict[str, str] | None = None, **members: Any) -> str:
        document = SimulationJobBatchDocument(
            request={"createSimulationJobRequests": [{}] * requests},
            batch_policy=StoredBatchPolicy(timeout_in_seconds=60, max_concurrency=2),
            request_count=requests,
            **members,
        )
        return service.store_job(BATCH, "batch", document, tags=tags, token=None, status=status).arn

    return store


@pytest.fixture
def axe(pytestconfig: pytest.Config) -> str:
    """The script of axe-core, which knows the rules of accessible pages."""
    return (node_modules(pytestconfig, Path(__file__).with_name("axe")) / "axe-core" / "axe.min.js").read_text()
