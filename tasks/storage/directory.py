"""Object store that keeps objects as files of a directory: needs no server, survives crashes, works with any tool.

`<root>/<bucket>/<key>` is the object; `<root>/.incoming` holds what is being written. A write goes to
`.incoming`, reaches the disk, and only then gets its name, by one step that either happens or does
not. A key cannot be both an object and the folder of other objects (`a` and `a/b`). The root and buckets may be links
to other disks; links below a bucket are neither objects nor folders of some: they could lead anywhere.
"""

import hashlib
import os
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO
from uuid import uuid4

from ...schemas.wire.errors import (
    BucketNotFoundError,
    ObjectExistsError,
    ObjectNotFoundError,
    StorageAccessDeniedError,
    StorageError,
)
from ..files.untrusted_folders import open_regular, os_failures
from ..files.whole_files import replaced
from .checksums import copy_with_holes, etag_of, store_etag
from .object_store import (
    ObjectInfo,
    Stopped,
    Tell,
    UnfinishedUpload,
    check_bucket,
    check_key,
    check_prefix,
    never,
    put_each,
    refuse_stopped,
    tell_none,
)

_ABANDONED_AFTER_S = 86_400.0
_RACES = 20


class DirectoryStore:
    """Object store in a local directory.

    Args:
        root: The directory; it is created with the first bucket.
        clock: Seconds since the epoch.
    """

    def __init__(self, root: Path, *, clock: Callable[[], float] = time.time) -> None:
        self._clock = clock
        self._root = root.absolute()
        self._incoming = self._root / ".incoming"  # no bucket's name starts with a dot

    def ensure_bucket(self, bucket: str) -> None:
        """Creates a bucket (a folder) unless it exists, and deletes old temporary files that crashed writers left."""
        check_bucket(bucket)
        with os_failures(f"create the bucket {bucket} in {self._root}"):
            for folder in (self._incoming, self._root / bucket):
                folder.mkdir(parents=True, exist_ok=True)
            _sync(self._root)
            self._remove_abandoned()

    def check_writable(self, bucket: str, key: str) -> None:
        """Checks that the bucket's folder exists and can be written to.

        Raises:
            StorageAccessDeniedError: This user may not write to the folder, or the file system is read-only.
            BucketNotFoundError: The bucket's folder does not exist.
            StorageFullError: The disk is full.
        """
        check_bucket(bucket)
        check_key(key)
        if not (self._root / bucket).is_dir():
            raise BucketNotFoundError(f"there is no bucket {bucket!r} in {self._root}")
        with os_failures(f"write to {self._root}"), self._written(bucket, key, b"probe"):
            pass  # it has no name yet, and is removed
        if not os.access(self._root / bucket, os.W_OK | os.X_OK):
            raise StorageAccessDeniedError(f"cannot write {bucket}/{key}: this user may not write to its folder")

    def put_file(self, bucket: str, key: str, path: Path, *, stopped: Stopped = never) -> ObjectInfo:
        """Copies a file into the store as an object, and returns the object's metadata.

        Raises:
            TransferStoppedError: `stopped` said so, and the object is as it was before.
            StorageError: Also when the file is written to while it is being stored.
        """
        with os_failures(f"store {path} as {bucket}/{key}"), path.open("rb") as source:
            before = os.fstat(source.fileno())
            with self._written(bucket, key, source.fileno(), stopped) as (temporary, info):
                after = os.fstat(source.fileno())
                if (info.size_bytes, after.st_mtime_ns) != (before.st_size, before.st_mtime_ns):
                    raise StorageError(f"cannot store {path} as {bucket}/{key}: it was written to meanwhile")
                self._name(temporary, info, create_only=False)
            return info

    def probe(self, bucket: str) -> None:
        """Checks whether the bucket's folder answers, as a network file system may not; a missing folder is no error.

        Raises `StorageUnavailableError` if it does not answer.
        """
        check_bucket(bucket)
        with os_failures(f"look into {self._root}"), suppress(FileNotFoundError, PermissionError, NotADirectoryError):
            (self._root / bucket).stat()

    def find_same(self, bucket: str, key: str, path: Path, *, stopped: Stopped = never) -> ObjectInfo | None:
        """Returns the stored object if it has the same size and MD5 as a local file.

        Returns `None` if the object differs or does not exist. Raises `StorageError` if the file cannot be read, and
        `TransferStoppedError` if `stopped` says so.
        """
        refuse_stopped(stopped, bucket, key)
        with suppress(ObjectNotFoundError, BucketNotFoundError):
            found = self.head(bucket, key)
            with os_failures(f"read {path}"), open_regular(path) as content:
                size = os.fstat(content.fileno()).st_size
                if found.size_bytes == size and found.etag == etag_of(content.fileno(), stopped):
                    return found
        return None

    def put_files(
        self, bucket: str, files: dict[str, Path], *, stopped: Stopped = never, tell: Tell = tell_none
    ) -> list[ObjectInfo]:
        """Copies many files into the store concurrently, and returns the stored objects in the order of the files.

        Raises the first error once running copies have ended; further ones are not begun.
        """
        return put_each(self, bucket, files, stopped, tell)

    def put_bytes(self, bucket: str, key: str, data: bytes, *, create_only: bool = False) -> ObjectInfo:
        """Writes bytes as an object, and returns its metadata; an existing one is replaced unless `create_only` is set.

        Raises:
            ObjectExistsError: `create_only` and something is there.
        """
        with (
            os_failures(f"store {bucket}/{key}"),
            self._written(bucket, key, data) as (temporary, info),
        ):
            self._name(temporary, info, create_only=create_only)
            return info

    def get_file(self, bucket: str, key: str, path: Path) -> ObjectInfo:
        """Copies an object to a file, which appears only when complete, and returns what is known of the object.

        Raises `ObjectNotFoundError` if there is no such object, and `StorageError` if the file cannot be written. An
        earlier file is replaced; no part of a new one remains after an error.
        """
        with (
            self._opened(bucket, key) as (source, info),
            os_failures(f"fetch {bucket}/{key} into {path}"),
            replaced(path) as part,
            part.open("xb") as target,
        ):
            copy_with_holes(source.fileno(), target)
            return info

    def get_bytes(self, bucket: str, key: str) -> bytes:
        """Returns the content of an object, which is a local file; raises `ObjectNotFoundError` if there is none."""
        with self._opened(bucket, key) as (source, _), os_failures(f"read {bucket}/{key}"):
            return source.read()

    def head(self, bucket: str, key: str) -> ObjectInfo:
        """Returns the metadata of an object, which is a local file; raises `ObjectNotFoundError` if there is none."""
        with self._opened(bucket, key) as (_, info):
            return info

    def list(self, bucket: str, prefix: str = "") -> Iterator[ObjectInfo]:
        """Lists objects whose keys start with `prefix`, in key order; objects that disappear meanwhile are left out.

        Nothing is listed behind symbolic links. Raises `BucketNotFoundError` if there is no such bucket.
        """
        check_prefix(prefix)
        folder = self._bucket_path(bucket)
        if _link_above(folder, folder / f"{prefix}_"):
            return
        with os_failures(f"list {bucket}/{prefix}"):
            for key in _keys(folder, prefix):
                with suppress(ObjectNotFoundError):  # deleted since its name was read
                    yield self.head(bucket, key)

    def delete(self, bucket: str, key: str) -> None:
        """Deletes an object, and folders that become empty; succeeds if there is none."""
        path = self._path(bucket, key)
        bucket_path = self._bucket_path(bucket)
        with os_failures(f"delete {bucket}/{key}"):
            _refuse_link(bucket_path, path)
            with suppress(FileNotFoundError, NotADirectoryError, IsADirectoryError):
                path.unlink()
            for folder in path.parents:
                if folder == bucket_path or not _remove_empty(folder):
                    break

    def unfinished_uploads(self, bucket: str, before: datetime) -> Sequence[UnfinishedUpload]:  # noqa: ARG002
        """Returns nothing: this store has no multipart uploads, and cleans up after crashed writers by itself."""
        return ()

    def abort_upload(self, upload: UnfinishedUpload) -> None:
        """Does nothing: this store has no multipart uploads."""

    def uri(self, bucket: str, key: str) -> str:
        """Returns the object's `file:///…` URI."""
        return self._path(bucket, key).as_uri()

    def local_path(self, bucket: str, key: str) -> Path | None:
        """Returns the object's local file, which must not be written to; it need not exist.

        Returns `None` if a symbolic link leads to it.
        """
        path = self._path(bucket, key)
        return None if _link_above(self._root / bucket, path) else path

    def _path(self, bucket: str, key: str) -> Path:
        check_bucket(bucket)
        check_key(key)
        return self._root / bucket / key

    def _bucket_path(self, bucket: str) -> Path:
        check_bucket(bucket)
        folder = self._root / bucket
        if not folder.is_dir():
            raise BucketNotFoundError(f"there is no bucket {bucket!r} in {self._root}")
        return folder

    def _not_found(self, bucket: str, key: str) -> StorageError:
        self._bucket_path(bucket)
        return ObjectNotFoundError(f"there is no object {key!r} in bucket {bucket!r} of {self._root}")

    @contextmanager
    def _opened(self, bucket: str, key: str) -> Generator[tuple[BinaryIO, ObjectInfo]]:
        """Opens an object for reading inside the `with` block, and yields its content and what is known of it.

        Reads give one version of it, also when another one takes its name meanwhile. Raises `ObjectNotFoundError` if
        there is none, or if a symbolic link leads to it.
        """
        path = self._path(bucket, key)
        with os_failures(f"read {bucket}/{key}"):
            try:
                if _link_above(self._root / bucket, path):
                    raise self._not_found(bucket, key)
                source = open_regular(path)
            except FileNotFoundError:
                raise self._not_found(bucket, key) from None
            with source:
                status = os.fstat(source.fileno())
                # Nothing sets this time, as copies with their times set that of the last change of content.
                stored_at = datetime.fromtimestamp(status.st_ctime, UTC)
                yield source, ObjectInfo(bucket, key, status.st_size, etag_of(source.fileno()), stored_at)

    @contextmanager
    def _written(
        self, bucket: str, key: str, source: int | bytes, stopped: Stopped = never
    ) -> Generator[tuple[Path, ObjectInfo]]:
        """Yields a temporary file with a source's content, complete inside the `with` block and deleted at its end.

        The source is the descriptor of a file, whose holes stay holes, or the content itself.
        """
        check_key(key)
        self._bucket_path(bucket)
        self._incoming.mkdir(exist_ok=True)
        temporary = self._incoming / f"{os.getpid()}-{uuid4().hex}"
        digest = hashlib.md5(usedforsecurity=False)
        refuse_stopped(stopped, bucket, key)
        try:
            with temporary.open("xb") as target:
                if isinstance(source, bytes):
                    size = target.write(source)
                    digest.update(source)
                else:
                    size = copy_with_holes(source, target, stopped, digest.update, f"{bucket}/{key}")
                target.flush()
                os.fsync(target.fileno())
            yield temporary, ObjectInfo(bucket, key, size, digest.hexdigest())
        finally:
            temporary.unlink(missing_ok=True)

    def _name(self, temporary: Path, info: ObjectInfo, *, create_only: bool) -> None:
        """Gives a written temporary file the object's name atomically, so that readers never see half of it.

        Raises `ObjectExistsError` if `create_only` is set and the object exists, and `StorageError` if the key is the
        folder of other objects, or their object.
        """
        bucket, key = info.bucket, info.key
        path = self._root / bucket / key
        for _ in range(_RACES):
            try:
                _refuse_link(self._root / bucket, path)
                _make_folders(path.parent, self._root / bucket)
                if create_only:
                    path.hardlink_to(temporary)  # unlike renaming, fails where something is
                else:
                    with temporary.open("rb") as written:
                        temporary.replace(path)
                        store_etag(written.fileno(), info.etag)
            except FileNotFoundError:
                continue  # a delete has just removed a folder that had become empty
            except (FileExistsError, IsADirectoryError, NotADirectoryError) as error:
                if create_only and path.is_file():
                    raise ObjectExistsError(f"{bucket}/{key} exists already in {self._root}") from error
                raise StorageError(
                    f"cannot store {bucket}/{key}: in a directory a key cannot be both an object and the folder of "
                    f"others, and {error.filename2 or error.filename} is there"
                ) from error
            _sync(path.parent)
            return
        raise StorageError(f"cannot store {bucket}/{key}: its folder was removed {_RACES} times meanwhile")

    def _remove_abandoned(self) -> None:
        """Deletes temporary files that crashed writers left a day ago or earlier."""
        with os.scandir(self._incoming) as entries:
            for entry in entries:
                with suppress(FileNotFoundError):
                    if self._clock() - entry.stat(follow_symlinks=False).st_mtime > _ABANDONED_AFTER_S:
                        os.unlink(entry.path)  # noqa: PTH108 - entries of scandir have strings


def _keys(folder: Path, prefix: str) -> Iterator[str]:
    """Yields the keys of all regular files below a folder that start with the prefix, in UTF-8 byte order.

    Symbolic links are left out, and a folder that does not exist yields nothing.
    """
    start, _, beginning = prefix.rpartition("/")
    start = f"{start}/" if start else ""
    try:
        with os.scandir(folder / start) as entries:
            # A folder sorts as its keys do: with a slash after its name.
            names = [
                f"{entry.name}/" if entry.is_dir(follow_symlinks=False) else entry.name
                for entry in entries
                if entry.name.startswith(beginning) and not entry.is_symlink()
            ]
    except (FileNotFoundError, NotADirectoryError):
        return
    for name in sorted(names, key=os.fsencode):
        if name.endswith("/"):
            yield from _keys(folder, start + name)
        else:
            yield start + name


def _link_above(top: Path, path: Path) -> Path | None:
    """Returns the first symbolic link among the folders between `top` and a file (which need not exist).

    Returns `None` if there is none.
    """
    folder = str(top)
    for name in path.relative_to(top).parts[:-1]:  # plain strings: each stored file is checked, and paths cost as much
        folder = f"{folder}/{name}"
        if os.path.islink(folder):  # noqa: PTH114
            return Path(folder)
    return None


def _refuse_link(top: Path, path: Path) -> None:
    if link := _link_above(top, path):
        raise StorageError(f"{link} is a symbolic link; remove it: nothing is stored or deleted behind links")


def _make_folders(folder: Path, top: Path) -> None:
    """Creates the missing folders between `top` and `folder`, and syncs their names to the disk."""
    missing: list[Path] = []
    while folder != top and not folder.is_dir():
        missing.append(folder)
        folder = folder.parent
    for new in reversed(missing):
        new.mkdir(exist_ok=True)
        _sync(new.parent)


def _remove_empty(folder: Path) -> bool:
    try:
        folder.rmdir()
    except OSError:
        return False
    return True


def _sync(folder: Path) -> None:
    """Syncs the file names in a folder to the disk."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
