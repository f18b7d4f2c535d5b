"""Export jobs: what they leave, and how they end when something is missing."""

import contextvars
import json
import threading
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import pytest
from helpers.processes import wait_for
from helpers.small_flat import ROLE

from prefect_robomaker.schemas.wire.errors import InvalidParameterException, ResourceNotFoundException, StorageError
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.worlds import export_packing as world_export

pytestmark = pytest.mark.usefixtures("known_worlds")
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
        archive.extractall(tmp_path / "exported")
    models = sorted((tmp_path / "exported").rglob("world.xml"))
    assert len(models) == len(worlds)
    for path in models:
        # Compiles only where its pictures came along from the generator through the store.
        model = mujoco.MjModel.from_xml_path(str(path))
        names = json.loads((path.parent / "names.json").read_text())
        pictures = {names.get(model.tex(index).name, model.tex(index).name) for index in range(model.ntex)}
        assert pictures == {picture.stem for picture in (path.parent / "textures").iterdir()}
        assert any(name.startswith("floor_") for name in pictures)
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
def test_a_cancelled_job_ends_also_when_its_worker_died_over_it(
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


def described(arn: str, service: Service) -> dict[str, Any]:
    return call("DescribeWorldExportJob", {"job": arn}, service)


def listed(service: Service, **filters: str) -> list[str]:
    given = {"filters": [{"name": name, "values": [value]} for name, value in filters.items()]} if filters else {}
    return [job["arn"] for job in call("ListWorldExportJobs", given, service)["worldExportJobSummaries"]]


def test_jobs_are_listed_by_what_their_worlds_came_from(
    service: Service, template: str, generate: Callable[..., dict[str, Any]], ghost: str
) -> None:
    generations = [generate(), generate()]
    first, second = (job["finishedWorldsSummary"]["succeededWorlds"][0] for job in generations)
    other, one, both = (
        call("CreateWorldExportJob", order(*worlds), service)["arn"] for worlds in ([ghost], [first], [first, second])
    )
    call("CancelWorldExportJob", {"job": other}, service)

    assert listed(service) == [both, one, other]
    assert listed(service, status="Pending") == [both, one]
    assert listed(service, status="Canceled") == [other]
    assert listed(service, templateId=template.split("/")[1]) == [both, one]
    assert listed(service, generationJobId=generations[0]["arn"].split("/")[1]) == [both, one]
    assert listed(service, generationJobId=generations[1]["arn"].split("/")[1]) == [both]
    summary = call("ListWorldExportJobs", {"maxResults": 1}, service)["worldExportJobSummaries"][0]
    job = described(both, service)
    assert summary == {member: job[member] for member in ("arn", "status", "createdAt", "worlds", "outputLocation")}
    with pytest.raises(InvalidParameterException, match=r"worlds.*generationJobId"):
        listed(service, worlds="world-1")


def test_a_job_without_a_job_worker_is_cancelled_at_once(service: Service, ghost: str) -> None:
    job = call("CreateWorldExportJob", order(ghost), service)

    for _ in range(2):
        assert call("CancelWorldExportJob", {"job": job["arn"]}, service) == {}
        assert described(job["arn"], service)["status"] == "Canceled"


@pytest.mark.parametrize(
    "moment",
    ["packing", pytest.param("storing", marks=pytest.mark.deep), pytest.param("stored", marks=pytest.mark.deep)],
)
def test_a_running_job_that_is_cancelled_leaves_no_archive(
    service: Service,
    generate: Callable[..., dict[str, Any]],
    prefect_server: str,
    moment: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    worlds = generate(2)["finishedWorldsSummary"]["succeededWorlds"]
    job = call("CreateWorldExportJob", order(*worlds), service)["arn"]
    reached, goes_on = threading.Event(), threading.Event()

    def hold() -> None:
        reached.set()
        assert goes_on.wait(200)

    put_file, archive = service.store.put_file, world_export.world_bundle

    def put(bucket: str, key: str, path: Path, *, stopped: Callable[[], bool]) -> Any:
        if moment == "storing":
            hold()
        info = put_file(bucket, key, path, stopped=stopped)
        if moment == "stored":
            hold()
        return info

    def pack(world: Resource, where: Service) -> Path:
        if moment == "packing":
            hold()
        return archive(world, where)

    monkeypatch.setattr(service.store, "put_file", put)
    monkeypatch.setattr(world_export, "world_bundle", pack)
    perform = registry()["CreateWorldExportJob"].perform
    # Prefect finds its server by the context.
    worker = threading.Thread(target=contextvars.copy_context().run, args=(perform, job, service))
    worker.start()
    assert reached.wait(200)

    call("CancelWorldExportJob", {"job": job}, service)
    at_once = described(job, service)["status"]
    goes_on.set()
    wait_for(lambda: described(job, service)["status"] == "Canceled", "the end")
    worker.join(200)
    assert not worker.is_alive()

    assert at_once == "Canceling"
    assert [info.key for info in service.store.list("exports")] == []
    assert list(service.folder("scratch").iterdir()) == []


def test_the_archive_of_a_worker_that_died_over_a_cancelled_job_is_removed(
    service: Service, ghost: str, prefect_server: str
) -> None:
    job = call("CreateWorldExportJob", order(ghost), service)["arn"]
    service.catalog.transition(job, "start", document_changes={"started": True})
    service.store.ensure_bucket("exports")
    key = f"aws-robomaker-worldforge-export-{job.split('/export-')[1]}.zip"
    service.store.put_bytes("exports", key, b"an archive")

    call("CancelWorldExportJob", {"job": job}, service)

    assert described(job, service)["status"] == "Canceled"
    assert [info.key for info in service.store.list("exports")] == []


def test_cancelling_what_has_ended_changes_nothing(service: Service, generate: Callable[..., dict[str, Any]]) -> None:
    job = perform(order(*generate()["finishedWorldsSummary"]["succeededWorlds"]), service)

    assert call("CancelWorldExportJob", {"job": job["arn"]}, service) == {}

    assert described(job["arn"], service) == job
    assert len(list(service.store.list("exports"))) == 1
    with pytest.raises(ResourceNotFoundException, match="export-none"):
        call("CancelWorldExportJob", {"job": service.arn("world-export-job", "export-none")}, service)


def test_a_deleted_world_fails_its_own_exports_only(
    service: Service, generate: Callable[..., dict[str, Any]], prefect_server: str
) -> None:
    gone, kept = generate(2)["finishedWorldsSummary"]["succeededWorlds"]
    doomed = call("CreateWorldExportJob", order(gone), service)
    fine = call("CreateWorldExportJob", order(kept), service)
    call("BatchDeleteWorlds", {"worlds": [gone]}, service)

    ended = [registry()["CreateWorldExportJob"].perform(job["arn"], service) for job in (doomed, fine)]

    assert [job["status"] for job in ended] == ["Failed", "Completed"]
    assert ended[0]["failureCode"] == "ResourceNotFound"
    assert gone in ended[0]["failureReason"]
