"""Removing some of what is published: at no moment does a part look whole."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.schemas.wire.errors import ObjectNotFoundError, StorageError, StorageUnavailableError
from prefect_robomaker.tasks.files.untrusted_folders import regular_files
from prefect_robomaker.tasks.storage import publish, read_manifest, removed_before, thin, unpublish
from prefect_robomaker.tasks.storage.object_store import ObjectStore

FILES = {"result.json": b"{}", "recording.mcap": b"x" * 1000, "logs/stdout.log": b"said", "video.mp4": b"y" * 500}
KEPT = {"result.json"}


class Interrupted(StorageUnavailableError):
    """The store does not answer any more."""


class Failing:
    """A store that stops answering after some writes and deletions."""

    def __init__(self, store: ObjectStore, left: int) -> None:
        self._store, self._left = store, left

    def __getattr__(self, name: str) -> Any:
        if name in ("put_bytes", "delete"):
            self._left -= 1
            if self._left < 0:
                raise Interrupted("no answer")
        return getattr(self._store, name)


@pytest.fixture
def published(store: ObjectStore, bucket: str, tmp_path: Path) -> str:
    folder = tmp_path / "outputs"
    for name, content in FILES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    unpublish(store, bucket, "sim-1/run-1")
    publish(store, bucket, "sim-1/run-1", regular_files(folder), about={"job": "sim-1"}, created_at=datetime.now(UTC))
    store.put_bytes(bucket, "sim-1/run-10/other", b"not ours")
    return "sim-1/run-1"


def keys(store: ObjectStore, bucket: str) -> set[str]:
    return {info.key for info in store.list(bucket)}


def test_what_stays_is_a_whole_again(store: ObjectStore, bucket: str, published: str) -> None:
    thin(store, bucket, published, KEPT.__contains__)

    manifest = read_manifest(store, bucket, published)
    assert [file.path for file in manifest.files] == ["result.json"]
    assert removed_before(manifest) == (3, 1504)
    assert manifest.about["job"] == "sim-1"
    assert keys(store, bucket) == {f"{published}/result.json", f"{published}/manifest.json", "sim-1/run-10/other"}
    thin(store, bucket, published, KEPT.__contains__)
    assert read_manifest(store, bucket, published) == manifest


@pytest.mark.parametrize("steps", range(8))
def test_an_interruption_leaves_nothing_that_looks_whole(
    store: ObjectStore, bucket: str, published: str, steps: int
) -> None:
    with pytest.raises(Interrupted) if steps < 7 else nothing_raised():
        thin(Failing(store, steps), bucket, published, KEPT.__contains__)  # type: ignore[arg-type]

    try:
        named = {file.path for file in read_manifest(store, bucket, published).files}
    except ObjectNotFoundError:
        named = set()
    there = {key.removeprefix(f"{published}/") for key in keys(store, bucket)}
    assert named <= there, "a manifest names only what is there"
    thin(store, bucket, published, KEPT.__contains__)
    assert removed_before(read_manifest(store, bucket, published)) == (3, 1504)
    assert keys(store, bucket) == {f"{published}/result.json", f"{published}/manifest.json", "sim-1/run-10/other"}


def test_a_whole_bucket_is_refused(store: ObjectStore, bucket: str) -> None:
    with pytest.raises(StorageError, match="everything in"):
        thin(store, bucket, "/", KEPT.__contains__)


def nothing_raised() -> Any:
    from contextlib import nullcontext

    return nullcontext()
