"""The interface of all object stores."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Protocol

from ...schemas.wire.errors import TransferStoppedError

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
