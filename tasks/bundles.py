"""Bundles on this machine: fetched once, kept by their content, shared by all jobs."""

import fcntl
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from ..schemas.errors import BundleError, LaunchError, ObjectNotFoundError, StorageAccessDeniedError, StorageError
from .catalog import Resource
from .service import Service
from .storage import fetch, unpack


def world_bundle(world: Resource, service: Service) -> Path:
    """The folder of a world's bundle, read-only by agreement.

    Raises:
      StorageError: it cannot be fetched.
    """
    bucket, prefix = world.document["bundle"]["bucket"], world.document["bundle"]["prefix"]

    def fill(folder: Path) -> None:
        fetch(service.store, bucket, prefix, folder)

    return _once(service.folder("cache", "worlds") / prefix.rsplit("/", 1)[-1], fill)


def application_bundle(source: dict[str, str], role: str, service: Service) -> Path:
    """The folder an application's archive was unpacked into.

    Args:
      source: `s3Bucket`, `s3Key` and the `etag` it had when the application was made.
      role: `Robot` or `Simulation`, for failure codes.
      service: where the archive is stored.

    Raises:
      LaunchError: it is gone, has changed, may not be read or cannot be unpacked.
    """
    bucket, key = source["s3Bucket"], source["s3Key"]
    try:
        if (now := service.store.head(bucket, key).etag) != source["etag"]:
            raise LaunchError(
                f"s3://{bucket}/{key} has changed since the application was made: ETag {now}, then {source['etag']}",
                "MismatchedEtag",
            )

        def fill(folder: Path) -> None:
            with tempfile.TemporaryDirectory(dir=service.folder("scratch")) as scratch:
                archive = Path(scratch, "archive")
                service.store.get_file(bucket, key, archive)
                unpack(archive, folder)

        return _once(service.folder("cache", "applications") / source["etag"], fill)
    except BundleError as error:
        raise LaunchError(f"s3://{bucket}/{key}: {error}", f"InvalidBundle{role}Application") from error
    except (ObjectNotFoundError, StorageAccessDeniedError) as error:
        raise LaunchError(str(error), f"BadPermissions{role}Application") from error


def _once(folder: Path, fill: Callable[[Path], None]) -> Path:
    """Fills a folder unless it is there; of several processes one does it, a failed one leaves nothing."""
    if folder.is_dir():
        return folder
    with (folder.parent / f".{folder.name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.is_dir():
            part = folder.with_name(f".{folder.name}.part")
            shutil.rmtree(part, ignore_errors=True)
            try:
                fill(part)
                part.rename(folder)
            except (StorageError, OSError):
                shutil.rmtree(part, ignore_errors=True)
                raise
    return folder
