"""Failure codes of jobs whose parts went bad between order and start, each caused for real."""

import gzip
import io
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.application_calls import Applications

from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

Order = Callable[..., dict[str, Any]]
ROLES = pytest.mark.parametrize("role", ["Robot", "Simulation"])
BUCKET = "applications"


@pytest.fixture
def fail(service: Service) -> Callable[..., dict[str, Any]]:
    """Orders a job, has something happen, performs it; returns the job, which failed before it ran."""

    def fail(request: dict[str, Any], happen: Callable[[], object] = lambda: None) -> dict[str, Any]:
        arn = call("CreateSimulationJob", request, service)["arn"]
        happen()
        perform_job(arn, service)
        job = call("DescribeSimulationJob", {"job": arn}, service)
        assert job["status"] == "Failed"
        assert "lastStartedAt" not in job
        assert list((service.settings.home / "jobs").iterdir()) == []
        return job

    return fail


def own_archive(request: dict[str, Any], role: str, content: bytes, service: Service) -> dict[str, Any]:
    """The request with an application whose archive is this."""
    applications = Applications.of(role, service)  # type: ignore[arg-type]
    applications.create("own", sources=applications.stored("own.archive", content))
    request[f"{role.lower()}Applications"][0]["application"] = "own"
    return request


def tar(name: str, *, link: str = "", kind: bytes = tarfile.REGTYPE) -> bytes:
    """An archive with one member that no bundle has."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w:gz", compresslevel=1) as archive:
        member = tarfile.TarInfo(name)
        member.type, member.linkname = kind, link
        archive.addfile(member)
    return buffer.getvalue()


def bomb() -> bytes:
    """Three hundred megabytes of nothing; parts of a gzip file may simply be joined."""
    header = tarfile.TarInfo("bomb")
    header.size = 300 << 20
    return gzip.compress(header.tobuf()) + gzip.compress(bytes(10 << 20)) * 30 + gzip.compress(bytes(1024))


def million_entries() -> bytes:
    """The same folder a million times."""
    header = tarfile.TarInfo("folder")
    header.type = tarfile.DIRTYPE
    return gzip.compress(header.tobuf() * 10_000) * 100


@ROLES
def test_what_is_no_archive(service: Service, order: Order, fail: Any, role: str) -> None:
    job = fail(own_archive(order(), role, b"no archive", service))

    assert job["failureCode"] == f"InvalidBundle{role}Application"


@pytest.mark.parametrize(
    ("archive", "words"),
    [
        (lambda: tar("../outside"), "'../outside'"),
        (lambda: tar("/tmp/outside"), "absolute path"),
        (lambda: tar("link", link="/etc/passwd", kind=tarfile.SYMTYPE), "symbolic link"),
        (lambda: tar("link", link="../../outside", kind=tarfile.LNKTYPE), "link"),
        (lambda: tar("device", kind=tarfile.CHRTYPE), "device"),
        (bomb, "200 times its own size"),
        pytest.param(million_entries, "more than 100000 files and folders", marks=pytest.mark.deep),
    ],
    ids=["upwards", "absolute", "link", "hard link", "device", "bomb", "million"],
)
def test_archives_that_cannot_be_unpacked(
    service: Service, order: Order, fail: Any, tmp_path: Path, archive: Callable[[], bytes], words: str
) -> None:
    before = set(tmp_path.rglob("outside"))

    job = fail(own_archive(order(), "Simulation", archive(), service))

    assert job["failureCode"] == "InvalidBundleSimulationApplication"
    assert words in job["failureReason"]
    assert set(tmp_path.rglob("outside")) == before
    assert not Path("/tmp/outside").exists()
    assert [path.name for path in (service.settings.home / "cache" / "applications").glob("*.part*")] == []


@ROLES
def test_archives_that_are_gone(service: Service, order: Order, fail: Any, role: str) -> None:
    request = own_archive(order(), role, b"soon gone", service)

    job = fail(request, lambda: service.store.delete(BUCKET, "own.archive"))

    assert job["failureCode"] == f"BadPermissions{role}Application"


@pytest.mark.parametrize(
    ("source", "happen", "code"),
    [
        ({}, lambda store: store.put_bytes(BUCKET, "map.zip", b"changed"), "MismatchedEtag"),
        ({}, lambda store: store.delete(BUCKET, "map.zip"), "InvalidS3Resource"),
        ({"type": "Archive"}, lambda store: None, "InvalidS3Resource"),
    ],
    ids=["changed", "gone", "no archive"],
)
def test_data_that_is_not_what_was_ordered(
    service: Service, order: Order, fail: Any, source: dict[str, str], happen: Callable[[Any], object], code: str
) -> None:
    request = order()
    service.store.put_bytes(BUCKET, "map.zip", b"a map")
    request["dataSources"] = [{"name": "map", "s3Bucket": BUCKET, "s3Keys": ["map.zip"], **source}]

    job = fail(request, lambda: happen(service.store))

    assert job["failureCode"] == code
    assert "map.zip" in job["failureReason"]


def test_a_world_that_is_deleted(service: Service, order: Order, fail: Any) -> None:
    arn = service.arn("world", "world-gone00000000")
    service.catalog.create(Resource.new(arn=arn, kind="world", id="world-gone00000000", document={}), token=None)
    request = order()
    request["simulationApplications"][0]["worldConfigs"] = [{"world": arn}]

    job = fail(request, lambda: service.catalog.delete(arn))

    assert job["failureCode"] == "ResourceNotFound"
