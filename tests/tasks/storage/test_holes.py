"""Files with holes: the same content as if every byte had been read, without reading them or filling a disk."""

import hashlib
import os
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.wire.errors import TransferStoppedError
from prefect_robomaker.tasks.storage.checksums import copy_with_holes, digest_of
from prefect_robomaker.tasks.storage.directory import DirectoryStore

KIB = 1024


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("holes")


@given(
    parts=st.lists(
        st.tuples(st.sampled_from([b"", b"x", b"data" * 3000]), st.sampled_from([0, 1, 4 * KIB, 1500 * KIB])),
        max_size=4,
    ),
    cut=st.integers(0, 5000),
)
def test_content_is_that_of_a_plain_read(folder: Path, parts: list[tuple[bytes, int]], cut: int) -> None:
    path, copy = folder / "file", folder / "copy"
    with path.open("wb") as file:
        for data, hole in parts:
            file.write(data)
            file.seek(hole, os.SEEK_CUR)
        file.truncate(max(0, file.tell() - cut))
    plain = path.read_bytes()
    with path.open("rb") as file, copy.open("wb") as target:
        assert digest_of(file.fileno(), "sha256") == (hashlib.sha256(plain).hexdigest(), len(plain))
        assert copy_with_holes(file.fileno(), target) == len(plain)
    assert copy.read_bytes() == plain


def test_a_stored_file_keeps_its_holes(tmp_path: Path) -> None:
    """Else a file without a block would fill the disk of the store, and of whoever fetches it."""
    sparse = tmp_path / "sparse"
    with sparse.open("wb") as file:
        file.write(b"begin")
        file.truncate(300 << 20)
    store = DirectoryStore(tmp_path / "objects")
    store.ensure_bucket("results")
    stored = store.put_file("results", "sparse", sparse)
    store.get_file("results", "sparse", tmp_path / "fetched")
    at = store.local_path("results", "sparse")
    assert at is not None
    for path in (at, tmp_path / "fetched"):
        about = path.stat()
        assert (about.st_size, about.st_blocks * 512 < 1 << 20) == (300 << 20, True)
    assert stored.size_bytes == 300 << 20
    with sparse.open("rb") as file:
        assert stored.etag == hashlib.file_digest(file, "md5").hexdigest()


def test_a_huge_hole_is_left_at_once_when_it_is_to_stop(tmp_path: Path) -> None:
    """2^38 bytes take minutes to go through, on any machine."""
    with (tmp_path / "huge").open("wb") as file:
        file.truncate(1 << 38)
    until = time.monotonic() + 0.2
    with (tmp_path / "huge").open("rb") as file, pytest.raises(TransferStoppedError):
        digest_of(file.fileno(), "sha256", lambda: time.monotonic() >= until)


def test_empty_files_are_left_too_when_they_are_to_stop(tmp_path: Path) -> None:
    """100,000 of them took half a minute after their job was cancelled."""
    (tmp_path / "empty").touch()
    with (tmp_path / "empty").open("rb") as file, pytest.raises(TransferStoppedError):
        digest_of(file.fileno(), "sha256", lambda: True)
