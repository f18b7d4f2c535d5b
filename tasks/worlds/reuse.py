"""Reuses existing worlds that have the same template and seeds, in place of generating them anew."""

from dataclasses import replace

from ...schemas.documents.worlds import StoredPlace, WorldDocument, WorldGenerationJobDocument
from ...schemas.wire.errors import StorageError
from ..catalog import Resource
from ..service.patience import at_once
from ..service.service import Service
from ..storage import read_manifest
from .generation import ORIGIN_LABEL, add_world, origin_of, world_seeds
from .stored_bundles import bundle_held


def find_world_again(template_body: str, seeds: tuple[int, int], service: Service) -> Resource | None:
    """Finds a stored world that this generator version made from the same template and seeds.

    Args:
        template_body: the template's body, to the letter.
        seeds: floor plan seed and interior seed.
        service: the service, with its catalog and object store.

    Returns:
        The newest such world whose bundle is stored; `None`: there is none.
    """
    return find_by_origin(origin_of(template_body, seeds), service)


def find_by_origin(origin: str, service: Service) -> Resource | None:
    """Finds the newest stored world with the same origin (hash of template and seeds)."""
    filters = {ORIGIN_LABEL: [origin]}
    world = next(iter(service.catalog.list("world", filters=filters, limit=1).resources), None)
    bundle = WorldDocument.of(world).bundle if world is not None else None
    return world if bundle is not None and _is_stored(bundle, service) else None


def reuse_world(service: Service, job: Resource, index: int, arn: str) -> bool:
    """Adds a world to a generation job with the stored files of an identical earlier world.

    Args:
        service: the service, with its catalog and object store.
        job: the generation job.
        index: number of the world in the job, from 0.
        arn: ARN the world gets.

    Returns:
        Whether there is such a bundle.
    """
    document = WorldGenerationJobDocument.of(job)
    found = find_world_again(document.template_body, world_seeds(document, index), service)
    known = WorldDocument.of(found) if found is not None else None
    bundle = known.bundle if known is not None else None
    if found is None or known is None or bundle is None:
        return False
    with bundle_held(bundle, service):  # and not for as long as a store is away
        if not _is_stored(
            bundle, replace(service, store=at_once(service.store))
        ):  # its last world was deleted just now
            return False
        shared = WorldDocument(bundle=bundle, plan=known.plan, reused_from=known.reused_from or found.arn)
        add_world(service, job, index, arn, shared)
    return True


def _is_stored(bundle: StoredPlace, service: Service) -> bool:
    try:
        read_manifest(service.store, bundle.bucket, bundle.prefix)
    except StorageError:
        return False
    return True
