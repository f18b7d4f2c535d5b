"""Export jobs: what they leave, and how they end when something is missing."""

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from small_flat import ROLE

from prefect_robomaker.flows.operation import call, registry
from prefect_robomaker.schemas.errors import InvalidParameterException, ResourceNotFoundException, StorageError
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.service import Service

MISSING = {"bucket": "nowhere", "prefix": "worlds/none"}


@pytest.fixture
def ghost(service: Service) -> str:
    """ARN of a world whose bundle is gone."""
    arn = service.arn("world", "generation-000000000000/world-1")
    world = Resource.new(arn=arn, kind="world", id="generation-000000000000/world-1", document={"bundle": MISSING})
    service.catalog.create(world, token=None)
    return arn


def order(*worlds: str, **location: str) -> dict[str, Any]:
    return {"worlds": list(worlds), "outputLocation": {"s3Bucket": "exports", **location}, "iamRole": ROLE}


def perform(request: dict[str, Any], service: Service) -> dict[str, Any]:
    job = call("CreateWorldExportJob", request, service)
    return registry()["CreateWorldExportJob"].perform(job["arn"], service)


def test_worlds_are_packed_where_clients_look(
    service: Service, generate: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    generated = generate()
    worlds = generated["finishedWorldsSummary"]["succeededWorlds"]

    # A released client uses the generation job's ARN as prefix.
    job = perform(order(*worlds, s3Prefix=generated["arn"]), service)

    assert job["status"] == "Completed"
    assert job["worlds"] == worlds
    number = job["arn"].split("/export-")[1]
    key = f"{generated['arn']}/aws-robomaker-worldforge-export-{number}.zip"
    service.store.get_file("exports", key, tmp_path / "export.zip")
    with zipfile.ZipFile(tmp_path / "export.zip") as archive:
        assert archive.testzip() is None
        assert any(name.endswith("world.xml") for name in archive.namelist())
    assert list(service.folder("scratch").iterdir()) == []


def test_a_bundle_that_is_gone_fails_the_job(service: Service, ghost: str, prefect_server: str) -> None:
    job = perform(order(ghost), service)

    assert (job["status"], job["failureCode"]) == ("Failed", "ResourceNotFound")
    assert "nowhere" in job["failureReason"]


@pytest.mark.parametrize("fault", [StorageError("the endpoint does not answer"), OSError(28, "No space left")])
def test_what_is_our_fault_is_called_so(
    service: Service, ghost: str, prefect_server: str, fault: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    def break_down(*arguments: object) -> bytes:
        raise fault

    monkeypatch.setattr(service.store, "get_bytes", break_down)

    job = perform(order(ghost), service)

    assert (job["status"], job["failureCode"]) == ("Failed", "InternalServiceError")
    assert str(fault) in job["failureReason"]


@pytest.mark.parametrize("interrupted", [False, True])
def test_a_cancelled_job_ends_also_when_its_performer_died_over_it(
    service: Service, ghost: str, prefect_server: str, interrupted: bool
) -> None:
    job = call("CreateWorldExportJob", order(ghost), service)
    service.catalog.request_cancel(job["arn"])
    if interrupted:
        service.catalog.transition(job["arn"], "cancel")

    assert registry()["CreateWorldExportJob"].perform(job["arn"], service)["status"] == "Canceled"


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"outputLocation": {"s3Prefix": "a"}}, InvalidParameterException, r"outputLocation\.s3Bucket"),
        ({"outputLocation": {"s3Bucket": "exports", "s3Prefix": "a//b"}}, InvalidParameterException, "a//b"),
        ({"worlds": ["arn:aws:robomaker:us-east-1:000000000000:world/none"]}, ResourceNotFoundException, "none"),
    ],
)
def test_an_order_that_cannot_be_met_is_refused_and_nothing_is_stored(
    service: Service, ghost: str, change: dict[str, Any], error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        call("CreateWorldExportJob", {**order(ghost), **change}, service)
    assert service.catalog.list("world-export-job").resources == ()
