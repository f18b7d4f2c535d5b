"""Data sources of a job: stored objects that are downloaded to the job's data folder."""

import os
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

from ....schemas.documents.simulation_jobs import ResolvedDataSource, ResolvedKey
from ....schemas.wire.errors import (
    BundleError,
    InvalidParameterException,
    LaunchError,
    StorageAccessDeniedError,
    StorageError,
    StorageUnavailableError,
)
from ...service.service import Service
from ...storage import unpack
from ...storage.object_store import ObjectInfo
from ..environment.folders import DATA_SOURCES, Sandbox, protect, remove

MAX_FILES = 100
MAX_BYTES = 25 * 10**9


def resolve_data_sources(
    configs: Sequence[Mapping[str, Any]], service: Service, role: str | None = None
) -> list[ResolvedDataSource]:
    """Lists the objects to which a job's data sources refer now, with their ETags.

    Objects that the role may not read are listed by name, without ETags: the job fails later with a code for that.

    Args:
        configs: Data sources of a request.
        service: The service, with its catalog and object store.
        role: ARN of the role that reads them.

    Raises:
        InvalidParameterException: An object does not exist or cannot be read, or there are too many.
        StorageUnavailableError: The object store does not answer.
    """
    resolved: list[ResolvedDataSource] = []
    objects: list[ObjectInfo] = []
    for index, config in enumerate(configs):
        try:
            found = _objects(config, f"dataSources[{index}]", service.acting_as(role))
        except StorageAccessDeniedError:
            keys = [{"s3Key": key} for key in config["s3Keys"]]
        else:
            objects += found
            keys = [{"s3Key": item.key, "etag": item.etag} for item in found]
        resolved.append(ResolvedDataSource.model_validate({"type": "File", **config, "s3Keys": keys}))
    size = sum(item.size_bytes for item in objects)
    if len(objects) > MAX_FILES or size > MAX_BYTES:
        raise InvalidParameterException(
            f"dataSources: {len(objects)} files, {size / 1e9:.1f} GB in all; "
            f"a job reads at most {MAX_FILES} files, {MAX_BYTES / 1e9:.0f} GB in all"
        )
    return resolved


def fetch_data_sources(sources: Sequence[ResolvedDataSource], sandbox: Sandbox, service: Service) -> Path | None:
    """Downloads a job's data sources into its folders, read-only.

    Objects keep the folders of their keys: `maps/flat.pgm` of the source `plans` becomes `plans/maps/flat.pgm` in the
    folder of data sources. An archive becomes a folder: `maps/flat.zip` becomes `plans/maps/flat`. A source with a
    destination is downloaded there instead, and its archives are unpacked into the destination itself; `plans` is then
    a link to it.

    Returns:
        The folder of data sources; `None` if there are none.

    Raises:
        LaunchError: An object is missing, has changed, or is not an archive.
        StorageUnavailableError: The object store does not answer.
    """
    # A destination inside of another's is filled later, as it would be mounted over it.
    for source in sorted(sources, key=lambda source: len(PurePosixPath(source.destination or "/").parts)):
        folder = _folder_of(source, sandbox)
        for item in source.s3_keys:
            place = f"s3://{source.s3_bucket}/{item.s3_key}"
            try:
                _fetch(source, item, folder, service)
            except StorageAccessDeniedError as error:
                raise LaunchError(f"{place}: {error}", "BadPermissionsS3Object") from error
            except StorageUnavailableError:
                raise
            except (StorageError, BundleError) as error:
                raise LaunchError(f"{place}: {error}", "InvalidS3Resource") from error
    for source in sources:
        protect(sandbox.place(source.destination or f"{DATA_SOURCES}/{source.name}"))
    return sandbox.place(DATA_SOURCES) if sources else None


def _folder_of(source: ResolvedDataSource, sandbox: Sandbox) -> Path:
    """Creates the empty folder into which a data source is downloaded, and returns it.

    If the source has a destination, all that is there is deleted, and the usual folder becomes a link to it.
    """
    usual = sandbox.place(f"{DATA_SOURCES}/{source.name}")
    destination = source.destination
    if not destination:
        usual.mkdir(parents=True, exist_ok=True)
        return usual
    folder = sandbox.place(destination)
    remove(folder)
    folder.mkdir(parents=True)
    # Relative, so that it leads to the same place where the folders are mounted in a container.
    usual.symlink_to(os.path.relpath(folder, usual.parent))
    return folder


def _objects(config: Mapping[str, Any], place: str, service: Service) -> list[ObjectInfo]:
    found: list[ObjectInfo] = []
    for number, key in enumerate(config["s3Keys"]):
        where = f"{place}.s3Keys[{number}]: s3://{config['s3Bucket']}/{key}"
        try:
            if config.get("type") == "Prefix":
                items = list(service.store.list(config["s3Bucket"], key))
            else:
                items = [service.store.head(config["s3Bucket"], key)]
        except StorageUnavailableError:
            raise  # the request may be right
        except StorageAccessDeniedError as error:
            if service.roles is not None:
                raise
            raise InvalidParameterException(f"{where} cannot be read: {error}") from error
        except StorageError as error:
            raise InvalidParameterException(f"{where} cannot be read: {error}") from error
        if not items:
            raise InvalidParameterException(f"{where}: no object has a key that starts so")
        found += items
    return found


def _fetch(source: ResolvedDataSource, item: ResolvedKey, folder: Path, service: Service) -> None:
    bucket, key = source.s3_bucket, item.s3_key
    relative = PurePosixPath(key)
    if relative.is_absolute() or ".." in relative.parts:
        raise StorageError(f"the key {key!r} leads out of the data folder")
    path = folder / relative
    path.parent.mkdir(parents=True, exist_ok=True)
    if item.etag is None and source.type == "Prefix":
        any(service.store.list(bucket, key))  # the role may not do this even now, and that is what is told
        raise StorageError("the job's role could not list this prefix when the job was made; make it again")
    fetched = service.store.get_file(bucket, key, path)
    if item.etag is not None and fetched.etag != item.etag:
        raise LaunchError(f"s3://{bucket}/{key} has changed since the job was made", "MismatchedEtag")
    if source.type == "Archive":
        _unpack(path, folder, has_destination=bool(source.destination))


def _unpack(archive: Path, folder: Path, *, has_destination: bool) -> None:
    """Unpacks a downloaded archive and deletes it.

    The content is put into the data source's folder if that has a destination, else into one beside the archive with
    its name. Raises `BundleError` if the archive cannot be unpacked.
    """
    if not has_destination:
        unpack(archive, archive.with_name(archive.name.removesuffix(".zip").removesuffix(".tar.gz")))
        archive.unlink()
        return
    with tempfile.TemporaryDirectory(dir=folder.parent) as scratch:
        fetched = archive.rename(Path(scratch, "archive"))
        for empty in [parent for parent in archive.parents if parent.is_relative_to(folder) and parent != folder]:
            if not any(empty.iterdir()):
                empty.rmdir()
        unpacked = Path(scratch, "unpacked")
        unpack(fetched, unpacked)
        shutil.copytree(unpacked, folder, dirs_exist_ok=True)
