"""Both kinds of store, the S3 one on a real server."""

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.s3_server import S3Server

from prefect_robomaker.tasks.storage.directory import DirectoryStore
from prefect_robomaker.tasks.storage.object_store import ObjectStore
from prefect_robomaker.tasks.storage.s3 import S3Store


@pytest.fixture
def directory_store(tmp_path: Path) -> DirectoryStore:
    return DirectoryStore(tmp_path / "objects")


@pytest.fixture(scope="session")
def s3_store(s3_server: S3Server) -> S3Store:
    return S3Store(s3_server.endpoint, "us-east-1", s3_server.session())


@pytest.fixture(params=["directory", "s3"])
def store(request: pytest.FixtureRequest) -> ObjectStore:
    """Every test that takes this runs once for each kind of store."""
    return request.getfixturevalue(f"{request.param}_store")


@pytest.fixture
def bucket(store: ObjectStore) -> Iterator[str]:
    """An empty bucket; one serves all tests, as the server takes 0.2 s to make one."""
    name = "contract-tests"
    store.ensure_bucket(name)
    yield name
    empty(store, name)


def empty(store: ObjectStore, bucket: str) -> None:
    """Deletes everything in a bucket."""
    for info in list(store.list(bucket)):
        store.delete(bucket, info.key)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of its own with 1 MB of space."""
    if os.geteuid() != 0:
        pytest.skip("only root can mount")
    folder = tmp_path / "small-disk"
    folder.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", folder], check=False)
    if mounted.returncode != 0:
        pytest.skip("mounting is not allowed here")
    yield folder
    subprocess.run(["umount", folder], check=True)
