"""Interface of all object stores, valid names of buckets and objects, and concurrent calls in threads."""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Literal, Protocol, TypeVar

from ...schemas.wire.errors import StorageError, TransferStoppedError

Item = TypeVar("Item")
Result = TypeVar("Result")

WORKERS = 8
"""Limit of concurrent transfers of files of any size."""

WORKERS_FOR_SMALL = 32
"""Limit of concurrent transfers of small files.

A server that has to wait for the next one spends a third more processor time on each.
"""


def run_all(call: Callable[[Item], Result], items: Iterable[Item], workers: int = WORKERS) -> list[Result]:
    """Calls a function for every item in threads, and returns the results in the items' order.

    After a failure no further calls start; running calls end, then the failure of the earliest item is raised.

    Args:
        call: The function.
        items: Arguments of the calls.
        workers: Number of threads.
    """
    with ThreadPoolExecutor(workers, thread_name_prefix="storage") as pool:
        futures = [pool.submit(call, item) for item in items]
        try:
            wait(futures, return_when=FIRST_EXCEPTION)
        finally:
            for future in futures:
                future.cancel()
    # Only what had not begun is cancelled, and only because something else failed: that one is raised here.
    for future in futures:
        if not future.cancelled():
            future.result()
    return [future.result() for future in futures]


Stopped = Callable[[], bool]
"""Function that returns whether a transfer should stop; called several times a second, from any thread."""


Tell = Callable[[str], None]
"""Function that is called with the key of an object that has been stored, from any thread."""


def never() -> bool:
    """Returns false: the default for transfers that are never stopped."""
    return False


def tell_none(key: str) -> None:
    """Does nothing: the default listener for stored files."""


def refuse_stopped(stopped: Stopped, bucket: str, key: str) -> None:
    """Raises `TransferStoppedError` if `stopped` says that a transfer has to stop.

    Raises:
        TransferStoppedError: `stopped` said so.
    """
    if stopped():
        raise TransferStoppedError(f"{bucket}/{key} is not wanted any more")


@dataclass(frozen=True)
class ObjectInfo:
    """Metadata of an object in the object store: key, size, ETag and time."""

    bucket: str
    key: str
    size_bytes: int
    etag: str
    """ETag of an object, without quotes; it changes whenever the content changes."""
    modified_at: datetime | None = field(default=None, compare=False)
    """Time at which the object was stored; `None`: not known, as of a new object. Comparisons of objects ignore it."""


@dataclass(frozen=True)
class UnfinishedUpload:
    """A multipart upload that was not completed; readers do not see it."""

    bucket: str
    key: str
    upload_id: str
    began_at: datetime


class ObjectStore(Protocol):
    """Interface of an object store with buckets, as S3 has them.

    Writes are atomic: a reader sees the whole old or the whole new content. Every method raises a
    `StorageError` of `prefect_robomaker.schemas.wire.errors`, never a client library's own.
    """

    def ensure_bucket(self, bucket: str) -> None:
        """Creates a bucket of the object store unless it exists."""
        ...

    def check_writable(self, bucket: str, key: str) -> None:
        """Checks that an object could be written; leaves nothing behind.

        Raises:
            StorageAccessDeniedError: The credentials do not allow it.
            BucketNotFoundError: The bucket does not exist.
        """
        ...

    def put_file(self, bucket: str, key: str, path: Path, *, stopped: Stopped = never) -> ObjectInfo:
        """Uploads a file as an object, and returns the object's metadata; checksums are verified.

        Raises:
            TransferStoppedError: `stopped` said so, and the object is as it was before.
        """
        ...

    def probe(self, bucket: str) -> None:
        """Checks quickly, with one request, whether the store answers at all.

        Raises:
            StorageUnavailableError: The store does not answer, or answers that it is unavailable.
        """
        ...

    def find_same(self, bucket: str, key: str, path: Path, *, stopped: Stopped = never) -> ObjectInfo | None:
        """Returns the stored object if it has the same content as a file already, else `None`.

        Returns:
            `None`: there is none, or whether it is the same cannot be known.

        Raises:
            TransferStoppedError: `stopped` said so.
        """
        ...

    def put_files(
        self, bucket: str, files: dict[str, Path], *, stopped: Stopped = never, tell: Tell = tell_none
    ) -> list[ObjectInfo]:
        """Uploads many files concurrently, and returns the stored objects in the order of the files.

        Raises the first error once running uploads have ended; further ones are not begun.

        Args:
            bucket: Name of the bucket.
            files: Files to upload, by their keys.
            stopped: Returns whether to stop; files that are stored by then remain.
            tell: Called with the key of each stored file.
        """
        ...

    def put_bytes(self, bucket: str, key: str, data: bytes, *, create_only: bool = False) -> ObjectInfo:
        """Writes bytes as an object, and returns its metadata; an existing one is replaced unless `create_only` is set.

        Raises:
            ObjectExistsError: `create_only` and something is there.
        """
        ...

    def get_file(self, bucket: str, key: str, path: Path) -> ObjectInfo:
        """Downloads an object to a file, which appears only when complete, and returns the object's metadata.

        Raises `ObjectNotFoundError` if there is no such object.
        """
        ...

    def get_bytes(self, bucket: str, key: str) -> bytes:
        """Returns the content of an object in the object store; raises `ObjectNotFoundError` if there is none."""
        ...

    def head(self, bucket: str, key: str) -> ObjectInfo:
        """Returns the metadata of an object in the object store; raises `ObjectNotFoundError` if there is none."""
        ...

    def list(self, bucket: str, prefix: str = "") -> Iterator[ObjectInfo]:
        """Lists objects of a bucket whose keys start with `prefix`, in key order."""
        ...

    def delete(self, bucket: str, key: str) -> None:
        """Deletes an object from the object store; succeeds if there is none."""
        ...

    def unfinished_uploads(self, bucket: str, before: datetime) -> Sequence[UnfinishedUpload]:
        """Lists multipart uploads that began before a time and have not ended."""
        ...

    def abort_upload(self, upload: UnfinishedUpload) -> None:
        """Deletes the parts of an unfinished upload; succeeds if there are none."""
        ...

    def uri(self, bucket: str, key: str) -> str:
        """Returns an object's address for people: `file:///…` or `s3://bucket/key`."""
        ...

    def local_path(self, bucket: str, key: str) -> Path | None:
        """Returns the local file of an object, if the store keeps objects as files on this machine; else `None`."""
        ...


def put_each(
    store: ObjectStore, bucket: str, files: dict[str, Path], stopped: Stopped, tell: Tell, workers: int = WORKERS
) -> list[ObjectInfo]:
    """Uploads many files one by one, several concurrently, and returns the stored objects in the order of the files.

    Args:
        store: The object store.
        bucket: The bucket.
        files: The files, by the key that each gets.
        stopped: Returns whether to stop; an upload that is stopped raises an error.
        tell: Called with the key of each stored file, from several threads.
        workers: Number of files that are uploaded at once.

    Raises:
        StorageError: A file could not be stored; others may be.
    """

    def put(item: tuple[str, Path]) -> ObjectInfo:
        info = store.put_file(bucket, *item, stopped=stopped)
        tell(info.key)
        return info

    return run_all(put, files.items(), workers)


class StoreOver:
    """Base class of object stores that wrap another one; every call passes through `do`.

    Args:
        store: The store behind it.
    """

    def __init__(self, store: ObjectStore) -> None:
        self.behind = store

    def do(
        self, access: Literal["read", "write"], bucket: str, keys: Iterable[str], call: Callable[[], Result]
    ) -> Result:
        """Calls the wrapped store and returns the result; subclasses change, repeat or refuse the call here.

        Args:
            access: `read` or `write`.
            bucket: The bucket that it is about.
            keys: The keys, or the prefix of keys, that it is about; of the whole bucket an empty one.
            call: The call.
        """
        raise NotImplementedError

    def ensure_bucket(self, bucket: str) -> None:
        """Creates a bucket of the wrapped store unless it exists, as `ObjectStore` says, by a call through `do`."""
        self.do("write", bucket, [""], lambda: self.behind.ensure_bucket(bucket))

    def check_writable(self, bucket: str, key: str) -> None:
        """Checks that an object of the wrapped store could be written, as `ObjectStore` says, by a call of `do`."""
        self.do("write", bucket, [key], lambda: self.behind.check_writable(bucket, key))

    def put_file(self, bucket: str, key: str, path: Path, *, stopped: Stopped = never) -> ObjectInfo:
        """Uploads a file to the wrapped store, as `ObjectStore` says, by a call through `do`."""
        return self.do("write", bucket, [key], lambda: self.behind.put_file(bucket, key, path, stopped=stopped))

    def probe(self, bucket: str) -> None:
        """Checks whether the wrapped store answers at all, as `ObjectStore` says; every role may do this."""
        self.behind.probe(bucket)

    def find_same(self, bucket: str, key: str, path: Path, *, stopped: Stopped = never) -> ObjectInfo | None:
        """Returns the wrapped store's object if it has the content of a file, as `ObjectStore` says, else `None`."""
        return self.do("read", bucket, [key], lambda: self.behind.find_same(bucket, key, path, stopped=stopped))

    def put_files(
        self, bucket: str, files: dict[str, Path], *, stopped: Stopped = never, tell: Tell = tell_none
    ) -> list[ObjectInfo]:
        """Uploads many files to the wrapped store, as `ObjectStore` says, by one call through `do`."""
        return self.do("write", bucket, files, lambda: self.behind.put_files(bucket, files, stopped=stopped, tell=tell))

    def put_bytes(self, bucket: str, key: str, data: bytes, *, create_only: bool = False) -> ObjectInfo:
        """Writes bytes as an object of the wrapped store, as `ObjectStore` says, by a call through `do`.

        With `create_only`, an object that an earlier attempt wrote is an error, too.
        """
        return self.do(
            "write", bucket, [key], lambda: self.behind.put_bytes(bucket, key, data, create_only=create_only)
        )

    def get_file(self, bucket: str, key: str, path: Path) -> ObjectInfo:
        """Downloads an object of the wrapped store to a file, as `ObjectStore` says, by a call through `do`."""
        return self.do("read", bucket, [key], lambda: self.behind.get_file(bucket, key, path))

    def get_bytes(self, bucket: str, key: str) -> bytes:
        """Returns the content of an object of the wrapped store, as `ObjectStore` says, by a call through `do`."""
        return self.do("read", bucket, [key], lambda: self.behind.get_bytes(bucket, key))

    def head(self, bucket: str, key: str) -> ObjectInfo:
        """Returns the metadata of an object of the wrapped store, as `ObjectStore` says, by a call through `do`."""
        return self.do("read", bucket, [key], lambda: self.behind.head(bucket, key))

    def list(self, bucket: str, prefix: str = "") -> Iterator[ObjectInfo]:
        """Lists the wrapped store's objects with a prefix, as `ObjectStore` says; reads all at once, through `do`."""
        return iter(self.do("read", bucket, [prefix], lambda: [*self.behind.list(bucket, prefix)]))

    def delete(self, bucket: str, key: str) -> None:
        """Deletes an object of the wrapped store, as `ObjectStore` says, by a call through `do`."""
        self.do("write", bucket, [key], lambda: self.behind.delete(bucket, key))

    def unfinished_uploads(self, bucket: str, before: datetime) -> Sequence[UnfinishedUpload]:
        """Lists the wrapped store's old unfinished multipart uploads to a whole bucket, as `ObjectStore` says."""
        return self.do("write", bucket, [""], lambda: self.behind.unfinished_uploads(bucket, before))

    def abort_upload(self, upload: UnfinishedUpload) -> None:
        """Deletes the parts of an unfinished upload to the wrapped store, as `ObjectStore` says."""
        self.do("write", upload.bucket, [upload.key], lambda: self.behind.abort_upload(upload))

    def uri(self, bucket: str, key: str) -> str:
        """Returns an object's address in the wrapped store for people, as `ObjectStore` says."""
        return self.behind.uri(bucket, key)

    def local_path(self, bucket: str, key: str) -> Path | None:
        """Returns the local file of the wrapped store's object, as `ObjectStore` says; `None` if it has none."""
        return self.behind.local_path(bucket, key)


_BUCKET = re.compile(r"[a-z0-9][a-z0-9.\-]{1,61}[a-z0-9]")
_ADDRESS = re.compile(r"[0-9]+(\.[0-9]+){3}")
_MAX_KEY_BYTES = 1024
_MAX_COMPONENT_BYTES = 255


def check_bucket(bucket: str) -> None:
    """Raises an error for an invalid bucket name.

    Raises:
        StorageError: With the rule it breaks.
    """
    if not _BUCKET.fullmatch(bucket) or ".." in bucket or _ADDRESS.fullmatch(bucket):
        raise StorageError(
            f"bucket {bucket!r}: a name has 3 to 63 of a-z, 0-9, '.' and '-', starts and ends with a letter or digit, "
            "has no '..' and is no IP address"
        )


def check_key(key: str) -> None:
    """Raises an error for an object key that some store cannot have.

    Raises:
        StorageError: With the component and what is wrong with it.
    """
    encoded = _encoded(key)
    if not encoded:
        raise StorageError("the key is empty; an object needs a name")
    if len(encoded) > _MAX_KEY_BYTES:
        raise StorageError(f"key {key[:60]!r}…: {len(encoded)} bytes; at most {_MAX_KEY_BYTES} are allowed")
    for part in encoded.split(b"/"):
        _check_component(key, part)


def check_prefix(prefix: str) -> None:
    """Raises an error for a key prefix that no valid key starts with.

    Raises:
        StorageError: With the component and what is wrong with it.
    """
    *folders, last = _encoded(prefix).split(b"/")
    for part in folders:
        _check_component(prefix, part)
    if last not in (b"", b".", b".."):  # these can begin a component
        _check_component(prefix, last)


def join_key(prefix: str, *parts: str) -> str:
    """Returns an object key of parts joined with single slashes; empty parts are left out."""
    return "/".join([stripped, *parts]) if (stripped := prefix.strip("/")) else "/".join(parts)


def _encoded(key: str) -> bytes:
    try:
        return key.encode()
    except UnicodeEncodeError:
        raise StorageError(f"key {key!r} cannot be written as UTF-8") from None


def _check_component(key: str, part: bytes) -> None:
    if part in (b"", b".", b".."):
        raise StorageError(f"key {key!r}: the component {part.decode()!r} is not allowed")
    if b"\0" in part or b"\\" in part:
        raise StorageError(f"key {key!r}: NUL and backslash are not allowed")
    if len(part) > _MAX_COMPONENT_BYTES:
        raise StorageError(
            f"key {key[:60]!r}…: a component has {len(part)} bytes; at most {_MAX_COMPONENT_BYTES} are allowed"
        )
