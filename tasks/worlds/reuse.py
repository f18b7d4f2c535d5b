"""Worlds of a fixed seed, and templates, that are there already: found again by their content, not made anew."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace

from ...schemas.documents.worlds import StoredPlace, WorldDocument, WorldGenerationJobDocument, WorldTemplateDocument
from ...schemas.wire.errors import StorageError
from ..catalog import Resource
from ..service.service import Service
from ..service.store_retries import at_once
from ..storage import read_manifest
from .generation import ORIGIN_LABEL, add_world, origin_of, world_seeds
from .stored_bundles import bundle_held

_TEMPLATE = "world-template"
_PAGE = 20  # templates of one name: mostly there is one


def find_template_again(name: str, body: str, tags: Mapping[str, str], service: Service) -> Resource | None:
    """Finds the newest template of the same name, body and tags.

    Args:
        name: The name; empty: none.
        body: The body as JSON text; its spaces and the order of its members do not matter.
        tags: The tags.
        service: The service, with its catalog and object store.
    """
    for template in _templates_named(name, service):
        if same_body(WorldTemplateDocument.of(template).template_body, body) and dict(template.tags) == dict(tags):
            return template
    return None


def same_body(one: str, other: str) -> bool:
    """Whether two JSON texts say the same: spaces and the order of members do not matter."""
    return _canonical(one) == _canonical(other)


def _canonical(body: str) -> str:
    return json.dumps(json.loads(body), sort_keys=True)  # as text: in Python, true equals 1


def _templates_named(name: str, service: Service) -> Iterator[Resource]:
    """Yields all templates of a name, the newest first."""
    after = None
    while True:
        page = service.catalog.list(_TEMPLATE, filters={"name": [name]}, limit=_PAGE, after=after)
        yield from page.resources
        if (after := page.next_token) is None:
            return


def find_world_again(template_body: str, seeds: tuple[int, int], service: Service) -> Resource | None:
    """Finds a stored world that this generator version made from the same template and seeds.

    Args:
        template_body: The template's body, to the letter.
        seeds: Floor plan seed and interior seed.
        service: The service, with its catalog and object store.

    Returns:
        The newest such world whose bundle is stored; `None`: there is none.
    """
    return find_by_origin(origin_of(template_body, seeds), service)


def find_by_origin(origin: str, service: Service) -> Resource | None:
    """Finds the newest world of an origin (hash of template and seeds); `None` if none is there with its files."""
    filters = {ORIGIN_LABEL: [origin]}
    world = next(iter(service.catalog.list("world", filters=filters, limit=1).resources), None)
    bundle = WorldDocument.of(world).bundle if world is not None else None
    return world if bundle is not None and _is_stored(bundle, service) else None


def reuse_world(service: Service, job: Resource, index: int, arn: str) -> bool:
    """Adds a world to a generation job with the stored files of an identical earlier world.

    Args:
        service: The service, with its catalog and object store.
        job: The generation job.
        index: Number of the world in the job, from 0.
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
