"""A publication is there as a whole or not at all."""

import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.schemas.wire.errors import (
    ChecksumMismatchError,
    ObjectExistsError,
    ObjectNotFoundError,
    StorageAccessDeniedError,
    StorageError,
    StorageFullError,
)
from prefect_robomaker.tasks.files.untrusted_folders import regular_files
from prefect_robomaker.tasks.storage import fetch, publish, read_manifest, unpublish
from prefect_robomaker.tasks.storage.directory import DirectoryStore
from prefect_robomaker.tasks.storage.object_store import ObjectInfo, ObjectStore

NOW = datetime(2030, 1, 2, 3, 4, 5, tzinfo=UTC)
ABOUT = {"job": "arn:aws:robomaker:us-east-1:000000000000:simulation-job/sim-1", "seed": 7, "status": "Completed"}
CONTENT = {"result.json": b"{}", "logs/agent.log": b"line\n" * 1000, "logs/empty.log": b"", "ünï.txt": b"x"}


def filled(folder: Path, content: dict[str, bytes] = CONTENT) -> Path:
    for name, data in content.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    return folder


def content_of(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def outputs(tmp_path: Path) -> Path:
    return filled(tmp_path / "outputs")


@pytest.fixture
def disk(directory_store: DirectoryStore) -> DirectoryStore:
    directory_store.ensure_bucket("outputs")
    return directory_store


def wrapped(store: ObjectStore, **methods: Any) -> ObjectStore:
    """A store with methods replaced."""
    changed: Any = _Wrapped(store, **methods)
    return changed


class _Wrapped:
    def __init__(self, store: ObjectStore, **methods: Any) -> None:
        self._store = store
        vars(self).update(methods)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._store, name)


@pytest.mark.parametrize("prefix", ["jobs/sim-1/run-1", "", "trailing/"])
def test_what_is_published_is_fetched_whole(
    store: ObjectStore, bucket: str, outputs: Path, tmp_path: Path, prefix: str
):
    manifest = publish(store, bucket, prefix, regular_files(outputs), about=ABOUT, created_at=NOW)
    assert [file.path for file in manifest.files] == ["logs/agent.log", "logs/empty.log", "result.json", "ünï.txt"]
    assert (manifest.about, manifest.created_at) == (ABOUT, NOW)
    assert read_manifest(store, bucket, prefix) == manifest
    assert fetch(store, bucket, prefix, tmp_path / "fetched") == manifest
    assert content_of(tmp_path / "fetched") == CONTENT
    assert store.get_bytes(bucket, f"{prefix.rstrip('/')}/result.json".lstrip("/")) == b"{}"


def test_publishing_again_gives_the_first_manifest(disk: DirectoryStore, outputs: Path):
    first = publish(disk, "outputs", "run", regular_files(outputs), about=ABOUT, created_at=NOW)
    again = publish(disk, "outputs", "run", regular_files(outputs), about=ABOUT, created_at=NOW + timedelta(hours=1))
    assert again == first


@pytest.mark.parametrize("what", ["content", "about"])
def test_something_else_under_the_prefix_is_neither_replaced_nor_touched(
    disk: DirectoryStore, outputs: Path, tmp_path: Path, what: str
):
    publish(disk, "outputs", "run", regular_files(outputs), about=ABOUT, created_at=NOW)
    about = ABOUT
    if what == "content":
        (outputs / "result.json").write_bytes(b"[]")
    else:
        about = {**ABOUT, "seed": 8}
    with pytest.raises(ObjectExistsError, match="run"):
        publish(disk, "outputs", "run", regular_files(outputs), about=about, created_at=NOW)
    fetch(disk, "outputs", "run", tmp_path / "fetched")
    assert content_of(tmp_path / "fetched") == CONTENT


@pytest.mark.parametrize("put_before_failure", [0, 1, 3])
def test_a_failure_midway_leaves_no_manifest_and_can_be_repeated(
    store: ObjectStore, bucket: str, outputs: Path, tmp_path: Path, put_before_failure: int
):
    def put_some(bucket: str, files: dict[str, Path], **_: Any) -> list[ObjectInfo]:
        some = dict(list(files.items())[:put_before_failure])
        store.put_files(bucket, some)
        raise StorageError("the connection broke")

    with pytest.raises(StorageError, match="broke"):
        publish(wrapped(store, put_files=put_some), bucket, "run", regular_files(outputs), about=ABOUT, created_at=NOW)
    with pytest.raises(ObjectNotFoundError):
        fetch(store, bucket, "run", tmp_path / "fetched")
    assert not (tmp_path / "fetched").exists()
    publish(store, bucket, "run", regular_files(outputs), about=ABOUT, created_at=NOW)
    fetch(store, bucket, "run", tmp_path / "fetched")


def test_a_lost_answer_to_the_last_write_is_no_failure(disk: DirectoryStore, outputs: Path):
    def put_but_lose_the_answer(bucket: str, key: str, data: bytes, *, create_only: bool = False) -> ObjectInfo:
        disk.put_bytes(bucket, key, data, create_only=create_only)
        raise ObjectExistsError("as a repeated request finds what the first one wrote")

    store = wrapped(disk, put_bytes=put_but_lose_the_answer)
    assert publish(store, "outputs", "run", regular_files(outputs), about=ABOUT, created_at=NOW) == read_manifest(
        disk, "outputs", "run"
    )


def test_of_two_different_publications_at_once_one_gets_the_manifest(store: ObjectStore, bucket: str, tmp_path: Path):
    folders = [filled(tmp_path / str(number), {f"only-{number}": b"x"}) for number in range(4)]

    def try_to_publish(folder: Path) -> bool:
        try:
            publish(store, bucket, "race", regular_files(folder), about=ABOUT, created_at=NOW)
        except ObjectExistsError:
            return False
        return True

    with ThreadPoolExecutor(4) as pool:
        won = list(pool.map(try_to_publish, folders))
    assert won.count(True) == 1
    assert [file.path for file in read_manifest(store, bucket, "race").files] == [f"only-{won.index(True)}"]


def test_links_and_pipes_are_refused_before_anything_is_stored(disk: DirectoryStore, outputs: Path, tmp_path: Path):
    (tmp_path / "secret").write_bytes(b"secret")
    for name, make in {
        "link": lambda path: path.symlink_to(tmp_path / "secret"),
        "linked-folder": lambda path: path.symlink_to(tmp_path),
        "dangling": lambda path: path.symlink_to(tmp_path / "nothing"),
        "pipe": os.mkfifo,
    }.items():
        odd = outputs / "logs" / name
        make(odd)
        with pytest.raises(StorageError, match=name):
            publish(disk, "outputs", "run", regular_files(outputs), about=ABOUT, created_at=NOW)
        odd.unlink()
    assert list(disk.list("outputs")) == []


@pytest.mark.parametrize("name", ["manifest.json", "back\\slash", b"not-\xff-utf8"])
def test_names_that_cannot_be_published_are_named_before_anything_is_stored(
    disk: DirectoryStore, outputs: Path, name: str | bytes
):
    (outputs / os.fsdecode(name)).write_bytes(b"")
    with pytest.raises(StorageError, match=r"manifest|slash|utf8"):
        publish(disk, "outputs", "run", regular_files(outputs), about=ABOUT, created_at=NOW)
    assert list(disk.list("outputs")) == []


def test_a_missing_folder_is_named(disk: DirectoryStore, tmp_path: Path):
    with pytest.raises(StorageError, match="no-such-folder"):
        publish(disk, "outputs", "run", regular_files(tmp_path / "no-such-folder"), about=ABOUT, created_at=NOW)


def test_a_file_that_changes_meanwhile_is_no_publication(disk: DirectoryStore, outputs: Path):
    def put_then_write(bucket: str, files: dict[str, Path], **options: Any) -> list[ObjectInfo]:
        done = disk.put_files(bucket, files, **options)
        with (outputs / "logs/agent.log").open("ab") as log:
            log.write(b"one more line\n")
        return done

    with pytest.raises(StorageError, match=r"agent\.log changed"):
        publish(
            wrapped(disk, put_files=put_then_write),
            "outputs",
            "run",
            regular_files(outputs),
            about=ABOUT,
            created_at=NOW,
        )
    with pytest.raises(ObjectNotFoundError):
        read_manifest(disk, "outputs", "run")


def test_objects_without_a_place_in_the_manifest_do_not_count(
    store: ObjectStore, bucket: str, outputs: Path, tmp_path: Path
):
    publish(store, bucket, "run", regular_files(outputs), about=ABOUT, created_at=NOW)
    store.put_bytes(bucket, "run/stray", b"stray")
    fetch(store, bucket, "run", tmp_path / "fetched")
    assert content_of(tmp_path / "fetched") == CONTENT


@pytest.mark.parametrize("damaged", [b"[]", b"longer"], ids=["same-size", "other-size"])
def test_damaged_content_is_found_and_nothing_appears(
    store: ObjectStore, bucket: str, outputs: Path, tmp_path: Path, damaged: bytes
):
    publish(store, bucket, "run", regular_files(outputs), about=ABOUT, created_at=NOW)
    store.put_bytes(bucket, "run/result.json", damaged)
    with pytest.raises(ChecksumMismatchError, match=r"result\.json"):
        fetch(store, bucket, "run", tmp_path / "new" / "fetched")
    assert list((tmp_path / "new").iterdir()) == []


def test_a_missing_object_leaves_no_folder(disk: DirectoryStore, outputs: Path, tmp_path: Path):
    publish(disk, "outputs", "run", regular_files(outputs), about=ABOUT, created_at=NOW)
    disk.delete("outputs", "run/result.json")
    with pytest.raises(ObjectNotFoundError, match=r"result\.json"):
        fetch(disk, "outputs", "run", tmp_path / "new" / "fetched")
    assert list((tmp_path / "new").iterdir()) == []


def test_a_folder_with_something_in_it_is_not_fetched_into(disk: DirectoryStore, outputs: Path, tmp_path: Path):
    publish(disk, "outputs", "run", regular_files(outputs), about=ABOUT, created_at=NOW)
    taken = filled(tmp_path / "taken", {"mine": b"mine"})
    with pytest.raises(StorageError, match="taken"):
        fetch(disk, "outputs", "run", taken)
    assert content_of(taken) == {"mine": b"mine"}
    (tmp_path / "empty").mkdir()
    fetch(disk, "outputs", "run", tmp_path / "empty")


@pytest.mark.parametrize("path", ["../outside", "/etc/outside", "a//b", "", "a\0b", "."])
def test_a_manifest_that_leads_elsewhere_is_refused(disk: DirectoryStore, tmp_path: Path, path: str):
    file = {"path": path, "size_bytes": 0, "sha256": "0" * 64}
    manifest = {"schema_version": 1, "created_at": NOW.isoformat(), "about": {}, "files": [file]}
    disk.put_bytes("outputs", "run/manifest.json", json.dumps(manifest).encode())
    with pytest.raises(StorageError, match="no manifest"):
        fetch(disk, "outputs", "run", tmp_path / "new" / "fetched")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("text", ["", "{}", "[1]", "not json"])
def test_what_is_no_manifest_is_named(disk: DirectoryStore, text: str):
    disk.put_bytes("outputs", "run/manifest.json", text.encode())
    with pytest.raises(StorageError, match=r"run/manifest\.json is no manifest"):
        read_manifest(disk, "outputs", "run")


def test_a_full_disk_leaves_no_manifest(small_disk: Path, tmp_path: Path):
    store = DirectoryStore(small_disk / "objects")
    store.ensure_bucket("outputs")
    filled(tmp_path / "large", {"a": b"x", "b": bytes(900_000), "c": bytes(900_000)})
    with pytest.raises(StorageFullError):
        publish(store, "outputs", "run", regular_files(tmp_path / "large"), about=ABOUT, created_at=NOW)
    with pytest.raises(ObjectNotFoundError):
        read_manifest(store, "outputs", "run")


@pytest.mark.parametrize(
    "objects_before_death",
    [pytest.param(1, marks=pytest.mark.deep), 20, pytest.param(40, marks=pytest.mark.deep)],
)
def test_a_killed_publisher_leaves_no_manifest_or_a_whole_publication(tmp_path: Path, objects_before_death: int):
    filled(tmp_path / "outputs", {f"{index:02}": bytes([index]) * 500_000 for index in range(40)})
    program = (
        "import sys; from datetime import UTC, datetime; from pathlib import Path;"
        "from prefect_robomaker.tasks.storage import publish;"
        "from prefect_robomaker.tasks.files.untrusted_folders import regular_files;"
        "from prefect_robomaker.tasks.storage.directory import DirectoryStore;"
        "store = DirectoryStore(Path(sys.argv[1], 'objects')); store.ensure_bucket('outputs');"
        "files = regular_files(Path(sys.argv[1], 'outputs'));"
        "publish(store, 'outputs', 'run', files, about={}, created_at=datetime.now(UTC))"
    )
    process = subprocess.Popen([sys.executable, "-c", program, str(tmp_path)])
    run = tmp_path / "objects" / "outputs" / "run"
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline and process.poll() is None:
        if run.is_dir() and len(list(run.iterdir())) >= objects_before_death:
            break
        time.sleep(0.001)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert run.is_dir(), "it was killed before it began"
    store = DirectoryStore(tmp_path / "objects")
    if (run / "manifest.json").exists():
        assert len(fetch(store, "outputs", "run", tmp_path / "fetched").files) == 40
    else:
        with pytest.raises(ObjectNotFoundError):
            read_manifest(store, "outputs", "run")
    publish(store, "outputs", "run", regular_files(tmp_path / "outputs"), about={}, created_at=NOW)
    assert len(fetch(store, "outputs", "run", tmp_path / "after").files) == 40


def test_who_may_not_know_that_nothing_is_published_yet_publishes(disk: DirectoryStore, outputs: Path):
    """AWS denies access to objects that do not exist to users who may not list the bucket."""

    def get_bytes(bucket: str, key: str) -> bytes:
        try:
            return disk.get_bytes(bucket, key)
        except ObjectNotFoundError as error:
            raise StorageAccessDeniedError("access denied") from error

    store: Any = wrapped(disk, get_bytes=get_bytes)
    made = publish(store, "outputs", "run", regular_files(outputs), about=ABOUT, created_at=NOW)

    assert made == publish(store, "outputs", "run", regular_files(outputs), about=ABOUT, created_at=NOW)
    assert made == read_manifest(disk, "outputs", "run")


def test_what_is_removed_is_gone_and_nothing_beside_it(store: ObjectStore, bucket: str, outputs: Path):
    for prefix in ("runs/1", "runs/11"):
        publish(store, bucket, prefix, regular_files(outputs), about=ABOUT, created_at=NOW)
    beside = [info.key for info in store.list(bucket, "runs/11")]

    for _ in range(2):
        unpublish(store, bucket, "runs/1")

    assert [info.key for info in store.list(bucket)] == beside
    with pytest.raises(ObjectNotFoundError):
        read_manifest(store, bucket, "runs/1")
    with pytest.raises(StorageError, match="everything in"):
        unpublish(store, bucket, "/")
    publish(store, bucket, "runs/1", regular_files(outputs), about=ABOUT, created_at=NOW)
    assert read_manifest(store, bucket, "runs/1").about == ABOUT
