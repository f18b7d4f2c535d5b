"""The caches of bundles: filled once, whole or not at all."""

import fcntl
import os
import signal
import subprocess
import sys
import tarfile
import threading
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.inputs.bundles import (
    application_bundle,
    fill_once,
    last_used,
    remove_unless_used,
)
from prefect_robomaker.tasks.storage import pack_tar_gz


@pytest.fixture
def source(service: Service, tmp_path: Path) -> dict[str, str]:
    """An archive of one package, as an application names it."""
    package = tmp_path / "bundle" / "package"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("answer = 42\n")
    pack_tar_gz(tmp_path / "bundle", tmp_path / "bundle.tar.gz")
    service.store.ensure_bucket("applications")
    etag = service.store.put_file("applications", "bundle.tar.gz", tmp_path / "bundle.tar.gz").etag
    return {"s3Bucket": "applications", "s3Key": "bundle.tar.gz", "etag": etag}


def left_in(folder: Path) -> list[str]:
    """What is in a folder besides lock files."""
    return sorted(path.name for path in folder.iterdir() if not path.name.endswith(".lock"))


def test_an_archive_is_unpacked_once_and_found_again(service: Service, source: dict[str, str]) -> None:
    folder = application_bundle(source, "Robot", service, is_pinned=False)
    assert (folder / "package" / "__init__.py").read_text() == "answer = 42\n"
    (folder / "mark").touch()

    assert application_bundle(source, "Robot", service, is_pinned=False) == folder
    assert (folder / "mark").exists()
    assert left_in(service.folder("scratch")) == []


def test_a_use_renews_the_time_of_a_copy(service: Service, source: dict[str, str]) -> None:
    made = datetime.now(UTC) - timedelta(minutes=1)
    folder = application_bundle(source, "Robot", service, is_pinned=False)
    assert last_used(folder) > made

    os.utime(folder, (0, 0))
    application_bundle(source, "Robot", service, is_pinned=False)
    assert last_used(folder) > made


def test_a_copy_is_removed_whole_unless_it_is_used_or_filled(service: Service, source: dict[str, str]) -> None:
    now = datetime.now(UTC)
    folder = application_bundle(source, "Robot", service, is_pinned=False)
    assert not remove_unless_used(folder, now - timedelta(minutes=1))
    assert (folder / "package" / "__init__.py").exists()

    os.utime(folder, (0, 0))
    with (folder.parent / f".{folder.name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert not remove_unless_used(folder, now)
    assert remove_unless_used(folder, now)
    assert left_in(folder.parent) == []
    assert (application_bundle(source, "Robot", service, is_pinned=False) / "package" / "__init__.py").exists()


def test_a_use_that_comes_with_the_removal_keeps_the_copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    copy = tmp_path / "copy"
    (copy / "within").mkdir(parents=True)
    os.utime(copy, (0, 0))
    rename = Path.rename

    def used_just_before(self: Path, target: Path) -> Path:
        if copy.exists():
            os.utime(copy)
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", used_just_before)
    assert not remove_unless_used(copy, datetime.now(UTC) - timedelta(days=1))
    assert (copy / "within").is_dir()


def test_of_several_at_once_one_fills(tmp_path: Path) -> None:
    fills = []

    def fill(folder: Path) -> None:
        fills.append(folder)
        time.sleep(0.1)
        folder.mkdir()

    threads = [threading.Thread(target=fill_once, args=(tmp_path / "cached", fill)) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert len(fills) == 1
    assert left_in(tmp_path) == ["cached"]


KILLED = """
import sys, time
from pathlib import Path
from prefect_robomaker.tasks.simulations.inputs.bundles import fill_once

def fill(folder):
    folder.mkdir()
    folder.with_name("." + folder.name + ".beside").mkdir()
    (folder / "half").write_text("half")
    print("filling", flush=True)
    time.sleep(60)

fill_once(Path(sys.argv[1]), fill)
"""


def test_what_a_killed_filler_left_is_removed_by_the_next(tmp_path: Path) -> None:
    command = [sys.executable, "-c", KILLED, str(tmp_path / "cached")]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        os.kill(process.pid, signal.SIGKILL)
    assert len(left_in(tmp_path)) == 2

    def fill(folder: Path) -> None:
        folder.mkdir()
        (folder / "whole").touch()

    assert [path.name for path in fill_once(tmp_path / "cached", fill).iterdir()] == ["whole"]
    assert left_in(tmp_path) == ["cached"]


def test_a_damaged_archive_leaves_nothing_behind(service: Service) -> None:
    service.store.ensure_bucket("applications")
    etag = service.store.put_bytes("applications", "broken.tar.gz", b"this is no archive").etag

    broken = {"s3Bucket": "applications", "s3Key": "broken.tar.gz", "etag": etag}

    with pytest.raises(LaunchError) as caught:
        application_bundle(broken, "Robot", service, is_pinned=True)
    assert caught.value.failure_code == "InvalidBundleRobotApplication"
    assert left_in(service.folder("cache", "applications")) == []


@pytest.mark.parametrize("place", [{"s3Key": "gone.tar.gz"}, {"s3Bucket": "nowhere"}])
def test_an_archive_that_is_gone_cannot_be_downloaded(
    service: Service, source: dict[str, str], place: dict[str, str]
) -> None:
    with pytest.raises(LaunchError) as caught:
        application_bundle({**source, **place}, "Simulation", service, is_pinned=False)
    assert caught.value.failure_code == "BadPermissionsSimulationApplication"


def test_the_archive_of_a_version_has_to_be_what_it_was_and_that_of_latest_is_what_it_is(
    service: Service, source: dict[str, str], tmp_path: Path
) -> None:
    (tmp_path / "bundle" / "package" / "__init__.py").write_text("answer = 43\n")
    pack_tar_gz(tmp_path / "bundle", tmp_path / "bundle.tar.gz")
    service.store.put_file("applications", "bundle.tar.gz", tmp_path / "bundle.tar.gz")

    with pytest.raises(LaunchError, match="has changed since the version was made") as caught:
        application_bundle(source, "Simulation", service, is_pinned=True)
    assert caught.value.failure_code == "SimulationApplicationVersionMismatchedEtag"
    assert left_in(service.folder("cache", "applications")) == []
    folder = application_bundle(source, "Simulation", service, is_pinned=False)
    assert (folder / "package" / "__init__.py").read_text() == "answer = 43\n"


@pytest.mark.parametrize(
    ("is_pinned", "code"), [(False, "MismatchedEtag"), (True, "RobotApplicationVersionMismatchedEtag")]
)
def test_an_archive_replaced_between_looking_and_fetching_is_refused(
    service: Service,
    source: dict[str, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    is_pinned: bool,
    code: str,
) -> None:
    head = service.store.head

    def head_and_replace(bucket: str, key: str) -> object:
        found = head(bucket, key)
        with tarfile.open(tmp_path / "other.tar.gz", "w:gz"):
            pass
        service.store.put_file(bucket, key, tmp_path / "other.tar.gz")
        return found

    monkeypatch.setattr(service.store, "head", head_and_replace)
    with pytest.raises(LaunchError, match="has changed since it was looked at") as caught:
        application_bundle(source, "Robot", service, is_pinned=is_pinned)
    assert caught.value.failure_code == code
    assert left_in(service.folder("cache", "applications")) == []
