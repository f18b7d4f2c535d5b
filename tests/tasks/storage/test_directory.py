"""What is particular to a directory: names, links, full disks, ETags that need no reading, crashes."""

import errno
import hashlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from prefect_robomaker.schemas.wire.errors import (
    ObjectExistsError,
    ObjectNotFoundError,
    StorageAccessDeniedError,
    StorageError,
    StorageFullError,
    StorageUnavailableError,
)
from prefect_robomaker.tasks.files.untrusted_folders import from_os_error
from prefect_robomaker.tasks.storage import checksums
from prefect_robomaker.tasks.storage.directory import DirectoryStore

BUCKET = "bucket"


@pytest.fixture
def store(directory_store: DirectoryStore) -> DirectoryStore:
    directory_store.ensure_bucket(BUCKET)
    return directory_store


def test_objects_are_plain_files_where_uri_and_local_path_say(store: DirectoryStore, tmp_path: Path):
    store.put_bytes(BUCKET, "a b/c#.txt", b"content")
    path = store.local_path(BUCKET, "a b/c#.txt")
    assert path is not None
    assert path == tmp_path / "objects" / "bucket" / "a b" / "c#.txt"
    assert path.read_bytes() == b"content"
    assert store.uri(BUCKET, "a b/c#.txt") == f"file://{tmp_path}/objects/bucket/a%20b/c%23.txt"


def test_a_key_cannot_be_an_object_and_a_folder(store: DirectoryStore):
    store.put_bytes(BUCKET, "a/b", b"")
    store.put_bytes(BUCKET, "c", b"")
    for key, create_only in [("a", False), ("a", True), ("c/d", False), ("c/d", True), ("c/d/e", False)]:
        with pytest.raises(StorageError, match="both an object and the folder") as caught:
            store.put_bytes(BUCKET, key, b"", create_only=create_only)
        assert not isinstance(caught.value, ObjectExistsError)
    assert [info.key for info in store.list(BUCKET)] == ["a/b", "c"]


def test_links_pipes_and_folders_are_no_objects(store: DirectoryStore, tmp_path: Path):
    (tmp_path / "secret").write_bytes(b"secret")
    folder = tmp_path / "objects" / BUCKET
    (folder / "link").symlink_to(tmp_path / "secret")
    (folder / "linked-folder").symlink_to(tmp_path)
    (folder / "folder").mkdir()
    os.mkfifo(folder / "pipe")
    assert list(store.list(BUCKET)) == []
    for key in ("link", "folder", "pipe"):
        with pytest.raises(ObjectNotFoundError):
            store.get_bytes(BUCKET, key)


def test_folders_that_are_links_lead_nowhere(store: DirectoryStore, tmp_path: Path):
    secrets = tmp_path / "secrets"
    secrets.mkdir()
    (secrets / "key").write_bytes(b"secret")
    (tmp_path / "objects" / BUCKET / "run").symlink_to(secrets)
    for key in ("run/key", "run/deeper/key"):
        with pytest.raises(ObjectNotFoundError):
            store.get_bytes(BUCKET, key)
        assert store.local_path(BUCKET, key) is None
    assert [list(store.list(BUCKET, prefix)) for prefix in ("", "run/", "run/k")] == [[], [], []]
    for change in (lambda: store.put_bytes(BUCKET, "run/new", b""), lambda: store.delete(BUCKET, "run/key")):
        with pytest.raises(StorageError, match="run is a symbolic link; remove it"):
            change()
    assert [(path.name, path.read_bytes()) for path in secrets.iterdir()] == [("key", b"secret")]


def test_buckets_may_lie_on_other_disks(tmp_path: Path):
    (tmp_path / "disk" / "large").mkdir(parents=True)
    (tmp_path / "objects").symlink_to(tmp_path / "disk")
    (tmp_path / "disk" / "outputs").symlink_to(tmp_path / "disk" / "large")
    store = DirectoryStore(tmp_path / "objects")
    store.put_bytes("outputs", "run/a", b"a")
    assert store.get_bytes("outputs", "run/a") == b"a"
    assert [info.key for info in store.list("outputs")] == ["run/a"]


def test_writing_over_a_link_replaces_the_link_not_its_target(store: DirectoryStore, tmp_path: Path):
    (tmp_path / "target").write_bytes(b"untouched")
    (tmp_path / "objects" / BUCKET / "link").symlink_to(tmp_path / "target")
    store.put_bytes(BUCKET, "link", b"object")
    assert (tmp_path / "target").read_bytes() == b"untouched"
    assert store.get_bytes(BUCKET, "link") == b"object"


def test_a_full_disk_is_named_and_leaves_nothing(small_disk: Path, tmp_path: Path):
    store = DirectoryStore(small_disk / "objects")
    store.ensure_bucket(BUCKET)
    store.put_bytes(BUCKET, "kept", b"kept")
    (tmp_path / "file").write_bytes(bytes(2_000_000))
    for write in (
        lambda: store.put_file(BUCKET, "large", tmp_path / "file"),
        lambda: store.put_bytes(BUCKET, "kept", bytes(2_000_000)),
    ):
        with pytest.raises(StorageFullError, match="No space left"):
            write()
    assert [(info.key, info.size_bytes) for info in store.list(BUCKET)] == [("kept", 4)]
    assert list((small_disk / "objects" / ".incoming").iterdir()) == []
    store.put_bytes(BUCKET, "fits", b"fits")


def test_a_disk_that_fills_up_while_fetching_leaves_nothing(store: DirectoryStore, small_disk: Path):
    store.put_bytes(BUCKET, "large", bytes(2_000_000))
    with pytest.raises(StorageFullError, match="large"):
        store.get_file(BUCKET, "large", small_disk / "fetched")
    assert list(small_disk.iterdir()) == []


def test_a_directory_that_may_not_be_written_is_named(small_disk: Path):
    DirectoryStore(small_disk / "objects").ensure_bucket(BUCKET)
    subprocess.run(["mount", "-o", "remount,ro", small_disk], check=True)
    store = DirectoryStore(small_disk / "objects")
    for call in (
        lambda: store.put_bytes(BUCKET, "a", b""),
        lambda: store.ensure_bucket("another"),
    ):
        with pytest.raises(StorageAccessDeniedError, match="Read-only"):
            call()


def test_a_missing_source_is_named(store: DirectoryStore, tmp_path: Path):
    with pytest.raises(StorageError, match=r"missing\.txt"):
        store.put_file(BUCKET, "a", tmp_path / "missing.txt")


def test_a_file_written_to_while_it_is_stored_is_not_stored(
    store: DirectoryStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    source = tmp_path / "log"
    source.write_bytes(b"line\n")
    fsync = os.fsync

    def fsync_while_the_log_grows(descriptor: int) -> None:
        with source.open("ab") as log:
            log.write(b"another line\n")
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", fsync_while_the_log_grows)
    with pytest.raises(StorageError, match="written to meanwhile"):
        store.put_file(BUCKET, "log", source)
    assert list(store.list(BUCKET)) == []


def test_the_etag_follows_an_object_edited_in_place(store: DirectoryStore):
    store.put_bytes(BUCKET, "edited", b"before")
    path = store.local_path(BUCKET, "edited")
    assert path is not None
    path.write_bytes(b"after!")
    assert store.head(BUCKET, "edited").etag == hashlib.md5(b"after!").hexdigest()
    path.unlink()
    path.write_bytes(b"placed by hand")
    assert store.head(BUCKET, "edited").etag == hashlib.md5(b"placed by hand").hexdigest()


def test_asking_for_an_etag_does_not_read_the_file(store: DirectoryStore, monkeypatch: pytest.MonkeyPatch):
    info = store.put_bytes(BUCKET, "large", b"content")
    path = store.local_path(BUCKET, "large")
    assert path is not None
    try:
        os.getxattr(path, "user.robomaker.etag")
    except OSError:
        pytest.skip("this file system keeps no user attributes")
    monkeypatch.setattr(checksums, "digest_of", lambda *_: pytest.fail("the file was read"))
    assert store.head(BUCKET, "large") == info
    assert list(store.list(BUCKET)) == [info]


def test_etags_are_right_without_extended_attributes(store: DirectoryStore, monkeypatch: pytest.MonkeyPatch):
    def refuse(*args):
        raise OSError("not supported")

    monkeypatch.setattr(os, "setxattr", refuse)
    monkeypatch.setattr(os, "getxattr", refuse)
    for content in (b"one", b"two"):
        store.put_bytes(BUCKET, "key", content)
        assert store.head(BUCKET, "key").etag == hashlib.md5(content).hexdigest()


def test_what_crashed_writers_left_goes_after_a_day(tmp_path: Path):
    incoming = tmp_path / ".incoming"
    DirectoryStore(tmp_path).ensure_bucket(BUCKET)
    (incoming / "left").write_bytes(b"half")
    DirectoryStore(tmp_path, clock=lambda: time.time() + 3_600).ensure_bucket(BUCKET)
    assert (incoming / "left").exists(), "somebody may still be writing it"
    DirectoryStore(tmp_path, clock=lambda: time.time() + 90_000).ensure_bucket(BUCKET)
    assert not (incoming / "left").exists()


def test_a_killed_writer_leaves_only_whole_objects(tmp_path: Path):
    writer = (
        "import sys, itertools; from pathlib import Path;"
        "from prefect_robomaker.tasks.storage.directory import DirectoryStore;"
        "store = DirectoryStore(Path(sys.argv[1])); store.ensure_bucket('bucket');"
        "[store.put_bytes('bucket', f'{n % 3}/object', bytes([n % 256]) * 2_000_000) for n in itertools.count()]"
    )
    process = subprocess.Popen([sys.executable, "-c", writer, str(tmp_path)])
    deadline = time.monotonic() + 120
    while not (tmp_path / BUCKET / "2" / "object").exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    store = DirectoryStore(tmp_path)
    found = list(store.list(BUCKET))
    assert [info.key for info in found] == ["0/object", "1/object", "2/object"]
    for info in found:
        content = store.get_bytes(BUCKET, info.key)
        assert content == content[:1] * 2_000_000
        assert hashlib.md5(content).hexdigest() == info.etag
    store.put_bytes(BUCKET, "0/object", b"and goes on")


@pytest.mark.parametrize(
    ("number", "kind"),
    [
        (errno.EIO, StorageUnavailableError),
        (errno.ESTALE, StorageUnavailableError),
        (errno.ETIMEDOUT, StorageUnavailableError),
        (errno.EHOSTDOWN, StorageUnavailableError),
        (errno.ENOSPC, StorageFullError),
        (errno.EDQUOT, StorageFullError),
        (errno.EACCES, StorageAccessDeniedError),
        (errno.EROFS, StorageAccessDeniedError),
        (errno.EFBIG, StorageError),
        (errno.ENAMETOOLONG, StorageError),
    ],
)
def test_what_a_file_system_says_becomes_our_error(number: int, kind: type[StorageError]):
    """What a network file system says whose server is away can be waited for, and so can a full one."""
    error = from_os_error(OSError(number, os.strerror(number), "/mnt/objects/a"), "store a")
    assert type(error) is kind
    assert isinstance(error, StorageUnavailableError) == (kind in (StorageUnavailableError, StorageFullError))


def test_a_file_that_is_overwritten_in_place_with_its_old_times_has_a_new_etag(tmp_path: Path) -> None:
    store = DirectoryStore(tmp_path)
    store.ensure_bucket("apps")
    path = tmp_path / "apps" / "robot.tar"
    path.write_bytes(b"old robot")
    os.utime(path, (1, 1))
    before = store.head("apps", "robot.tar").etag
    time.sleep(0.1)  # a change of a file is told from the keeping of its ETag when 20 ms lie between them
    path.write_bytes(b"new robot")
    os.utime(path, (1, 1))
    assert store.head("apps", "robot.tar").etag != before
