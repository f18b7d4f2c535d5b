"""Stores worlds that no generation job made: imported worlds and variations."""

import tempfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ...schemas.documents.worlds import StoredPlace, WorldDocument
from ...schemas.reports.names import name_label
from ...schemas.wire.arns import IdPrefix, new_id
from ...schemas.wire.errors import ConfigurationError
from ...schemas.worlds.description import DESCRIPTION_FILE
from ...schemas.worlds.world import GazeboSource, World
from ..catalog import NewResource, Resource
from ..service.references import worlds_named
from ..service.service import Service
from ..service.store_retries import at_once, patiently
from ..worldforge.bundle.bundle import content_hash, read_world, write_bundle
from .generation import ORIGIN_LABEL, WORLDS_PREFIX, publish_bundle
from .stored_bundles import BUNDLE_LABEL, bundle_held, bundle_label, name_held

if TYPE_CHECKING:
    from ..worldforge.generator import Wanted


def keep_world(
    world: World,
    prefix: IdPrefix,
    tags: dict[str, str],
    service: Service,
    *,
    origin: str | None = None,
    name: str | None = None,
    tell: Callable[[Resource], None] = lambda _world: None,
) -> Resource:
    """Stores the files of an imported or varied world, and adds it to the catalog.

    Args:
        world: The world.
        prefix: Prefix of the world's id.
        tags: Tags of the world.
        service: The service, with its catalog and object store.
        origin: Identifier of the world's inputs, by which it is found again.
        name: Name for people, from `given_world_name`; absent: the world is called by its id.
        tell: Called with the world that has the same name and files already; then it is returned, and none is added.

    Raises:
        ConfigurationError: Another world has the name.
        StorageError: The files cannot be stored.
    """

    def write(folder: Path) -> None:
        write_bundle(world, folder)

    return keep_bundle(write, prefix, tags, service, origin=origin, name=name, tell=tell)


def keep_variation(
    bundle: Path,
    wanted: "Wanted",
    arn: str | None,
    service: Service,
    *,
    origin: str | None = None,
    name: str | None = None,
    tell: Callable[[Resource], None] = lambda _world: None,
) -> Resource:
    """Makes a variation of a world, and stores it, even if it breaks guarantees.

    Args:
        bundle: Bundle of the original world.
        wanted: Changes of the variation.
        arn: ARN of the original world.
        service: The service, with its catalog and object store.
        origin: Identifier of the world's inputs, by which it is found again.
        name: Name for people, from `given_world_name`; absent: the world is called by its id.
        tell: Called with the world that has the same name and files already; then it is returned, and none is added.

    Raises:
        ConfigurationError: The world has no such door or furnishing, the variation equals the world, or another world
            has the name.
        StorageError: The files cannot be stored.
    """
    world = read_world(bundle)
    if isinstance(world.source, GazeboSource):
        from ..worldforge.gazebo.variations import vary_imported  # brings MuJoCo

        def write(folder: Path) -> None:
            vary_imported(bundle, wanted, arn, folder)

        return keep_bundle(write, "variation", {}, service, origin=origin, name=name, tell=tell)
    from ..worldforge.generator import vary

    made = vary(world, wanted, content_hash(bundle), arn)
    return keep_world(made, "variation", {}, service, origin=origin, name=name, tell=tell)


def keep_bundle(
    write: Callable[[Path], None],
    prefix: IdPrefix,
    tags: dict[str, str],
    service: Service,
    *,
    origin: str | None = None,
    name: str | None = None,
    tell: Callable[[Resource], None] = lambda _world: None,
) -> Resource:
    """Stores a world's files, and adds the world to the catalog.

    Args:
        write: Writes the bundle into a new folder.
        prefix: Beginning of the world's id.
        tags: Tags of the world.
        service: The service, with its catalog and object store.
        origin: Identifier of the world's inputs, by which it is found again.
        name: Name for people, from `given_world_name`; absent: the world is called by its id.
        tell: Called with the world that has the same name and files already; then it is returned, and none is added.

    Raises:
        ConfigurationError: Another world has the name.
        StorageError: The files cannot be stored.
    """
    with tempfile.TemporaryDirectory(dir=service.folder("scratch")) as scratch:
        folder = Path(scratch, "bundle")
        write(folder)
        place = StoredPlace(bucket=service.settings.bucket, prefix=f"{WORLDS_PREFIX}/{content_hash(folder)}")
        labels = {
            BUNDLE_LABEL: [bundle_label(place)],
            **({ORIGIN_LABEL: [origin]} if origin else {}),
            **name_label(name or ""),
        }
        document = WorldDocument(name=name, bundle=place, description_key=f"{place.prefix}/{DESCRIPTION_FILE}")
        held = replace(service, store=at_once(service.store))
        own_id = new_id(prefix, service.chance)
        resource = Resource.new(
            arn=service.arn("world", own_id),
            kind="world",
            id=own_id,
            status="Active",
            tags=tags,
            labels=labels,
            document=document,
        )
        kept = patiently(service.store, place.bucket, lambda: _kept(folder, place, resource, name, held))
    if kept.id != own_id:
        tell(kept)
    return kept


def _of_same_name(name: str, place: StoredPlace, service: Service) -> Resource | None:
    """Returns the newest world that has the name and the same files; raises an error if another world has the name."""
    same: Resource | None = None
    for each in worlds_named(name, service):
        bundle = WorldDocument.of(each).bundle
        if bundle is None or bundle.last_part != place.last_part:
            raise ConfigurationError(
                f"the name {name!r} is taken by {each.id}, another world; a name that is free would be right, "
                "or to delete that world first"
            )
        same = each
    return same


def _kept(folder: Path, place: StoredPlace, resource: NewResource, name: str | None, service: Service) -> Resource:
    """Stores the files and the world; returns the world of that name instead, if it has the same files."""
    with ExitStack() as locks:
        if name is not None:
            locks.enter_context(name_held(name, service))
        locks.enter_context(bundle_held(place, service))
        same = _of_same_name(name, place, service) if name is not None else None
        publish_bundle(service, place.prefix, folder, service.clock())  # also mends files that are gone
        return same or service.catalog.create(resource, token=None)
