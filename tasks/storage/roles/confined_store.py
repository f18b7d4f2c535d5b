"""An object store confined to the places of a role: what a server's policies do where there is no server."""

from collections.abc import Iterator, Sequence
from datetime import datetime
from pathlib import Path

from ....schemas.roles import Role, is_within
from ....schemas.wire.errors import StorageAccessDeniedError
from ..base import ObjectInfo, ObjectStore, Stopped, Tell, UnfinishedUpload, never, tell_none


class ConfinedStore:
    """An `ObjectStore` that refuses all that a role may not do, with `StorageAccessDeniedError`.

    Args:
        store: the store behind it.
        role: what may be read and written.
        arn: the ARN of the request, for messages.
    """

    def __init__(self, store: ObjectStore, role: Role, arn: str) -> None:
        self._store = store
        self._writes = role.write
        self._reads = (*role.read, *role.write)
        self._arn = arn

    def ensure_bucket(self, bucket: str) -> None:
        """See `ObjectStore`; some of the bucket has to be the role's to write to."""
        if not any(place.startswith(f"{bucket}/") for place in self._writes):
            raise self._denied(f"make the bucket {bucket}", "write")
        self._store.ensure_bucket(bucket)

    def check_writable(self, bucket: str, key: str) -> None:
        """See `ObjectStore`."""
        self._check_write(bucket, key)
        self._store.check_writable(bucket, key)

    def put_file(self, bucket: str, key: str, path: Path, *, stopped: Stopped = never) -> ObjectInfo:
        """See `ObjectStore`."""
        self._check_write(bucket, key)
        return self._store.put_file(bucket, key, path, stopped=stopped)

    def probe(self, bucket: str) -> None:
        """See `ObjectStore`."""
        self._store.probe(bucket)

    def find_same(self, bucket: str, key: str, path: Path, *, stopped: Stopped = never) -> ObjectInfo | None:
        """See `ObjectStore`."""
        self._check_read(bucket, key)
        return self._store.find_same(bucket, key, path, stopped=stopped)

    def put_files(
        self, bucket: str, files: dict[str, Path], *, stopped: Stopped = never, tell: Tell = tell_none
    ) -> list[ObjectInfo]:
        """See `ObjectStore`."""
        for key in files:
            self._check_write(bucket, key)
        return self._store.put_files(bucket, files, stopped=stopped, tell=tell)

    def put_bytes(self, bucket: str, key: str, data: bytes, *, create_only: bool = False) -> ObjectInfo:
        """See `ObjectStore`."""
        self._check_write(bucket, key)
        return self._store.put_bytes(bucket, key, data, create_only=create_only)

    def get_file(self, bucket: str, key: str, path: Path) -> ObjectInfo:
        """See `ObjectStore`."""
        self._check_read(bucket, key)
        return self._store.get_file(bucket, key, path)

    def get_bytes(self, bucket: str, key: str) -> bytes:
        """See `ObjectStore`."""
        self._check_read(bucket, key)
        return self._store.get_bytes(bucket, key)

    def head(self, bucket: str, key: str) -> ObjectInfo:
        """See `ObjectStore`."""
        self._check_read(bucket, key)
        return self._store.head(bucket, key)

    def list(self, bucket: str, prefix: str = "") -> Iterator[ObjectInfo]:
        """See `ObjectStore`."""
        self._check_read(bucket, prefix)
        return self._store.list(bucket, prefix)

    def delete(self, bucket: str, key: str) -> None:
        """See `ObjectStore`."""
        self._check_write(bucket, key)
        self._store.delete(bucket, key)

    def unfinished_uploads(self, bucket: str, before: datetime) -> Sequence[UnfinishedUpload]:
        """See `ObjectStore`; the whole bucket has to be the role's."""
        self._check_write(bucket, "")
        return self._store.unfinished_uploads(bucket, before)

    def abort_upload(self, upload: UnfinishedUpload) -> None:
        """See `ObjectStore`."""
        self._check_write(upload.bucket, upload.key)
        self._store.abort_upload(upload)

    def uri(self, bucket: str, key: str) -> str:
        """See `ObjectStore`."""
        return self._store.uri(bucket, key)

    def local_path(self, bucket: str, key: str) -> Path | None:
        """See `ObjectStore`; `None` for what the role may not read."""
        return self._store.local_path(bucket, key) if is_within(self._reads, bucket, key) else None

    def _check_read(self, bucket: str, key: str) -> None:
        if not is_within(self._reads, bucket, key):
            raise self._denied(f"read {bucket}/{key}", "read")

    def _check_write(self, bucket: str, key: str) -> None:
        if not is_within(self._writes, bucket, key):
            raise self._denied(f"write {bucket}/{key}", "write")

    def _denied(self, what: str, member: str) -> StorageAccessDeniedError:
        return StorageAccessDeniedError(
            f"role {self._arn} may not {what}; `{member}` of the roles file has no such place"
        )
