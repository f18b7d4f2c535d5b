"""Archives that are kept by digest when a job runs with them."""

import shutil
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.schemas.wire.errors import StorageError
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.inputs.bundles import application_bundle
from prefect_robomaker.tasks.simulations.inputs.kept_archives import is_kept, kept_archives
from prefect_robomaker.tasks.storage import pack_tar_gz


def upload(service: Service, tmp_path: Path, text: str) -> dict[str, str]:
    package = tmp_path / "bundle" / "package"
    package.mkdir(parents=True, exist_ok=True)
    (package / "__init__.py").write_text(text)
    pack_tar_gz(tmp_path / "bundle", tmp_path / "bundle.tar.gz")
    service.store.ensure_bucket("applications")
    etag = service.store.put_file("applications", "bundle.tar.gz", tmp_path / "bundle.tar.gz").etag
    return {"s3Bucket": "applications", "s3Key": "bundle.tar.gz", "etag": etag}


def code(service: Service, source: dict[str, str], **members: Any) -> str:
    folder = application_bundle(source, "Robot", service, is_pinned=False, keeper=service, **members)
    return (folder / "package" / "__init__.py").read_text()


def test_the_earlier_archive_is_taken_for_a_rerun_and_the_new_one_for_a_run(service: Service, tmp_path: Path) -> None:
    old = upload(service, tmp_path, "old")
    assert code(service, old) == "old"
    new = upload(service, tmp_path, "new")
    shutil.rmtree(service.settings.home / "cache")
    assert code(service, new, as_ran=old["etag"]) == "old"
    assert code(service, new) == "new"
    assert {each.key.rpartition("/")[2] for each in kept_archives(service)} == {old["etag"], new["etag"]}
    assert list(service.folder("scratch").iterdir()) == []


def test_an_archive_that_nobody_kept_is_taken_as_it_is_now(service: Service, tmp_path: Path) -> None:
    source = upload(service, tmp_path, "now")
    for etag in ("0" * 32, "..", "", "a/b"):
        assert code(service, source, as_ran=etag) == "now"


def test_an_unpacked_archive_that_was_never_kept_is_kept_at_its_next_use(service: Service, tmp_path: Path) -> None:
    source = upload(service, tmp_path, "text")
    application_bundle(source, "Robot", service, is_pinned=False)
    assert not is_kept(source["etag"], service)
    assert code(service, source) == "text"
    assert is_kept(source["etag"], service)


def test_a_store_that_refuses_the_copy_keeps_no_job_from_running(
    service: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    source = upload(service, tmp_path, "text")

    def full(*_: object, **__: object) -> None:
        raise StorageError("the disk is full")

    monkeypatch.setattr(type(service.store), "put_file", full)
    assert code(service, source) == "text"
    assert "is not kept, so that repro may not find its code: the disk is full" in caplog.text
