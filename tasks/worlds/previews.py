"""Preview pictures of stored worlds, drawn when first requested and kept beside the bundle."""

from contextlib import suppress

from ...schemas.documents.worlds import WorldDocument
from ...schemas.wire.errors import ObjectNotFoundError, StorageAccessDeniedError, StorageError
from ...schemas.worlds.world import PREVIEW_FILE, WORLD_FILE, World
from ..catalog import Resource
from ..service.service import Service
from ..storage import read_manifest
from .stored_bundles import bundle_held


def preview_of(world: Resource, service: Service) -> bytes:
    """Returns a picture of a world from above (PNG); a new one is rendered and stored if missing.

    Args:
        world: The world.
        service: The service, with its catalog and object store.

    Returns:
        The picture; empty where the bundle's `world.json` is no world of a form that can be drawn.

    Raises:
        StorageError: The bundle cannot be read.
    """
    bundle = WorldDocument.of(world).bundle
    if bundle is None:
        raise StorageError(f"{world.arn} has no stored bundle")
    key = f"{bundle.prefix}/{PREVIEW_FILE}"
    # AWS does not tell clients without the right to list a bucket that an object does not exist.
    with suppress(ObjectNotFoundError, StorageAccessDeniedError):
        return service.store.get_bytes(bundle.bucket, key)
    # Imports what makes worlds, which none of those who read reports and runs need otherwise.
    from ..worldforge.pictures.preview import render_preview

    text = service.store.get_bytes(bundle.bucket, f"{bundle.prefix}/{WORLD_FILE}")
    try:
        picture = render_preview(World.model_validate_json(text))
    except ValueError:
        return b""
    # No manifest names it, as it is no part of the content; it goes with the bundle, unless that has just gone.
    with suppress(StorageError), bundle_held(bundle, service):
        read_manifest(service.store, bundle.bucket, bundle.prefix)
        service.store.put_bytes(bundle.bucket, key, picture)
    return picture
