"""Simulation jobs and the versions of the applications they run, each a real job."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.application_calls import BUCKET, Applications
from helpers.paths import BUNDLES

from prefect_robomaker.schemas.wire.errors import ResourceNotFoundException
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import pack_tar_gz

Order = Callable[..., dict[str, Any]]
Simulate = Callable[[dict[str, Any]], dict[str, Any]]
ROLES = pytest.mark.parametrize(("role", "name"), [("Robot", "watcher"), ("Simulation", "sleeper")])


@pytest.fixture
def watches_better(service: Service, tmp_path: Path) -> Callable[[], None]:
    """Replaces the archive of both applications by one whose agent says something else."""

    def replace_archive() -> None:
        shutil.copytree(
            BUNDLES / "sleeper" / "sleeper",
            tmp_path / "better" / "sleeper",
            ignore=shutil.ignore_patterns("__pycache__"),
        )
        source = tmp_path / "better" / "sleeper" / "__init__.py"
        source.write_text(source.read_text().replace('"agent watches"', '"agent watches better"'))
        pack_tar_gz(tmp_path / "better", tmp_path / "better.tar.gz")
        service.store.put_file(BUCKET, "sleeper.tar.gz", tmp_path / "better.tar.gz")

    return replace_archive


def said(service: Service, job: dict[str, Any]) -> str:
    """What the applications of a job printed."""
    outputs = service.catalog.get(job["arn"]).document["outputs"]
    return service.store.get_bytes(outputs["bucket"], f"{outputs['prefix']}/logs/stdout.log").decode()


def of_version(request: dict[str, Any], role: str, version: str) -> dict[str, Any]:
    """The request with a version of one of its applications."""
    request[f"{role.lower()}Applications"][0]["applicationVersion"] = version
    return request


def test_a_job_runs_the_version_it_names_whatever_the_application_is_by_now(
    service: Service, order: Order, simulate: Simulate
) -> None:
    request = order()
    robots = Applications.of("Robot", service)
    robots.version("watcher")
    robots.update("watcher", environment={"uri": "python://nothing.of.that.name"})

    job = simulate(of_version(request, "Robot", "1"))

    assert job["status"] == "Completed", job.get("failureReason")
    assert job["robotApplications"][0]["applicationVersion"] == "1"
    assert "agent watches" in said(service, job)


def test_latest_runs_the_archive_that_is_there(
    service: Service, order: Order, simulate: Simulate, watches_better: Callable[[], None]
) -> None:
    request = order()
    watches_better()

    job = simulate(of_version(request, "Robot", "$LATEST"))

    assert job["status"] == "Completed", job.get("failureReason")
    assert "agent watches better" in said(service, job)


@ROLES
def test_a_version_whose_archive_has_changed_fails_the_job(
    service: Service,
    order: Order,
    simulate: Simulate,
    watches_better: Callable[[], None],
    role: Any,
    name: str,
) -> None:
    request = order()
    Applications.of(role, service).version(name)
    watches_better()

    job = simulate(of_version(request, role, "1"))

    assert (job["status"], job["failureCode"]) == ("Failed", f"{role}ApplicationVersionMismatchedEtag")
    assert "s3://applications/sleeper.tar.gz has changed since the version was made" in job["failureReason"]


@ROLES
@pytest.mark.parametrize("version", ["1", None])
def test_what_is_deleted_after_the_order_fails_the_job(
    service: Service, order: Order, prefect_server: str, role: Any, name: str, version: str | None
) -> None:
    request = order()
    applications = Applications.of(role, service)
    applications.version(name)
    job = call("CreateSimulationJob", of_version(request, role, "1"), service)
    applications.delete(name, version)

    ended = registry()["CreateSimulationJob"].perform(job["arn"], service)

    assert (ended["status"], ended["failureCode"]) == ("Failed", "ResourceNotFound")


@ROLES
def test_a_version_that_is_not_there_cannot_be_ordered(service: Service, order: Order, role: Any, name: str) -> None:
    request = order()
    Applications.of(role, service).version(name)

    with pytest.raises(ResourceNotFoundException, match=r"has no version '2'; it has \$LATEST, 1$"):
        call("CreateSimulationJob", of_version(request, role, "2"), service)
    assert service.catalog.list("simulation-job").resources == ()


@ROLES
@pytest.mark.parametrize("launch", [{"command": ["/start.sh"]}, {"packageName": "p", "launchFile": "l"}, {}])
def test_a_container_image_is_accepted_and_fails_at_once_where_no_engine_works(
    service: Service,
    order: Order,
    simulate: Simulate,
    monkeypatch: pytest.MonkeyPatch,
    role: Any,
    name: str,
    launch: dict[str, Any],
) -> None:
    monkeypatch.setenv("ROBOMAKER_CONTAINER_ENGINE", "/nowhere/docker")
    request = order()
    Applications.of(role, service).create("image", environment={"uri": "registry.example.com/my-app:latest"})
    request[f"{role.lower()}Applications"][0] |= {"application": "image", "launchConfig": launch}

    job = simulate(request)

    assert (job["status"], job["failureCode"]) == ("Failed", "InvalidInput")
    assert "need docker or podman" in job["failureReason"]
    assert "/nowhere/docker is not installed" in job["failureReason"]


def test_an_application_that_became_an_image_after_the_order_is_one(
    service: Service, order: Order, simulate: Simulate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROBOMAKER_CONTAINER_ENGINE", "/nowhere/docker")
    request = order()
    Applications.of("Robot", service).update("watcher", environment={"uri": "my-app"})

    assert "need docker or podman" in simulate(request)["failureReason"]
