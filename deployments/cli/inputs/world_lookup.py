"""Finds a world by its ARN, its id, or the folder of its bundle."""

import os
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ....schemas.documents.worlds import StoredPlace, WorldDocument, WorldGenerationJobDocument
from ....schemas.settings import Settings
from ....schemas.wire.arns import ResourceArn
from ....schemas.wire.errors import (
    BucketNotFoundError,
    ConfigurationError,
    ObjectNotFoundError,
    ResourceNotFoundException,
    StorageError,
)
from ....schemas.worlds.world import World
from .options import open_service

if TYPE_CHECKING:
    from ....tasks.catalog import Resource
    from ....tasks.service.service import Service


_ID = re.compile(r"[a-z]+-[0-9a-z]+(?:/world-[0-9]+)?")
"""Pattern of a world's id: `import-82856b0yq33y`, `generation-82856b0yq33y/world-3`."""


@dataclass(frozen=True)
class FoundWorld:
    """A world whose files are on this machine, with its origin."""

    name: str
    """Id of a world, or name of its folder."""
    folder: Path
    """Folder of the world's bundle on this machine."""
    world: World
    content: str
    """SHA-256 of a world folder's content, in hexadecimal digits."""
    arn: str | None = None
    template_arn: str | None = None
    template_name: str | None = None
    """Name of the world's template; `None` also if the template was deleted."""
    job_arn: str | None = None
    job_seed: int | None = None
    stored_at: str | None = None
    """Address of a world's bundle in the object store; `None`: it is not stored."""
    stored_content: str | None = None
    """Content hash under which the bundle was stored."""
    stored: StoredPlace | None = None
    """Place of a world's stored bundle and its manifest in the object store."""


def find_world(wanted: str) -> FoundWorld:
    """Finds a world by ARN, id or folder, and downloads its files if necessary.

    Args:
        wanted: a world's ARN or id, such as `import-82856b0yq33y`, or the folder of a bundle.

    Raises:
        InvalidParameterException: an ARN of something else, or none at all.
        ResourceNotFoundException: the catalog has no such world.
        ConfigurationError: the folder holds no world.
        StorageError: the bundle is gone, or cannot be fetched.
    """
    if wanted.startswith("arn:"):
        return _of_arn(wanted)
    folder = Path(wanted)
    if folder.is_dir():
        return _found(folder.resolve())
    if _ID.fullmatch(wanted):
        service = open_service()
        with suppress(ResourceNotFoundException):
            return _of_arn(service.arn("world", wanted))
    raise ConfigurationError(f"{wanted!r} is neither the ARN or id of a world nor the folder of a world's bundle")


def output_file(name: str, folder: str, suffix: str) -> Path:
    """Returns the default path for a page or picture of a world or job.

    Args:
        name: the world's or the job's.
        folder: below the data home.
        suffix: suffix of the file's name.
    """
    safe = "".join(letter if letter.isalnum() or letter in "-_." else "-" for letter in name)
    return Settings.from_environment(os.environ).home / folder / f"{safe}{suffix}"


def _of_arn(arn: str) -> FoundWorld:
    ResourceArn.parse(arn, "world")

    service = open_service()
    resource = service.catalog.get(arn, kind="world")
    folder = _fetched(resource, service)
    document = WorldDocument.of(resource)
    template = document.template
    job = _named(resource.parent, service)
    return _found(
        folder,
        name=resource.id,
        arn=arn,
        template_arn=template,
        template_name=(named.name if (named := _named(template, service)) else None),
        job_arn=resource.parent,
        job_seed=WorldGenerationJobDocument.of(job).seed if job else None,
        stored_at=document.bundle and service.store.uri(document.bundle.bucket, document.bundle.prefix),
        stored_content=document.bundle and document.bundle.last_part,
        stored=document.bundle,
    )


def stored_digests(found: FoundWorld) -> dict[str, str] | None:
    """Returns the SHA-256 of a world's files by their paths, from the manifest that it was stored with.

    Args:
        found: the world; a folder may have a copy of its manifest.

    Returns:
        None where there is no manifest.

    Raises:
        StorageError: the manifest is gone, or is none.
    """
    from ....schemas.runs.provenance import Manifest
    from ....tasks.storage.publication import MANIFEST_NAME, read_manifest

    copy = found.folder / MANIFEST_NAME
    if found.stored is not None:
        manifest = read_manifest(open_service().store, found.stored.bucket, found.stored.prefix)
    elif copy.is_file():
        try:
            manifest = Manifest.model_validate_json(copy.read_bytes())
        except ValueError as error:
            raise StorageError(f"{copy} is no manifest: {_first(error)}") from error
    else:
        return None
    return {file.path: file.sha256 for file in manifest.files}


def _fetched(resource: "Resource", service: "Service") -> Path:
    from ....tasks.simulations.inputs.bundles import world_bundle

    try:
        return world_bundle(resource, service)
    except (BucketNotFoundError, ObjectNotFoundError) as error:
        raise StorageError(f"the bundle of {resource.arn} is gone: {error}") from error


def _named(arn: str | None, service: "Service") -> "Resource | None":
    """Returns the resource of an ARN; `None` if it was deleted."""
    try:
        return service.catalog.get(arn) if arn else None
    except ResourceNotFoundException:
        return None


def _found(folder: Path, name: str | None = None, **origin: str | int | StoredPlace | None) -> FoundWorld:
    from ....tasks.worldforge.bundle.bundle import content_hash, read_world

    try:
        world = read_world(folder)
    except FileNotFoundError as error:
        raise ConfigurationError(
            f"{folder} is no world's bundle: there is no {Path(error.filename).name} in it"
        ) from error
    except ValueError as error:
        raise ConfigurationError(
            f"{folder / 'world.json'} is no world that can be read here: {_first(error)}"
        ) from error
    return FoundWorld(name or folder.name, folder, world, content_hash(folder), **origin)  # pyright: ignore[reportArgumentType]


def _first(error: ValueError) -> str:
    """Returns the first problem of a pydantic validation error."""
    from pydantic import ValidationError

    if not isinstance(error, ValidationError):
        return str(error)
    problem = error.errors()[0]
    place = ".".join(str(part) for part in problem["loc"])
    return f"{place}: {problem['msg']}" if place else problem["msg"]
