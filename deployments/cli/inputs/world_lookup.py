"""Finds the world to look at: by ARN, id or its beginning, name, or the folder of its bundle."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ....schemas.documents.worlds import StoredPlace, WorldDocument, WorldGenerationJobDocument, WorldTemplateDocument
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


@dataclass(frozen=True)
class FoundWorld:
    """A world whose files are on this machine, with its origin."""

    name: str
    """The world's name for people, `flat 3`; its id where it has none; or the folder's name."""
    folder: Path
    """Folder of the world's bundle on this machine."""
    world: World
    content: str
    """SHA-256 of a world folder's content, in hexadecimal digits."""
    id: str | None = None
    """The world's id; absent for a folder."""
    arn: str | None = None
    template_arn: str | None = None
    template_name: str | None = None
    """Name that it had when the world was made; now, of a world of an early release."""
    template_changed: bool = False
    """Whether the template has another body than when the world was made."""
    job_arn: str | None = None
    job_seed: int | None = None
    stored_at: str | None = None
    """Address of a world's bundle in the object store; `None`: it is not stored."""
    stored_content: str | None = None
    """Content hash under which the bundle was stored."""
    stored: StoredPlace | None = None
    """Place of a world's stored bundle and its manifest in the object store."""


def find_world(wanted: str) -> FoundWorld:
    """Finds a world by ARN, id, name or folder, and downloads its files if necessary.

    Args:
        wanted: A world's ARN, its id (`import-82856b0yq33y`) or the beginning of that (`generation-8285/world-3`), its
            name (`flat 3`), or the folder of a bundle.

    Raises:
        InvalidParameterException: An ARN of something else, or none at all.
        ResourceNotFoundException: The catalog has no world of the ARN.
        ConfigurationError: The text means no world, or any of several; or the folder holds no world.
        StorageError: The bundle is gone, or cannot be fetched.
    """
    folder = Path(wanted)
    if not wanted.startswith("arn:") and folder.is_dir():
        return _found(folder.resolve())
    if wanted.startswith("arn:"):
        ResourceArn.parse(wanted, "world")  # before a service is opened
    service = open_service()
    from ....tasks.service import references

    besides = ", nor the folder of a world's bundle"
    return _of(references.find_world(wanted, service, besides), service)


def output_file(name: str, folder: str, suffix: str) -> Path:
    """Returns the default path for a page or picture of a world or job.

    Args:
        name: The world's or the job's.
        folder: Below the data home.
        suffix: Suffix of the file's name.
    """
    safe = "".join(letter if letter.isalnum() or letter in "-_." else "-" for letter in name)
    return Settings.from_environment(os.environ).home / folder / f"{safe}{suffix}"


def _of(resource: "Resource", service: "Service") -> FoundWorld:
    from ....tasks.service import references

    folder = _fetched(resource, service)
    document = WorldDocument.of(resource)
    template = document.template
    template_now = _named(template, service)
    job = _named(resource.parent, service)
    made_of = WorldGenerationJobDocument.of(job).template_body if job else None
    return _found(
        folder,
        name=references.name_of_world(resource, service),
        id=resource.id,
        arn=resource.arn,
        template_arn=template,
        template_name=document.template_name or (template_now.name if template_now else None),
        template_changed=_has_changed(made_of, template_now),
        job_arn=resource.parent,
        job_seed=WorldGenerationJobDocument.of(job).seed if job else None,
        stored_at=document.bundle and service.store.uri(document.bundle.bucket, document.bundle.prefix),
        stored_content=document.bundle and document.bundle.last_part,
        stored=document.bundle,
    )


def _has_changed(body: str | None, template: "Resource | None") -> bool:
    from ....tasks.worlds.reuse import same_body

    if body is None or template is None:
        return False
    return not same_body(body, WorldTemplateDocument.of(template).template_body)


def stored_digests(found: FoundWorld) -> dict[str, str] | None:
    """Returns the SHA-256 of a world's files by their paths, from the manifest that it was stored with.

    Args:
        found: The world; a folder may have a copy of its manifest.

    Returns:
        None where there is no manifest.

    Raises:
        StorageError: The manifest is gone, or is none.
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
