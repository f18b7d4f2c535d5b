"""A store that waits while the one behind it is away: what is stored again, and what is not."""

import threading
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.schemas.documents.worlds import StoredPlace, WorldDocument
from prefect_robomaker.schemas.wire.errors import ObjectNotFoundError, StorageError, StorageUnavailableError
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.files.untrusted_folders import regular_files
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.service.store_retries import Patience, PatientStore, at_once, patiently
from prefect_robomaker.tasks.simulations.inputs.bundles import world_bundle
from prefect_robomaker.tasks.storage import ObjectStore, publish, read_manifest
from prefect_robomaker.tasks.storage.directory import DirectoryStore

BUCKET = "outputs"
BUNDLE = StoredPlace(bucket=BUCKET, prefix="worlds/a")
WORLD: Any = Resource.new(
    arn="arn:aws:robomaker:us-east-1:000000000000:world/generation-a/world-1",
    kind="world",
    id="generation-a/world-1",
    document=WorldDocument(template="arn", bundle=BUNDLE, description_key="worlds/a/description.json"),
)


class Shaky:
    """A store that stops answering when a file of some name is to be stored, until it is probed."""

    def __init__(self, store: DirectoryStore, breaks_at: str) -> None:
        self._store, self._breaks_at, self._is_away = store, breaks_at, False
        self.stored: Counter[str] = Counter()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._store, name)

    def put_files(self, bucket: str, files: dict[str, Path], **_: Any) -> list[Any]:
        return [self.put_file(bucket, key, path) for key, path in files.items()]

    def put_file(self, bucket: str, key: str, path: Path) -> Any:
        if key.endswith(self._breaks_at):
            self._breaks_at, self._is_away = "nothing", True
        if self._is_away:
            raise StorageUnavailableError("503 Slow Down")
        self.stored[key] += 1
        return self._store.put_file(bucket, key, path)

    def probe(self, bucket: str) -> None:
        self._is_away = False


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "output"
    folder.mkdir()
    for name in ("a", "b", "c", "d"):
        (folder / name).write_text(name * 1000)
    return folder


@pytest.fixture
def directory(tmp_path: Path) -> DirectoryStore:
    store = DirectoryStore(tmp_path / "objects")
    store.ensure_bucket(BUCKET)
    return store


def patient(store: Any) -> PatientStore:
    return PatientStore(store, Patience(60.0, 1.0, sleep=lambda seconds: None))


def test_only_files_that_did_not_arrive_are_stored_again(
    directory: DirectoryStore, folder: Path, service: Service
) -> None:
    shaky = Shaky(directory, breaks_at="/c")

    manifest = publish(patient(shaky), BUCKET, "run", regular_files(folder), about={}, created_at=service.clock())

    assert shaky.stored == {"run/a": 1, "run/b": 1, "run/c": 1, "run/d": 1}
    assert read_manifest(directory, BUCKET, "run") == manifest


def test_all_files_are_answered_for_in_their_order(directory: DirectoryStore, folder: Path) -> None:
    files = {name: folder / name for name in ("d", "a", "c", "b")}

    infos = patient(Shaky(directory, breaks_at="c")).put_files(BUCKET, files)

    assert [info.key for info in infos] == list(files)
    assert infos == [directory.head(BUCKET, name) for name in files]


def test_a_file_of_the_same_size_and_another_content_is_stored_again(
    directory: DirectoryStore, folder: Path, service: Service
) -> None:
    directory.put_bytes(BUCKET, "run/a", b"z" * 1000)
    directory.put_bytes(BUCKET, "run/b", b"b" * 1000)
    shaky = Shaky(directory, breaks_at="nothing")

    store: Any = shaky
    publish(store, BUCKET, "run", regular_files(folder), about={}, created_at=service.clock(), resumes=True)

    assert shaky.stored == {"run/a": 1, "run/c": 1, "run/d": 1}
    assert directory.get_bytes(BUCKET, "run/a") == b"a" * 1000


def test_patience_is_taken_off_and_never_put_on_twice(directory: DirectoryStore, service: Service) -> None:
    once = replace(service, store=directory).patient("sim-1", lambda: False)
    twice = once.patient("sim-2", lambda: False)

    assert at_once(once.store) is at_once(twice.store) is at_once(directory) is directory
    assert patiently(directory, BUCKET, lambda: 7) == 7


def test_those_who_wait_for_a_bundle_do_not_keep_others_from_it(service: Service) -> None:
    """One job waits for the store while it fetches a world; another asks the store itself, and can be stopped."""
    away, stopped, waits, waits_too = (threading.Event() for _ in range(4))

    class Away:
        def __getattr__(self, name: str) -> Any:
            raise StorageUnavailableError("503 Slow Down")

    store: Any = Away()
    first = replace(service, store=store, report_note=lambda text: waits.set()).patient("sim-1", away.is_set)
    second = replace(service, store=store, report_note=lambda text: waits_too.set()).patient("sim-2", stopped.is_set)
    errors: list[Exception] = []

    def fetch(of: Service) -> None:
        try:
            world_bundle(WORLD, of)
        except StorageUnavailableError as error:
            errors.append(error)

    threads = [threading.Thread(target=fetch, args=(each,), daemon=True) for each in (first, second)]
    threads[0].start()
    assert waits.wait(60.0)
    threads[1].start()
    assert waits_too.wait(60.0)
    stopped.set()
    threads[1].join(200.0)
    assert len(errors) == 1
    away.set()
    threads[0].join(200.0)
    assert len(errors) == 2


def test_a_job_that_waits_until_another_has_fetched_a_bundle_hears_that_it_is_stopped(service: Service) -> None:
    fetches, hangs, stopped = threading.Event(), threading.Event(), threading.Event()

    class Slow:
        """A store that takes its time, and is well."""

        def get_bytes(self, *arguments: object) -> bytes:
            fetches.set()
            hangs.wait()
            raise ObjectNotFoundError("gone")

        def probe(self, bucket: str) -> None:
            pass

    store: Any = Slow()
    first = replace(service, store=store).patient("sim-1", lambda: False)
    second = replace(service, store=store).patient("sim-2", stopped.is_set)
    errors: list[Exception] = []

    def fetch(of: Service) -> None:
        try:
            world_bundle(WORLD, of)
        except StorageError as error:
            errors.append(error)

    holder = threading.Thread(target=fetch, args=(first,), daemon=True)
    holder.start()
    assert fetches.wait(60.0)
    waiting = threading.Thread(target=fetch, args=(second,), daemon=True)
    waiting.start()
    stopped.set()
    waiting.join(200.0)
    assert [type(error) for error in errors] == [StorageUnavailableError]
    hangs.set()
    holder.join(200.0)


def test_find_same_of_what_is_not_there(directory: DirectoryStore, folder: Path) -> None:
    assert directory.find_same(BUCKET, "nothing", folder / "a") is None
    assert directory.find_same("no-such-bucket", "nothing", folder / "a") is None
    with pytest.raises(ObjectNotFoundError):
        directory.head(BUCKET, "nothing")
    store: ObjectStore = directory
    store.probe("no-such-bucket")
