"""Machines that have only a catalog on PostgreSQL and an S3 server in common: clusters run batches there."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.clusters import Cluster
from helpers.machines_apart import NEEDS_NAMESPACES
from helpers.postgres_server import NEEDS_POSTGRESQL
from helpers.s3_server import S3Server

from prefect_robomaker.schemas.documents.simulation_jobs import SimulationJobDocument
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.service.service import Service

from .conftest import ONE_OF_THEM, BatchOnCluster

Order = Callable[..., dict[str, Any]]
pytestmark = [NEEDS_NAMESPACES, NEEDS_POSTGRESQL, pytest.mark.deep, pytest.mark.endurance, pytest.mark.timeout(900)]
JOBS = 4
SHORT = {"DURATION_S": "20"}


@pytest.fixture
def service(
    postgres_database: str, s3_server: S3Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Service]:
    """The laptop's; keys of the store are in the environment that all processes inherit."""
    for name, value in s3_server.environ().items():
        monkeypatch.setenv(name, value)
    home = tmp_path / "laptop"
    variables = {"ROBOMAKER_HOME": str(home), "ROBOMAKER_CATALOG_URL": postgres_database, **s3_server.environ()}
    service = Service.open(Settings.from_environment(variables), variables)
    yield service
    service.catalog.close()


def machines(batch: str, service: Service, s3: Any) -> set[str]:
    """Homes in which the jobs of a batch ran, as their outputs say."""
    found: set[str] = set()
    for job in service.catalog.children(batch, kind="simulation-job"):
        place = SimulationJobDocument.of(job).outputs
        assert place is not None
        stored = s3.get_object(Bucket=place.bucket, Key=f"{place.prefix}/provenance.json")["Body"]
        found.add(json.load(stored)["plan"]["output_dir"].partition("/jobs/")[0])
    return found


@pytest.mark.parametrize("cluster", ONE_OF_THEM, indirect=True)
def test_a_cluster_runs_a_batch_on_machines_that_are_apart(
    service: Service, order: Order, cluster: Cluster, begin: Callable[..., BatchOnCluster], s3_server: S3Server,
    tmp_path: Path,
) -> None:  # fmt: skip
    """The journey test_a_laptop_becomes_two.py shows the same on a work pool."""
    cluster.hidden = tmp_path
    cluster.add("first")
    cluster.add("second")
    batch = begin([order(SHORT) for _ in range(JOBS)], maxConcurrency=2)

    assert batch.ending.result(200)["status"] == "Completed"
    assert set(batch.statuses()) == {"Completed"}
    homes = {str(cluster.home(name)) for name in ("first", "second")}
    assert machines(batch.arn, service, s3_server.client("s3")) == homes
    assert not any(Path(home).exists() for home in homes), "what they wrote is seen nowhere else"
