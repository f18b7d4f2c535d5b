"""Sends stored files to browsers: with media types that execute nothing, and by byte ranges for seeking in videos."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path, PurePosixPath

from starlette.responses import FileResponse
from starlette.types import Receive, Scope, Send

from ...schemas.documents.worlds import StoredPlace
from ...schemas.wire.errors import ObjectNotFoundError, StorageError
from ...tasks.service.service import Service
from ...tasks.storage import read_manifest
from ...tasks.storage.object_store import join_key

_TEXT = "text/plain; charset=utf-8"
_TYPES = {
    ".mp4": "video/mp4", ".png": "image/png", ".jpg": "image/jpeg", ".json": _TEXT, ".log": _TEXT, ".txt": _TEXT,
    ".yaml": _TEXT, ".csv": _TEXT, ".pgm": "image/x-portable-graymap",
}  # fmt: skip
"""Media types that browsers show, by file suffix.

Browsers only save all other files, HTML and SVG too, since outputs may come from anybody.
"""

_HEADERS = {
    "content-security-policy": (
        "sandbox; default-src 'none'; img-src 'self'; media-src 'self'; style-src 'unsafe-inline'"
    ),
    "cache-control": "private, max-age=300",
}

_MOST_LISTED = 1000
"""Most files that are listed of a run without a manifest: one request to S3."""


def published(place: StoredPlace | None, service: Service) -> dict[str, int]:
    """Returns names and sizes (bytes) of a job's uploaded output files; empty without outputs.

    They are those of its manifest. A run that broke has none: then they are the objects under its prefix.
    """
    if place is None:
        return {}
    try:
        return {file.path: file.size_bytes for file in read_manifest(service.store, place.bucket, place.prefix).files}
    except ObjectNotFoundError:
        return _stored(place, service)
    except StorageError:
        return {}


def _stored(place: StoredPlace, service: Service) -> dict[str, int]:
    folder = join_key(place.prefix, "")
    try:
        found = islice(service.store.list(place.bucket, folder), _MOST_LISTED)
        return {each.key.removeprefix(folder): each.size_bytes for each in found}
    except StorageError:
        return {}


def send_file(place: StoredPlace | None, name: str, service: Service) -> FileResponse:
    """Makes the HTTP response with one of a job's output files.

    Args:
        place: Place of the job's outputs in the object store.
        name: Name of the file there.
        service: The service, with its catalog and object store.

    Raises:
        ObjectNotFoundError: No manifest names it.
        StorageError: The file cannot be read.
    """
    if place is None or name not in published(place, service):
        raise ObjectNotFoundError(f"there is no file {name}")
    key = join_key(place.prefix, name)
    path, is_copy = _local(place.bucket, key, service)
    send = _SentCopy if is_copy else FileResponse
    media_type = _TYPES.get(PurePosixPath(name).suffix.lower())
    return send(
        path,
        headers=_HEADERS,
        media_type=media_type or "application/octet-stream",
        filename=PurePosixPath(name).name,
        content_disposition_type="inline" if media_type else "attachment",
    )


def tail_of(place: StoredPlace, name: str, service: Service, most_bytes: int) -> bytes:
    """Returns the end of an uploaded file; empty if it cannot be read."""
    try:
        with local_file(place, name, service) as path, path.open("rb") as file:
            file.seek(max(0, os.fstat(file.fileno()).st_size - most_bytes))
            return file.read(most_bytes)
    except (OSError, StorageError):
        return b""


def read_small(place: StoredPlace | None, name: str, service: Service, most_bytes: int) -> bytes | None:
    """Returns the content of an uploaded file; `None` if it cannot be read or is too long.

    Args:
        place: Place of the job's outputs; None: there are none.
        name: Name of the file there.
        service: The service, with its object store.
        most_bytes: Limit of its size.
    """
    if place is None:
        return None
    try:
        with local_file(place, name, service) as path, path.open("rb") as file:
            data = file.read(most_bytes + 1)
    except (OSError, StorageError):
        return None
    return data if len(data) <= most_bytes else None


@contextmanager
def local_file(place: StoredPlace, name: str, service: Service) -> Iterator[Path]:
    """Gives a stored file as a local one: the object's own, or a copy that is deleted afterwards.

    Raises:
        StorageError: The file cannot be downloaded.
    """
    path, is_copy = _local(place.bucket, join_key(place.prefix, name), service)
    try:
        yield path
    finally:
        if is_copy:
            path.unlink(missing_ok=True)


def _local(bucket: str, key: str, service: Service) -> tuple[Path, bool]:
    """Returns the local file of a stored object, or a downloaded copy, and whether it is a copy.

    The caller deletes a copy. If the download fails, nothing is left and the store's error is raised.
    """
    path = service.store.local_path(bucket, key)
    if path is not None and path.is_file() and not path.is_symlink():
        return path, False
    descriptor, name = tempfile.mkstemp(prefix="console-", dir=service.folder("scratch"))
    os.close(descriptor)
    copy = Path(name)
    try:
        service.store.get_file(bucket, key, copy)
    except BaseException:
        copy.unlink(missing_ok=True)
        raise
    return copy, True


class _SentCopy(FileResponse):
    """File response that deletes the file afterwards, also if the range is invalid or the client disconnects."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Sends the file to the browser, and deletes it afterwards."""
        try:
            await super().__call__(scope, receive, send)
        finally:
            Path(self.path).unlink(missing_ok=True)
