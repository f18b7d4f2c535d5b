"""Local copies of the archives of worlds and applications: downloaded once, unpacked; and the rooms of a world."""

import fcntl
import glob
import os
import re
import shutil
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import TextIO

from pydantic import ValidationError

from ....schemas.documents.worlds import WorldDocument
from ....schemas.operations.simulation_jobs import SimulationJobRequestMembers
from ....schemas.runs.requirements import rooms_asked, unknown_room
from ....schemas.wire.errors import (
    BucketNotFoundError,
    BundleError,
    InvalidParameterException,
    LaunchError,
    ObjectNotFoundError,
    StorageAccessDeniedError,
    StorageError,
    StorageUnavailableError,
)
from ....schemas.worlds.world import WORLD_FILE, World, contains
from ...bundles.archive_members import ArchiveError
from ...bundles.colcon import unpack_overlays
from ...bundles.extraction import SYSTEM_TREE
from ...catalog import Resource
from ...service.service import Service
from ...service.store_retries import at_once, patiently, stopped_of
from ...storage import ObjectInfo, ObjectStore, fetch, unpack
from ...storage.object_store import Stopped, never
from .kept_archives import fetch_kept, keep


def unpack_colcon_bundle(folder: Path) -> None:
    """Unpacks the inner archives of a colcon bundle (built ROS workspace); ignores other bundles.

    Args:
        folder: Folder of the unpacked outer archive.

    Raises:
        BundleError: The colcon bundle is of another version, damaged or incomplete.
        StorageError: The disk is full, or the folder cannot be written.
    """
    try:
        unpack_overlays(folder, _unpack_system_tree)
    except ArchiveError as error:
        raise BundleError(str(error)) from error


def _unpack_system_tree(archive: Path, folder: Path) -> None:
    try:
        unpack(archive, folder, limits=SYSTEM_TREE)
    except BundleError as error:
        raise ArchiveError(str(error)) from error


_LOOK_S = 0.1
_ETAG = re.compile(r"[0-9A-Za-z_-]+")


def world_bundle(world: Resource, service: Service) -> Path:
    """Returns the local folder of a world's files, after downloading them if necessary.

    Raises:
        StorageError: The world's files cannot be downloaded.
    """
    bundle = WorldDocument.of(world).bundle
    if bundle is None:
        raise StorageError(f"{world.arn} has no stored bundle")

    def fill(folder: Path) -> None:
        fetch(at_once(service.store), bundle.bucket, bundle.prefix, folder)

    folder = service.folder("cache", "worlds") / bundle.last_part
    return patiently(service.store, bundle.bucket, lambda: fill_once(folder, fill, stopped_of(service.store)))


def application_bundle(
    source: dict[str, str],
    role: str,
    service: Service,
    *,
    is_pinned: bool,
    keeper: Service | None = None,
    as_ran: str | None = None,
) -> Path:
    """Returns the local folder of an application's unpacked archive, downloading it if necessary.

    Args:
        source: `s3Bucket`, `s3Key` and the `etag` of the archive when the application or its version was created.
        role: `Robot` or `Simulation`, for failure codes.
        service: The service, with its catalog and object store.
        is_pinned: Whether the archive must have that ETag, as for a numbered version; `$LATEST` is the present archive.
        keeper: The service with its own access to the store, which keeps the archive by its ETag, and has those that
            were kept; `None`: none is kept.
        as_ran: ETag of the archive that an earlier run had, which is taken if it is anywhere; otherwise the archive of
            now is, which those who compare the two find out.

    Raises:
        LaunchError: The archive was deleted or changed, may not be read, or cannot be unpacked.
        StorageError: The object store does not answer.
    """
    bucket, key = source["s3Bucket"], source["s3Key"]
    if keeper is not None and as_ran is not None and (folder := earlier_bundle(as_ran, role, keeper)) is not None:
        return folder
    has_kept = False
    try:
        mismatch = f"{role}ApplicationVersionMismatchedEtag" if is_pinned else "MismatchedEtag"
        found = service.store.head(bucket, key)
        if is_pinned and found.etag != source["etag"]:
            raise _changed(found, "the version was made", source["etag"], mismatch)

        def fill(folder: Path) -> None:
            nonlocal has_kept
            with tempfile.TemporaryDirectory(dir=service.folder("scratch")) as scratch:
                archive = Path(scratch, "archive")
                fetched = at_once(service.store).get_file(bucket, key, archive)
                if fetched.etag != found.etag:
                    raise _changed(fetched, "it was looked at", found.etag, mismatch)
                unpack(archive, folder)
                if keeper is not None:
                    keep(found.etag, lambda copy: _copied(archive, copy, fetched), keeper)
                    has_kept = True
            unpack_colcon_bundle(folder)

        folder = _cached_bundle(found.etag, service)
        patiently(service.store, bucket, lambda: fill_once(folder, fill, stopped_of(service.store)))
        if keeper is not None and not has_kept:  # the folder was there: from before archives were kept, or gc was quick
            keep(found.etag, lambda copy: at_once(service.store).get_file(bucket, key, copy), keeper)
        return folder
    except BundleError as error:
        raise LaunchError(f"s3://{bucket}/{key}: {error}", f"InvalidBundle{role}Application") from error
    except (BucketNotFoundError, ObjectNotFoundError, StorageAccessDeniedError) as error:
        raise LaunchError(str(error), f"BadPermissions{role}Application") from error


def _cached_bundle(etag: str, service: Service) -> Path:
    return service.folder("cache", "applications") / etag


def _copied(archive: Path, copy: Path, info: ObjectInfo) -> ObjectInfo:
    os.link(archive, copy)
    return info


def earlier_bundle(etag: str, role: str, keeper: Service) -> Path | None:
    """Returns the folder with the unpacked archive of an ETag, from this machine's cache or from the kept archives.

    Args:
        etag: ETag that the archive had.
        role: `Robot` or `Simulation`, for failure codes.
        keeper: The service with its own access to the store.

    Returns:
        The folder; `None` if neither has the archive.

    Raises:
        LaunchError: The kept archive cannot be unpacked.
        StorageError: The object store does not answer.
    """

    def fill(folder: Path) -> None:
        with tempfile.TemporaryDirectory(dir=keeper.folder("scratch")) as scratch:
            archive = Path(scratch, "archive")
            if not fetch_kept(etag, archive, keeper):
                raise FileNotFoundError(etag)
            unpack(archive, folder)
        unpack_colcon_bundle(folder)

    if not _ETAG.fullmatch(etag):  # what a run wrote down of itself is no path
        return None
    try:
        return fill_once(_cached_bundle(etag, keeper), fill, stopped_of(keeper.store))
    except FileNotFoundError:
        return None
    except BundleError as error:
        raise LaunchError(f"the kept archive of ETag {etag}: {error}", f"InvalidBundle{role}Application") from error


def last_used(copy: Path) -> datetime:
    """Returns the time at which a local copy of an archive was last used; the far future if it is gone."""
    try:
        return datetime.fromtimestamp(copy.stat().st_mtime, UTC)
    except FileNotFoundError:
        return datetime.max.replace(tzinfo=UTC)


def remove_unless_used(copy: Path, before: datetime) -> bool:
    """Deletes a local copy of an archive, unless it was used since a time.

    Args:
        copy: Folder of the local copy.
        before: Deletes the copy if it was last used before this time.

    Returns:
        Whether the copy is deleted.
    """
    part = _part(copy)
    with _lock_file(copy).open("w") as lock:
        if not _locked(lock) or last_used(copy) >= before:
            return False
        with suppress(FileNotFoundError):
            copy.rename(part)
            if last_used(part) >= before:  # just now, before it got the other name
                part.rename(copy)
                return False
        _remove_parts(part)
    return not copy.exists()


def _changed(found: ObjectInfo, since: str, etag: str, failure_code: str) -> LaunchError:
    return LaunchError(
        f"s3://{found.bucket}/{found.key} has changed since {since}: ETag {found.etag}, then {etag}", failure_code
    )


def fill_once(folder: Path, fill: Callable[[Path], None], stopped: Stopped = never) -> Path:
    """Fills a cache folder unless it exists, and returns it; of several processes, one does it and the others wait.

    The folder appears only when it is complete, and its modification time is that of its last use. Raises
    `StorageUnavailableError` if `stopped` ends the wait. The lock is released while waiting for the object store, so
    that all processes that need the folder wait equally long.
    """
    if _is_used(folder):
        return folder
    with _lock_file(folder).open("w") as lock:
        while not _locked(lock):
            if stopped():
                raise StorageUnavailableError(f"{folder.name} is not waited for any more: another job fetches it")
            time.sleep(_LOOK_S)
        if not _is_used(folder):
            part = _part(folder)
            _remove_parts(part)  # of a filler that was killed
            try:
                fill(part)
                part.rename(folder)
            finally:
                _remove_parts(part)
    return folder


def _is_used(folder: Path) -> bool:
    """Sets a folder's time of last use, if it exists; returns whether it does."""
    try:
        os.utime(folder)
    except FileNotFoundError:
        return False
    return True


def _part(folder: Path) -> Path:
    return folder.with_name(f".{folder.name}.part")


def _lock_file(folder: Path) -> Path:
    return folder.with_name(f".{folder.name}.lock")


def _locked(file: TextIO) -> bool:
    """Takes a file lock if it is free; returns whether it did."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _remove_parts(part: Path) -> None:
    """Deletes an incomplete folder, and the temporary files next to it."""
    for left in part.parent.glob(f"*{glob.escape(part.name)}*"):
        shutil.rmtree(left, ignore_errors=True)


@dataclass(frozen=True)
class Rooms:
    """Names of a world's rooms, and the room in which robots start."""

    names: tuple[str, ...]
    start: str | None
    """Name of the room at the origin, where robots start; None: the origin is in no room."""


def rooms_of_world(world: Resource, service: Service) -> Rooms | None:
    """Returns the rooms of a world; `None` if they cannot be read now.

    Args:
        world: The world.
        service: The service, with its catalog and object store.
    """
    bundle = WorldDocument.of(world).bundle
    if not bundle:
        return None
    try:
        return _read(service.store, bundle.bucket, bundle.prefix)
    except (StorageError, ValidationError):  # the job worker finds out, and says so
        return None


def check_rooms(request: SimulationJobRequestMembers, world: Resource, service: Service, where: str = "") -> None:
    """Raises an error if a request's goals name rooms that its world does not have.

    Args:
        request: Request of a job.
        world: World that the request names.
        service: Service with its catalog and object store.
        where: Path of `request` within a batch's request, ending with a dot.

    Raises:
        InvalidParameterException: Names the member, the requested room, and the existing rooms.
    """
    asked = rooms_asked(request)
    rooms = rooms_of_world(world, service) if asked else None
    if rooms is not None and (problem := unknown_room(asked, rooms.names)) is not None:
        raise InvalidParameterException(f"{where}{problem}")


@lru_cache(maxsize=256)  # a bundle's prefix is the hash of its content
def _read(store: ObjectStore, bucket: str, prefix: str) -> Rooms:
    rooms = World.model_validate_json(store.get_bytes(bucket, f"{prefix}/{WORLD_FILE}")).floorplan.rooms
    start = next((room.name for room in rooms if contains(room.polygon, 0.0, 0.0)), None)
    return Rooms(tuple(room.name for room in rooms), start)
