"""What every object store has to do, checked on a directory and on a real S3 server."""

import hashlib
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from uuid import uuid4

import pytest
from helpers.examples import examples
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from prefect_robomaker.schemas.wire.errors import (
    BucketNotFoundError,
    ObjectExistsError,
    ObjectNotFoundError,
    StorageError,
    TransferStoppedError,
)
from prefect_robomaker.tasks.storage.object_store import ObjectStore

BAD_KEYS = [
    "",
    "/a",
    "a/",
    "a//b",
    ".",
    "..",
    "a/../b",
    "../a",
    "./a",
    "a\0b",
    "a\\b",
    "é" * 128,
    "a/" * 512 + "a",
    "\ud800",
]
ODD_KEYS = [
    "a", "a/b/c.txt", "with space/ünïcödé ✓.txt", "arn:aws:robomaker:us-east-1:0:world/x?&=+%25#.txt",
    ".hidden/.file", "...", "a" * 255, "quote'\"<>&;",
]  # fmt: skip


@pytest.mark.parametrize("key", ODD_KEYS)
def test_bytes_come_back_under_any_valid_key(store: ObjectStore, bucket: str, key: str, tmp_path: Path):
    put = store.put_bytes(bucket, key, b"content")
    assert (put.bucket, put.key, put.size_bytes) == (bucket, key, 7)
    assert store.get_bytes(bucket, key) == b"content"
    assert store.head(bucket, key) == put
    assert list(store.list(bucket)) == [put]
    assert store.get_file(bucket, key, tmp_path / "fetched") == put
    assert (tmp_path / "fetched").read_bytes() == b"content"


@pytest.mark.parametrize("key", BAD_KEYS)
def test_keys_that_could_lead_elsewhere_are_refused_everywhere(
    store: ObjectStore, bucket: str, key: str, tmp_path: Path
):
    (tmp_path / "file").write_bytes(b"")
    calls = [
        lambda: store.put_bytes(bucket, key, b""),
        lambda: store.put_file(bucket, key, tmp_path / "file"),
        lambda: store.get_bytes(bucket, key),
        lambda: store.get_file(bucket, key, tmp_path / "fetched"),
        lambda: store.head(bucket, key),
        lambda: store.delete(bucket, key),
    ]
    for call in calls:
        with pytest.raises(StorageError, match="key"):
            call()
    assert list(store.list(bucket)) == []


@pytest.mark.parametrize("name", ["", "ab", "Upper", "with_underscore", "../up", "a" * 64, "-ab", "a..b", "10.0.0.1"])
def test_bucket_names_are_those_of_s3(store: ObjectStore, name: str):
    for call in (store.ensure_bucket, lambda bucket: store.head(bucket, "a"), lambda bucket: list(store.list(bucket))):
        with pytest.raises(StorageError, match="bucket"):
            call(name)


def test_empty_objects_and_their_etag(store: ObjectStore, bucket: str, tmp_path: Path):
    assert store.put_bytes(bucket, "empty", b"").size_bytes == 0
    assert store.get_bytes(bucket, "empty") == b""
    assert store.get_file(bucket, "empty", tmp_path / "empty").etag == hashlib.md5(b"").hexdigest()
    assert (tmp_path / "empty").read_bytes() == b""


def test_etag_is_the_md5_and_follows_the_content(store: ObjectStore, bucket: str, tmp_path: Path):
    path = tmp_path / "file"
    for content in (b"one", b"two", b"one"):
        path.write_bytes(content)
        assert store.put_file(bucket, "key", path).etag == hashlib.md5(content).hexdigest()
        assert store.head(bucket, "key").etag == hashlib.md5(content).hexdigest()


def test_a_large_file_comes_back_whole(store: ObjectStore, bucket: str, tmp_path: Path):
    """20 MB are several parts on S3."""
    content = hashlib.shake_256(b"seed").digest(1000) * 20_000
    (tmp_path / "large").write_bytes(content)
    put = store.put_file(bucket, "large", tmp_path / "large")
    assert put == store.head(bucket, "large")
    assert put.size_bytes == len(content)
    assert store.get_file(bucket, "large", tmp_path / "fetched") == put
    assert (tmp_path / "fetched").read_bytes() == content
    assert store.get_bytes(bucket, "large") == content
    (tmp_path / "large").write_bytes(content[:-1] + b"!")
    assert store.put_file(bucket, "large", tmp_path / "large").etag != put.etag


@pytest.mark.parametrize(("size_mb", "goes_on"), [(1, 0), (20, 0), (20, 1)])
def test_a_transfer_that_is_stopped_leaves_what_was_there(
    store: ObjectStore, bucket: str, size_mb: int, goes_on: int, tmp_path: Path
):
    """20 MB are several parts on S3; the last case stops in the midst of them."""
    (tmp_path / "file").write_bytes(bytes(1000) * 1000 * size_mb)
    store.put_bytes(bucket, "there", b"before")

    for key in ("there", "new"):
        answers = iter([False] * goes_on)
        with pytest.raises(TransferStoppedError, match=f"{bucket}/{key}"):
            store.put_file(bucket, key, tmp_path / "file", stopped=lambda left=answers: next(left, True))

    assert [info.key for info in store.list(bucket)] == ["there"]
    assert store.get_bytes(bucket, "there") == b"before"
    assert store.put_file(bucket, "new", tmp_path / "file", stopped=lambda: False).size_bytes == size_mb * 1_000_000


def test_many_files_in_one_call(store: ObjectStore, bucket: str, tmp_path: Path):
    files = {f"many/{index:02}/file": tmp_path / str(index) for index in range(30)}
    for index, path in enumerate(files.values()):
        path.write_text(f"content {index}")
    stored = store.put_files(bucket, files)
    assert [info.key for info in stored] == list(files)
    assert list(store.list(bucket)) == stored
    assert [store.get_bytes(bucket, key) for key in files] == [path.read_bytes() for path in files.values()]
    assert store.put_files(bucket, {}) == []


def test_the_first_failure_of_many_files_is_raised(store: ObjectStore, bucket: str, tmp_path: Path):
    (tmp_path / "there").write_bytes(b"there")
    files = {"a": tmp_path / "there", "b": tmp_path / "missing", "c": tmp_path / "there"}
    with pytest.raises(StorageError, match="missing"):
        store.put_files(bucket, files)
    assert "b" not in [info.key for info in store.list(bucket)]


def test_create_only_takes_nothing_away(store: ObjectStore, bucket: str):
    store.put_bytes(bucket, "once", b"first", create_only=True)
    with pytest.raises(ObjectExistsError, match="once"):
        store.put_bytes(bucket, "once", b"second", create_only=True)
    assert store.get_bytes(bucket, "once") == b"first"
    store.put_bytes(bucket, "once", b"third")
    assert store.get_bytes(bucket, "once") == b"third"
    store.delete(bucket, "once")
    store.put_bytes(bucket, "once", b"fourth", create_only=True)


def test_of_sixteen_parallel_creators_one_wins(store: ObjectStore, bucket: str):
    together = threading.Barrier(16)

    def create(number: int) -> bool:
        together.wait()
        try:
            store.put_bytes(bucket, "prize", f"{number}".encode(), create_only=True)
        except ObjectExistsError:
            return False
        return True

    with ThreadPoolExecutor(16) as pool:
        won = list(pool.map(create, range(16)))
    assert won.count(True) == 1
    assert store.get_bytes(bucket, "prize") == f"{won.index(True)}".encode()


def test_readers_see_old_or_new_content_never_a_mixture(store: ObjectStore, bucket: str):
    contents = {bytes([letter]) * 300_000 for letter in b"abcd"}
    store.put_bytes(bucket, "changing", next(iter(contents)))

    def write(content: bytes) -> None:
        for _ in range(3):
            store.put_bytes(bucket, "changing", content)

    with ThreadPoolExecutor(len(contents)) as pool:
        writers = [pool.submit(write, content) for content in contents]
        while not all(writer.done() for writer in writers):
            assert store.get_bytes(bucket, "changing") in contents
    for writer in writers:
        writer.result()


def test_what_is_missing_is_named(store: ObjectStore, bucket: str, tmp_path: Path):
    store.put_bytes(bucket, "folder/object", b"")
    for key in ("missing", "folder", "folder/object/below", "folder/missing"):
        for call in (store.head, store.get_bytes, lambda b, k: store.get_file(b, k, tmp_path / "fetched")):
            with pytest.raises(ObjectNotFoundError, match=key):
                call(bucket, key)
    assert list(tmp_path.glob("*fetched*")) == []
    assert list(tmp_path.glob(".*.part")) == []


def test_a_missing_bucket_is_not_a_missing_object(store: ObjectStore, tmp_path: Path):
    nowhere = f"nowhere-{uuid4().hex[:8]}"
    for call in (store.head, store.get_bytes, lambda b, k: store.get_file(b, k, tmp_path / "fetched")):
        with pytest.raises(BucketNotFoundError, match=nowhere):
            call(nowhere, "a")


def test_ensuring_a_bucket_keeps_what_is_in_it(store: ObjectStore, bucket: str):
    store.put_bytes(bucket, "kept", b"kept")
    store.ensure_bucket(bucket)
    assert store.get_bytes(bucket, "kept") == b"kept"


def test_delete_is_final_and_may_be_repeated(store: ObjectStore, bucket: str):
    store.put_bytes(bucket, "a/b/gone", b"")
    store.put_bytes(bucket, "a/kept", b"")
    store.delete(bucket, "a/b/gone")
    store.delete(bucket, "a/b/gone")
    store.delete(bucket, "never/there")
    assert [info.key for info in store.list(bucket)] == ["a/kept"]


def test_a_name_is_free_again_after_the_objects_below_it_are_deleted(store: ObjectStore, bucket: str):
    store.put_bytes(bucket, "a/b/c", b"")
    store.delete(bucket, "a/b/c")
    store.put_bytes(bucket, "a", b"now an object")
    assert [info.key for info in store.list(bucket)] == ["a"]


@pytest.mark.parametrize(
    ("prefix", "expected"),
    [
        ("", ["a-b", "a.b", "a/1", "a/2/x", "a0", "b", "é"]),
        ("a", ["a-b", "a.b", "a/1", "a/2/x", "a0"]),
        ("a/", ["a/1", "a/2/x"]),
        ("a/2", ["a/2/x"]),
        ("a/2/x", ["a/2/x"]),
        ("a/2/x/", []),
        ("missing/", []),
        ("..", []),
        ("é", ["é"]),
    ],
)
def test_listing_by_prefix_in_the_order_of_keys(store: ObjectStore, bucket: str, prefix: str, expected: list[str]):
    for key in ("a/2/x", "b", "a0", "a/1", "a-b", "é", "a.b"):
        store.put_bytes(bucket, key, b"")
    assert [info.key for info in store.list(bucket, prefix)] == expected


@pytest.mark.parametrize("prefix", ["../", "/", "a//", "a/../"])
def test_prefixes_that_lead_elsewhere_are_refused(store: ObjectStore, bucket: str, prefix: str):
    with pytest.raises(StorageError, match="key"):
        list(store.list(bucket, prefix))


component = st.text(st.sampled_from("ab.- é"), min_size=1, max_size=3).filter(lambda text: text not in (".", ".."))
keys = st.lists(component, min_size=1, max_size=3).map("/".join)
operations = st.lists(
    st.one_of(
        st.tuples(st.just("put"), keys, st.binary(max_size=4)),
        st.tuples(st.just("create"), keys, st.binary(max_size=4)),
        st.tuples(st.just("delete"), keys, st.just(b"")),
    ),
    max_size=12,
)


@examples(20, suppress_health_check=(HealthCheck.function_scoped_fixture,))
@given(operations)
def test_any_sequence_of_writes_behaves_like_a_dictionary(
    store: ObjectStore, bucket: str, steps: list[tuple[str, str, bytes]]
):
    prefix = uuid4().hex  # folders of deleted objects linger on the server and make keys look taken
    model: dict[str, bytes] = {}
    used: set[str] = set()
    for verb, name, data in steps:
        key = f"{prefix}/{name}"
        if any(other.startswith(f"{key}/") or key.startswith(f"{other}/") for other in used):
            continue  # a directory cannot hold both `a` and `a/b`
        used.add(key)
        if verb == "delete":
            store.delete(bucket, key)
            model.pop(key, None)
        elif verb == "create" and key in model:
            with pytest.raises(ObjectExistsError):
                store.put_bytes(bucket, key, data, create_only=True)
        else:
            store.put_bytes(bucket, key, data, create_only=verb == "create")
            model[key] = data
    listed = {info.key: info for info in store.list(bucket, prefix)}
    assert list(listed) == sorted(model, key=str.encode)
    assert {key: store.get_bytes(bucket, key) for key in model} == model
    assert {key: store.head(bucket, key) for key in model} == listed


def test_a_file_that_is_stored_already_is_found_by_its_content(store: ObjectStore, bucket: str, tmp_path: Path):
    (tmp_path / "file").write_bytes(b"content")
    put = store.put_file(bucket, "a/file", tmp_path / "file")
    assert store.find_same(bucket, "a/file", tmp_path / "file") == put
    for other in (b"tnetnoc", b"content and more", b""):
        (tmp_path / "file").write_bytes(other)
        assert store.find_same(bucket, "a/file", tmp_path / "file") is None
    assert store.find_same(bucket, "a/missing", tmp_path / "file") is None
    assert store.find_same("no-such-bucket-here", "a/file", tmp_path / "file") is None


def test_a_large_file_that_is_stored_already_is_found_by_its_content(store: ObjectStore, bucket: str, tmp_path: Path):
    content = bytes(range(256)) * (17 << 12)
    (tmp_path / "large").write_bytes(content)
    put = store.put_file(bucket, "large", tmp_path / "large")
    assert store.find_same(bucket, "large", tmp_path / "large") == put
    (tmp_path / "large").write_bytes(content[:-1] + b"x")
    assert store.find_same(bucket, "large", tmp_path / "large") is None


def test_a_store_that_is_there_answers_a_probe_whatever_the_bucket(store: ObjectStore, bucket: str):
    store.probe(bucket)
    store.probe("no-such-bucket-here")
