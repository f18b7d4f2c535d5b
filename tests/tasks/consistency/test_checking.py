"""Catalog against object store: nothing is found of what is whole, and everything that is broken is, on both kinds."""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from helpers.s3_server import S3Server
from helpers.small_flat import ROLE

from prefect_robomaker.schemas.documents.simulation_jobs import SimulationJobDocument
from prefect_robomaker.schemas.documents.worlds import StoredPlace
from prefect_robomaker.schemas.reports.retention import ConsistencyReport, Problem
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.errors import StorageUnavailableError
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.consistency.checking import UNFINISHED_AFTER, check_consistency
from prefect_robomaker.tasks.files.untrusted_folders import regular_files
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import publish, read_manifest, thin

FILES = {"result.json": b"{}", "recording.mcap": b"x" * 1000, "logs/a.log": b"said"}
Job = Callable[..., Resource]
ALSO_ON_S3 = pytest.mark.parametrize(
    "service", ["directory", pytest.param("s3", marks=pytest.mark.slow)], indirect=True
)
"""Both stores are shown in the suite; rules of the check alone are on S3 in deep runs."""


@pytest.fixture(params=["directory", pytest.param("s3", marks=[pytest.mark.slow, pytest.mark.deep])])
def service(request: pytest.FixtureRequest, settings: Settings, tmp_path: Path) -> Service:
    """An empty service on each kind of store, with a bucket of its own."""
    environ = dict[str, str]()
    settings = settings.model_copy(
        update={"bucket": f"fsck-{tmp_path.name.replace('_', '-').lower()}"[-60:].strip("-")}
    )
    if request.param == "s3":
        server: S3Server = request.getfixturevalue("s3_server")
        environ = server.environ()
        settings = settings.model_copy(update={"object_store": environ["ROBOMAKER_OBJECT_STORE"]})
    service = Service.open(settings, environ)
    service.store.ensure_bucket(settings.bucket)
    for info in list(service.store.list(settings.bucket)):
        service.store.delete(settings.bucket, info.key)
    return service


@pytest.fixture
def job(service: Service, tmp_path: Path) -> Job:
    """Stores a job that has ended, with its outputs."""

    def make(job_id: str = "sim-1", *, finished: bool = True) -> Resource:
        place = StoredPlace(bucket=service.settings.bucket, prefix=f"simulation-jobs/{job_id}/run")
        outputs = tmp_path / "outputs" / job_id
        for name, content in FILES.items():
            (outputs / name).parent.mkdir(parents=True, exist_ok=True)
            (outputs / name).write_bytes(content)
        files = regular_files(outputs)
        publish(service.store, place.bucket, place.prefix, files, about={}, created_at=service.clock())
        document = SimulationJobDocument(request={}, seed=1, run_id="run", outputs=place, finished=finished)
        arn = service.arn("simulation-job", job_id)
        new = Resource.new(arn=arn, kind="simulation-job", id=job_id, status="Completed", document=document)
        service.catalog.create(new, token=None)
        return service.catalog.get(arn)

    return make


def key(name: str) -> str:
    return f"simulation-jobs/sim-1/run/{name}"


def found(report: ConsistencyReport) -> list[tuple[Problem, str]]:
    return [(each.problem, each.where.rsplit("/", 1)[1]) for each in report.findings]


@pytest.mark.deep
def test_a_world_an_export_and_a_job_that_really_ran_are_whole_and_losses_are_told(
    service: Service,
    generate: Callable[..., dict[str, Any]],
    simulate: Callable[..., dict[str, Any]],
    order: Callable[..., dict[str, Any]],
) -> None:
    generated = generate()
    [world] = generated["finishedWorldsSummary"]["succeededWorlds"]
    bucket = service.settings.bucket
    export = {"worlds": [world], "outputLocation": {"s3Bucket": bucket}, "iamRole": ROLE}
    arn = call("CreateWorldExportJob", export, service)["arn"]
    assert registry()["CreateWorldExportJob"].perform(arn, service)["status"] == "Completed"
    assert simulate(order())["status"] == "Completed"

    whole = check_consistency(service, read_content=True)

    assert (whole.findings, whole.resources) == ([], 3)
    # Copies of archives are checked when they are used, by their digest.
    stored = [
        info
        for info in service.store.list(bucket)
        if not info.key.endswith("manifest.json") and not info.key.startswith("kept-archives/")
    ]
    assert (whole.objects, whole.size_bytes) == (len(stored), sum(info.size_bytes for info in stored))

    for info in list(service.store.list(bucket)):
        service.store.delete(bucket, info.key)
    lost = check_consistency(service)

    assert {each.resource and each.resource.split(":")[-1].split("/")[0] for each in lost.findings} == {
        "world",
        "world-export-job",
        "simulation-job",
    }
    assert {each.problem for each in lost.findings} == {Problem.NOT_PUBLISHED, Problem.MISSING}


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("recording.mcap", None, Problem.MISSING),
        ("recording.mcap", b"x" * 999, Problem.WRONG_SIZE),
        ("recording.mcap", b"y" * 1000, Problem.WRONG_CONTENT),
        ("manifest.json", None, Problem.NOT_PUBLISHED),
    ],
)
def test_what_is_not_as_it_was_stored_is_told(
    service: Service, job: Job, name: str, content: bytes | None, problem: Problem
) -> None:
    arn, bucket = job().arn, service.settings.bucket
    if content is None:
        service.store.delete(bucket, key(name))
    else:
        service.store.put_bytes(bucket, key(name), content)

    report = check_consistency(service, read_content=True)

    [finding] = report.open_findings
    assert (finding.problem, finding.resource, finding.where) == (problem, arn, service.store.uri(bucket, key(name)))
    assert "backup" in finding.remedy
    by_size = check_consistency(service)
    assert bool(by_size.findings) == (problem is not Problem.WRONG_CONTENT)


def test_something_that_is_no_manifest_is_told(service: Service, job: Job) -> None:
    job()
    service.store.put_bytes(service.settings.bucket, key("manifest.json"), b"<html>")

    [finding] = check_consistency(service).findings

    assert finding.problem is Problem.UNREADABLE
    assert "is no manifest" in finding.detail


def test_of_a_run_that_crashed_no_manifest_is_expected(service: Service, job: Job) -> None:
    job(finished=False)
    service.store.delete(service.settings.bucket, key("manifest.json"))

    assert check_consistency(service).findings == []


def test_outputs_of_jobs_that_the_catalog_does_not_know_are_told_and_are_no_problem(service: Service, job: Job) -> None:
    job()
    service.store.put_bytes(service.settings.bucket, "simulation-jobs/sim-other/run/a.log", b"said")

    report = check_consistency(service, mend=True)

    assert found(report) == [(Problem.UNKNOWN, "sim-other")]
    assert report.open_findings == []
    assert service.store.get_bytes(service.settings.bucket, "simulation-jobs/sim-other/run/a.log") == b"said"


@ALSO_ON_S3
def test_an_interrupted_removal_is_finished(service: Service, job: Job, monkeypatch: pytest.MonkeyPatch) -> None:
    job()
    bucket, delete = service.settings.bucket, service.store.delete

    def only_the_manifest(bucket: str, name: str) -> None:
        if not name.endswith("/manifest.json"):
            raise StorageUnavailableError("no answer")
        delete(bucket, name)

    monkeypatch.setattr(service.store, "delete", only_the_manifest)
    with pytest.raises(StorageUnavailableError):
        thin(service.store, bucket, "simulation-jobs/sim-1/run", lambda name: name == "result.json")
    monkeypatch.undo()

    looked = check_consistency(service)
    mended = check_consistency(service, mend=True)

    assert found(looked) == found(mended) == [(Problem.HALF_REMOVED, "manifest.next.json")]
    assert (len(looked.open_findings), len(mended.open_findings)) == (1, 0)
    assert [file.path for file in read_manifest(service.store, bucket, "simulation-jobs/sim-1/run").files] == [
        "result.json"
    ]
    assert check_consistency(service, read_content=True).findings == []


def test_a_store_that_does_not_answer_ends_the_check(
    service: Service, job: Job, monkeypatch: pytest.MonkeyPatch
) -> None:
    job()

    def away(*arguments: object) -> None:
        raise StorageUnavailableError("no answer")

    monkeypatch.setattr(service.store, "list", away)

    with pytest.raises(StorageUnavailableError):
        check_consistency(service)


@pytest.mark.slow
@pytest.mark.parametrize("service", ["s3"], indirect=True)
def test_parts_of_old_uploads_are_removed_and_those_of_new_ones_are_not(
    service: Service, s3_server: S3Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    client, bucket = s3_server.client("s3"), service.settings.bucket
    upload = client.create_multipart_upload(Bucket=bucket, Key="large.mcap")["UploadId"]
    client.upload_part(Bucket=bucket, Key="large.mcap", UploadId=upload, PartNumber=1, Body=b"x" * (5 << 20))
    assert check_consistency(service, mend=True).findings == []

    late = datetime.now(UTC) + UNFINISHED_AFTER + timedelta(minutes=1)
    monkeypatch.setitem(service.__dict__, "clock", lambda: late)
    looked = check_consistency(service)
    mended = check_consistency(service, mend=True)

    assert found(looked) == found(mended) == [(Problem.HALF_UPLOADED, "large.mcap")]
    assert mended.open_findings == []
    assert not client.list_multipart_uploads(Bucket=bucket).get("Uploads")
