"""An object store that waits while the one behind it is away."""

from collections.abc import Callable, Iterator, Sequence
from datetime import datetime
from pathlib import Path
from typing import TypeVar

from ..storage import ObjectInfo, ObjectStore, split_stored
from ..storage.base import Stopped, Tell, UnfinishedUpload, never, tell_none
from .patience import Patience

Result = TypeVar("Result")


class PatientStore:
    """An `ObjectStore` whose calls outlast that the store behind it does not answer, or is full.

    Of files that are stored together, only those are stored again that did not arrive.

    Args:
        store: the store behind it.
        patience: how long it is waited for.
    """

    def __init__(self, store: ObjectStore, patience: Patience) -> None:
        self.at_once = store
        self.patience = patience

    def over(self, store: ObjectStore) -> "PatientStore":
        """Another store, with the same patience."""
        return PatientStore(store, self.patience)

    def ask(self, bucket: str, call: Callable[[], Result]) -> Result:
        """Does something with the store behind this one, again until that answers; see `Patience.ask`."""
        return self.patience.ask(call, lambda: self.at_once.probe(bucket))

    def ensure_bucket(self, bucket: str) -> None:
        """See `ObjectStore`."""
        self.ask(bucket, lambda: self.at_once.ensure_bucket(bucket))

    def check_writable(self, bucket: str, key: str) -> None:
        """See `ObjectStore`."""
        self.ask(bucket, lambda: self.at_once.check_writable(bucket, key))

    def put_file(self, bucket: str, key: str, path: Path, *, stopped: Stopped = never) -> ObjectInfo:
        """See `ObjectStore`."""
        return self.ask(bucket, lambda: self.at_once.put_file(bucket, key, path, stopped=stopped))

    def probe(self, bucket: str) -> None:
        """See `ObjectStore`; this does not wait."""
        self.at_once.probe(bucket)

    def find_same(self, bucket: str, key: str, path: Path, *, stopped: Stopped = never) -> ObjectInfo | None:
        """See `ObjectStore`."""
        return self.ask(bucket, lambda: self.at_once.find_same(bucket, key, path, stopped=stopped))

    def put_files(
        self, bucket: str, files: dict[str, Path], *, stopped: Stopped = never, tell: Tell = tell_none
    ) -> list[ObjectInfo]:
        """See `ObjectStore`."""
        stored: dict[str, ObjectInfo] = {}
        tries = 0

        def put() -> list[ObjectInfo]:
            nonlocal tries
            tries += 1
            left = files
            if tries > 1:
                there, left = split_stored(self.at_once, bucket, files, stopped)
                stored.update(there)
                for key in there:
                    tell(key)
            infos = dict(zip(left, self.at_once.put_files(bucket, left, stopped=stopped, tell=tell), strict=True))
            return [infos.get(key) or stored[key] for key in files]

        return self.ask(bucket, put)

    def put_bytes(self, bucket: str, key: str, data: bytes, *, create_only: bool = False) -> ObjectInfo:
        """See `ObjectStore`; with `create_only`, what an earlier attempt of this very call wrote is in the way too."""
        return self.ask(bucket, lambda: self.at_once.put_bytes(bucket, key, data, create_only=create_only))

    def get_file(self, bucket: str, key: str, path: Path) -> ObjectInfo:
        """See `ObjectStore`."""
        return self.ask(bucket, lambda: self.at_once.get_file(bucket, key, path))

    def get_bytes(self, bucket: str, key: str) -> bytes:
        """See `ObjectStore`."""
        return self.ask(bucket, lambda: self.at_once.get_bytes(bucket, key))

    def head(self, bucket: str, key: str) -> ObjectInfo:
        """See `ObjectStore`."""
        return self.ask(bucket, lambda: self.at_once.head(bucket, key))

    def list(self, bucket: str, prefix: str = "") -> Iterator[ObjectInfo]:
        """See `ObjectStore`."""
        yield from self.ask(bucket, lambda: [*self.at_once.list(bucket, prefix)])

    def delete(self, bucket: str, key: str) -> None:
        """See `ObjectStore`."""
        self.ask(bucket, lambda: self.at_once.delete(bucket, key))

    def unfinished_uploads(self, bucket: str, before: datetime) -> Sequence[UnfinishedUpload]:
        """See `ObjectStore`."""
        return self.ask(bucket, lambda: self.at_once.unfinished_uploads(bucket, before))

    def abort_upload(self, upload: UnfinishedUpload) -> None:
        """See `ObjectStore`."""
        self.ask(upload.bucket, lambda: self.at_once.abort_upload(upload))

    def uri(self, bucket: str, key: str) -> str:
        """See `ObjectStore`."""
        return self.at_once.uri(bucket, key)

    def local_path(self, bucket: str, key: str) -> Path | None:
        """See `ObjectStore`."""
        return self.at_once.local_path(bucket, key)


def at_once(store: ObjectStore) -> ObjectStore:
    """The same store without patience: for what must not be held for long, such as a lock that others wait for."""
    return store.at_once if isinstance(store, PatientStore) else store


def patiently(store: ObjectStore, bucket: str, call: Callable[[], Result]) -> Result:
    """Does something that uses `at_once(store)`, with the patience that the store has; see `Patience.ask`.

    Args:
        store: the store, patient or not.
        bucket: which bucket it is about.
        call: what to do; safe to do again after half of it was done.
    """
    return store.ask(bucket, call) if isinstance(store, PatientStore) else call()


def stopped_of(store: ObjectStore) -> Stopped:
    """Answer to whether those who use a store have been told to stop."""
    return store.patience.stopped if isinstance(store, PatientStore) else never
