"""Bundles of worlds in the object store: equal worlds share one, which is deleted with the last of them.

A call that adds a world to the catalog, or deletes one, locks its bundle meanwhile. So a bundle is never deleted just
when another world of the same content is added, by this process or another.
"""

import hashlib
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from ...schemas.documents.worlds import StoredPlace, WorldDocument
from ...schemas.wire.errors import BucketNotFoundError, ResourceAlreadyExistsException, ResourceNotFoundException
from ..catalog import Resource
from ..service.service import Service
from ..storage import unpublish

BUNDLE_LABEL = "bundle"
_KIND = "world-bundle-holder"
_HELD_AT_MOST_S = 120.0
"""Time after which a process that has locked a bundle counts as dead, in seconds."""
_WAIT_S = 0.05


def bundle_label(bundle: StoredPlace) -> str:
    """Returns the catalog label by which all worlds with the same stored files are found.

    Args:
        bundle: Place of the bundle in the object store.
    """
    return f"{bundle.bucket}/{bundle.prefix}"


@contextmanager
def bundle_held(bundle: StoredPlace, service: Service) -> Iterator[None]:
    """Locks a world's stored files inside the block: no world that shares them is added or deleted meanwhile.

    It waits for the lock, which runs out after 120 s, when another process may take it.
    """
    with _held(f"bundle/{bundle_label(bundle)}", service):
        yield


@contextmanager
def name_held(name: str, service: Service) -> Iterator[None]:
    """Locks a name that is given to a world inside the block, as `bundle_held` locks its files.

    Args:
        name: The name.
        service: The service, with its catalog.
    """
    digest = hashlib.sha256(name.encode()).hexdigest()  # a name may have characters that an ARN cannot
    with _held(f"name/{digest}", service):
        yield


@contextmanager
def _held(own_id: str, service: Service) -> Iterator[None]:
    arn = service.arn("world", own_id)
    owner = uuid.uuid4().hex
    while not _taken(arn, owner, service):
        time.sleep(_WAIT_S)
    try:
        yield
    finally:
        if service.catalog.renew(arn, owner, _HELD_AT_MOST_S):  # else another has taken over
            service.catalog.delete(arn)


def delete_world(world: Resource, service: Service) -> None:
    """Deletes a world from the catalog, and its stored files unless another world shares them.

    A copy on a machine that runs something in the world stays: it is a cache, kept by content.

    Raises:
        ResourceNotFoundException: Somebody else has just removed it.
        StorageError: The bundle cannot be removed; the world is still in the catalog, so that this can be repeated.
    """
    bundle = WorldDocument.of(world).bundle
    if not bundle:
        service.catalog.delete(world.arn)
        return
    with bundle_held(bundle, service):
        sharing = service.catalog.list("world", filters={BUNDLE_LABEL: [bundle_label(bundle)]}, limit=2).resources
        if all(each.arn == world.arn for each in sharing):
            with suppress(BucketNotFoundError):  # then there is nothing to remove
                unpublish(service.store, bundle.bucket, bundle.prefix)
        service.catalog.delete(world.arn)


def _taken(arn: str, owner: str, service: Service) -> bool:
    holder = Resource.new(arn=arn, kind=_KIND, id=arn.rpartition(":world/")[2])
    with suppress(ResourceAlreadyExistsException):
        service.catalog.create(holder, token=None)
    try:
        return service.catalog.claim(arn, owner, _HELD_AT_MOST_S)
    except ResourceNotFoundException:  # given back just now
        return False
