"""The interface of all object stores."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Literal, Protocol, TypeVar

from ...schemas.wire.errors import TransferStoppedError
from .parallel import WORKERS, run_all

Result = TypeVar("Result")

Stopped = Callable[[], bool]
"""Whether a transfer is not wanted any more; asked several times a second, from any thread."""


Tell = Callable[[str], None]
"""Told of the key of an object that has been stored, from any thread."""


def never() -> bool:
    """For transfers that are never stopped."""
    return False


def tell_none(key: str) -> None:
    """Ignores what is stored, where there is no listener."""


def refuse_stopped(stopped: Stopped, bucket: str, key: str) -> None:
    """Raises what a transfer raises that is not wanted any more.

    Raises:
        TransferStoppedError: `stopped` said so.
    """
    if stopped():
        raise TransferStoppedError(f"{bucket}/{key} is not wanted any more")


@dataclass(frozen=True)
class ObjectInfo:
    """Metadata of a stored object, known without reading it."""

    bucket: str
    key: str
    size_bytes: int
    etag: str
    """Changes whenever the content changes; without quotes."""


@dataclass(frozen=True)
class UnfinishedUpload:
    """Parts of a file that has not been uploaded to its end; no reader sees them."""

    bucket: str
    key: str
    upload_id: str
    began_at: datetime


class ObjectStore(Protocol):
    """Buckets of objects, as S3 has them.

    Writes are atomic: a reader sees the whole old or the whole new content. Every method raises a
    `StorageError` of `prefect_robomaker.schemas.wire.errors`, never a client library's own.
    """

    def ensure_bucket(self, bucket: str) -> None:
        """Creates the bucket unless it exists."""
        ...

    def check_writable(self, bucket: str, key: str) -> None:
        """Finds out whether an object could be stored; no object is there afterwards that was not before.

        Raises:
            StorageAccessDeniedError: the credentials do not allow it.
            BucketNotFoundError: there is no such bucket.
        """
        ...

    def put_file(self, bucket: str, key: str, path: Path, *, stopped: Stopped = never) -> ObjectInfo:
        """Stores a file's content; checksums are verified by the receiving side.

        Raises:
            TransferStoppedError: `stopped` said so, and the object is as it was before.
        """
        ...

    def probe(self, bucket: str) -> None:
        """Asks once, and for a few seconds at most, whether the store answers; what it answers does not matter.

        Raises:
            StorageUnavailableError: it does not, or says that it cannot now.
        """
        ...

    def find_same(self, bucket: str, key: str, path: Path, *, stopped: Stopped = never) -> ObjectInfo | None:
        """Finds an object that has a file's content already: its size, and its checksum as the store has it.

        Returns:
            `None`: there is none, or whether it is the same cannot be known.

        Raises:
            TransferStoppedError: `stopped` said so.
        """
        ...

    def put_files(
        self, bucket: str, files: dict[str, Path], *, stopped: Stopped = never, tell: Tell = tell_none
    ) -> list[ObjectInfo]:
        """Stores many files, several at a time; raises the first error after all have ended.

        Args:
            bucket: where to.
            files: what to store, by keys.
            stopped: see `put_file`; what is stored by then stays.
            tell: told of each file that is stored.
        """
        ...

    def put_bytes(self, bucket: str, key: str, data: bytes, *, create_only: bool = False) -> ObjectInfo:
        """Stores bytes.

        Raises:
            ObjectExistsError: `create_only` and something is there.
        """
        ...

    def get_file(self, bucket: str, key: str, path: Path) -> ObjectInfo:
        """Fetches an object into a file, which appears only when it is whole."""
        ...

    def get_bytes(self, bucket: str, key: str) -> bytes:
        """Fetches an object's content."""
        ...

    def head(self, bucket: str, key: str) -> ObjectInfo:
        """Says what is known of an object."""
        ...

    def list(self, bucket: str, prefix: str = "") -> Iterator[ObjectInfo]:
        """Lists objects whose keys start with `prefix`, in key order."""
        ...

    def delete(self, bucket: str, key: str) -> None:
        """Removes an object; succeeds when there is none."""
        ...

    def unfinished_uploads(self, bucket: str, before: datetime) -> Sequence[UnfinishedUpload]:
        """Uploads that began before a time and have not ended: of writers that died, or that are very slow."""
        ...

    def abort_upload(self, upload: UnfinishedUpload) -> None:
        """Removes the parts of an upload; succeeds when there are none."""
        ...

    def uri(self, bucket: str, key: str) -> str:
        """Address of an object for people: `file:///…` or `s3://bucket/key`."""
        ...

    def local_path(self, bucket: str, key: str) -> Path | None:
        """The object's own file, where the store keeps objects as files on this machine."""
        ...


def put_each(
    store: ObjectStore, bucket: str, files: dict[str, Path], stopped: Stopped, tell: Tell, workers: int = WORKERS
) -> list[ObjectInfo]:
    """Stores many files one by one, several at a time; see `ObjectStore.put_files`."""

    def put(item: tuple[str, Path]) -> ObjectInfo:
        info = store.put_file(bucket, *item, stopped=stopped)
        tell(info.key)
        return info

    return run_all(put, files.items(), workers)


class StoreOver:
    """An `ObjectStore` over another one; each call that reads or writes goes through `do`.

    Args:
        store: the store behind it.
    """

    def __init__(self, store: ObjectStore) -> None:
        self.behind = store

    def do(
        self, access: Literal["read", "write"], bucket: str, keys: Iterable[str], call: Callable[[], Result]
    ) -> Result:
        """Calls the store behind this one, or refuses to.

        Args:
            access: what the call does.
            bucket: the bucket that it is about.
            keys: the keys, or the prefix of keys, that it is about; of the whole bucket an empty one.
            call: the call.
        """
        raise NotImplementedError

    def ensure_bucket(self, bucket: str) -> None:
        """See `ObjectStore`."""
        self.do("write", bucket, [""], lambda: self.behind.ensure_bucket(bucket))

    def check_writable(self, bucket: str, key: str) -> None:
        """See `ObjectStore`."""
        self.do("write", bucket, [key], lambda: self.behind.check_writable(bucket, key))

    def put_file(self, bucket: str, key: str, path: Path, *, stopped: Stopped = never) -> ObjectInfo:
        """See `ObjectStore`."""
        return self.do("write", bucket, [key], lambda: self.behind.put_file(bucket, key, path, stopped=stopped))

    def probe(self, bucket: str) -> None:
        """See `ObjectStore`; everybody may."""
        self.behind.probe(bucket)

    def find_same(self, bucket: str, key: str, path: Path, *, stopped: Stopped = never) -> ObjectInfo | None:
        """See `ObjectStore`."""
        return self.do("read", bucket, [key], lambda: self.behind.find_same(bucket, key, path, stopped=stopped))

    def put_files(
        self, bucket: str, files: dict[str, Path], *, stopped: Stopped = never, tell: Tell = tell_none
    ) -> list[ObjectInfo]:
        """See `ObjectStore`."""
        return self.do("write", bucket, files, lambda: self.behind.put_files(bucket, files, stopped=stopped, tell=tell))

    def put_bytes(self, bucket: str, key: str, data: bytes, *, create_only: bool = False) -> ObjectInfo:
        """See `ObjectStore`; with `create_only`, what an earlier attempt of a call wrote is in its way, too."""
        return self.do(
            "write", bucket, [key], lambda: self.behind.put_bytes(bucket, key, data, create_only=create_only)
        )

    def get_file(self, bucket: str, key: str, path: Path) -> ObjectInfo:
        """See `ObjectStore`."""
        return self.do("read", bucket, [key], lambda: self.behind.get_file(bucket, key, path))

    def get_bytes(self, bucket: str, key: str) -> bytes:
        """See `ObjectStore`."""
        return self.do("read", bucket, [key], lambda: self.behind.get_bytes(bucket, key))

    def head(self, bucket: str, key: str) -> ObjectInfo:
        """See `ObjectStore`."""
        return self.do("read", bucket, [key], lambda: self.behind.head(bucket, key))

    def list(self, bucket: str, prefix: str = "") -> Iterator[ObjectInfo]:
        """See `ObjectStore`."""
        return iter(self.do("read", bucket, [prefix], lambda: [*self.behind.list(bucket, prefix)]))

    def delete(self, bucket: str, key: str) -> None:
        """See `ObjectStore`."""
        self.do("write", bucket, [key], lambda: self.behind.delete(bucket, key))

    def unfinished_uploads(self, bucket: str, before: datetime) -> Sequence[UnfinishedUpload]:
        """See `ObjectStore`; it is about the whole bucket."""
        return self.do("write", bucket, [""], lambda: self.behind.unfinished_uploads(bucket, before))

    def abort_upload(self, upload: UnfinishedUpload) -> None:
        """See `ObjectStore`."""
        self.do("write", upload.bucket, [upload.key], lambda: self.behind.abort_upload(upload))

    def uri(self, bucket: str, key: str) -> str:
        """See `ObjectStore`."""
        return self.behind.uri(bucket, key)

    def local_path(self, bucket: str, key: str) -> Path | None:
        """See `ObjectStore`."""
        return self.behind.local_path(bucket, key)
