"""Archives of applications that jobs ran with, kept by digest: `repro` finds last night's code when it is overwritten.

Each archive is stored once under its ETag, in the service's own bucket, when a job first runs with it. `robomaker gc`
removes those that no job names any more.
"""

import logging
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from ....schemas.wire.errors import BucketNotFoundError, ObjectNotFoundError, StorageError
from ...service.service import Service
from ...service.store_retries import at_once
from ...storage import ObjectInfo

FOLDER = "kept-archives"
"""Beginning of the keys of kept archives in the service's bucket."""

_logger = logging.getLogger(__name__)


def key_of(etag: str) -> str:
    """Returns the key in the object store of the kept archive of an ETag."""
    return f"{FOLDER}/{etag}"


def is_kept(etag: str, service: Service) -> bool:
    """Whether the archive of an ETag is among the kept archives.

    Raises:
        StorageError: The store does not answer.
    """
    try:
        at_once(service.store).head(service.settings.bucket, key_of(etag))
    except (BucketNotFoundError, ObjectNotFoundError):
        return False
    return True


def keep(etag: str, fetch: Callable[[Path], ObjectInfo], service: Service) -> None:
    """Stores a copy of an archive, unless it is kept already, or has been overwritten meanwhile.

    If it cannot be kept, that is logged and not raised.

    Args:
        etag: Its ETag.
        fetch: Downloads it into a file, and returns what it has become meanwhile.
        service: The service with its own access to the store, not that of a job's role.
    """
    try:
        if is_kept(etag, service):
            return
        with tempfile.TemporaryDirectory(dir=service.folder("scratch")) as scratch:
            archive = Path(scratch, "archive")
            if fetch(archive).etag == etag:  # otherwise it was overwritten just now
                put(etag, archive, service)
    except (StorageError, OSError) as error:
        _logger.warning("the archive of ETag %s is not kept, so that repro may not find its code: %s", etag, error)


def put(etag: str, archive: Path, service: Service) -> None:
    """Stores an application's archive under its ETag among the kept archives.

    Raises:
        StorageError: It cannot be stored.
    """
    store, bucket = at_once(service.store), service.settings.bucket
    store.ensure_bucket(bucket)
    store.put_file(bucket, key_of(etag), archive)


def fetch_kept(etag: str, archive: Path, service: Service) -> bool:
    """Downloads a kept archive; returns whether there is one.

    Raises:
        StorageError: The store does not answer.
    """
    try:
        at_once(service.store).get_file(service.settings.bucket, key_of(etag), archive)
    except (BucketNotFoundError, ObjectNotFoundError):
        return False
    return True


def kept_archives(service: Service) -> Iterator[ObjectInfo]:
    """Yields all kept archives; the last part of a key is the ETag that the archive had.

    Raises:
        StorageError: The store does not answer.
    """
    try:
        yield from service.store.list(service.settings.bucket, f"{FOLDER}/")
    except BucketNotFoundError:
        return
