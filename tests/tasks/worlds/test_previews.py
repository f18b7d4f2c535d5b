"""Pictures from above are drawn when a world is first looked at, kept, and removed with the world."""

import io

import pytest
from helpers.small_flat import BODY
from PIL import Image

from prefect_robomaker.schemas.documents.worlds import StoredPlace, WorldDocument
from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.schemas.wire.errors import ObjectNotFoundError, StorageError
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import unpublish
from prefect_robomaker.tasks.worldforge.generator import generate_world, seeds_for
from prefect_robomaker.tasks.worldforge.pictures import preview
from prefect_robomaker.tasks.worlds.keeping import keep_world
from prefect_robomaker.tasks.worlds.previews import preview_of
from prefect_robomaker.tasks.worlds.stored_bundles import delete_world


@pytest.fixture
def kept(service: Service) -> Resource:
    """A stored world that nobody has looked at."""
    world = generate_world(WorldTemplateBody.model_validate(BODY), *seeds_for(7, 0, 0), settle=False)
    return keep_world(world, "import", {}, service)


def place(world: Resource) -> StoredPlace:
    bundle = WorldDocument.of(world).bundle
    assert bundle
    return bundle


def stored(world: Resource, service: Service, name: str) -> bytes:
    return service.store.get_bytes(place(world).bucket, f"{place(world).prefix}/{name}")


def test_a_world_is_drawn_once(kept: Resource, service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ObjectNotFoundError):
        stored(kept, service, "preview.png")
    picture = preview_of(kept, service)
    assert Image.open(io.BytesIO(picture)).size == (960, 720)
    assert stored(kept, service, "preview.png") == picture
    monkeypatch.setattr(preview, "render_preview", lambda _: b"drawn again")
    assert preview_of(kept, service) == picture


def test_its_picture_goes_with_a_world(kept: Resource, service: Service) -> None:
    preview_of(kept, service)
    delete_world(kept, service)
    with pytest.raises(ObjectNotFoundError):
        stored(kept, service, "preview.png")


def test_a_picture_of_a_world_that_has_just_gone_is_not_kept(
    kept: Resource, service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    def go(_: object) -> bytes:
        unpublish(service.store, place(kept).bucket, place(kept).prefix)
        return b"picture"

    monkeypatch.setattr(preview, "render_preview", go)
    assert preview_of(kept, service) == b"picture"
    with pytest.raises(StorageError):
        stored(kept, service, "preview.png")


def test_what_is_no_world_has_no_picture(kept: Resource, service: Service) -> None:
    service.store.put_bytes(place(kept).bucket, f"{place(kept).prefix}/world.json", b"{}")
    assert preview_of(kept, service) == b""
