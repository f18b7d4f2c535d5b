"""Jobs of a chaotic pendulum: quick, repeatable to the bit, and made to fail, drift or last on demand."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from helpers.paths import BUNDLES
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import pack_tar_gz

ROLE = "arn:aws:iam::000000000000:role/test"
SWINGER = BUNDLES / "swinger"
SUITE = {"name": "General"}
Simulate = Callable[..., dict[str, Any]]


def upload_swinger(service: Service, tmp_path: Path, more: bytes = b"") -> None:
    bundle = shutil.copytree(SWINGER, tmp_path / "bundle", ignore=shutil.ignore_patterns("__pycache__"))
    (bundle / "swinger" / "weights.bin").write_bytes(more)
    pack_tar_gz(bundle, tmp_path / "swinger.tar.gz")
    shutil.rmtree(bundle)
    service.store.ensure_bucket("applications")
    service.store.put_file("applications", "swinger.tar.gz", tmp_path / "swinger.tar.gz")


def forget_archives(service: Service) -> None:
    """Removes the archives that were kept for reruns, and the unpacked ones on this machine."""
    for kept in list(service.store.list(service.settings.bucket, "kept-archives/")):
        service.store.delete(kept.bucket, kept.key)
    shutil.rmtree(service.settings.home / "cache" / "applications")


@pytest.fixture
def swing(service: Service, tmp_path: Path) -> Simulate:
    """Orders a job of the swinging pendulum, runs it to its end, and returns its description.

    `simulation` and `robot` change what is ordered of either application, `job` what is ordered of the job.
    """
    upload_swinger(service, tmp_path)
    source = [{"s3Bucket": "applications", "s3Key": "swinger.tar.gz"}]
    call("CreateRobotApplication", {"name": "pusher", "sources": source, "robotSoftwareSuite": SUITE}, service)
    runtime = {"name": "SimulationRuntime"}
    request = {"name": "swing", "sources": source, "robotSoftwareSuite": SUITE, "simulationSoftwareSuite": runtime}
    call("CreateSimulationApplication", request, service)

    def run(
        duration_s: int = 60,
        seed: int = 3,
        perform: bool = True,
        simulation: dict[str, Any] | None = None,
        robot: dict[str, Any] | None = None,
        job: dict[str, Any] | None = None,
        **variables: str,
    ) -> dict[str, Any]:
        launch = {"packageName": "swinger", "launchFile": "make_environment", "environmentVariables": variables}
        push = {"packageName": "swinger", "launchFile": "make_agent"}
        request = {
            "maxJobDurationInSeconds": duration_s,
            "iamRole": ROLE,
            "seed": seed,
            "simulationApplications": [{"application": "swing", "launchConfig": launch, **(simulation or {})}],
            "robotApplications": [{"application": "pusher", "launchConfig": push, **(robot or {})}],
            **(job or {}),
        }
        arn = call("CreateSimulationJob", request, service)["arn"]
        if perform:
            perform_job(arn, service)
        return call("DescribeSimulationJob", {"job": arn}, service)

    return run


def outputs_of(service: Service, job: dict[str, Any]) -> Path:
    place = service.catalog.get(job["arn"]).document["outputs"]
    path = service.store.local_path(place["bucket"], f"{place['prefix']}/provenance.json")
    assert path is not None
    return Path(path).parent
