"""Worlds: lists of them, and what is left of deleted ones."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.examples import examples
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from prefect_robomaker.schemas.documents.worlds import StoredPlace
from prefect_robomaker.schemas.wire.errors import InvalidParameterException, ResourceNotFoundException, StorageError
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.files.untrusted_folders import regular_files
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import publish, read_manifest
from prefect_robomaker.tasks.worlds.stored_bundles import bundle_held, bundle_label

Generate = Callable[..., dict[str, Any]]
pytestmark = pytest.mark.usefixtures("known_worlds")
BUNDLE = {"bucket": "robomaker", "prefix": "worlds/abc"}
PLACE = StoredPlace.model_validate(BUNDLE)


@pytest.fixture
def add_world(service: Service, tmp_path: Path) -> Callable[..., str]:
    """Adds a world that was not generated."""
    folder = tmp_path / "bundle"
    folder.mkdir()
    (folder / "world.xml").write_text("<mujoco/>")

    def add(number: int, **labels: str) -> str:
        service.store.ensure_bucket("robomaker")
        publish(
            service.store,
            PLACE.bucket,
            PLACE.prefix,
            regular_files(folder),
            about={"kind": "world"},
            created_at=service.clock(),
        )
        name = f"generation-{number:012}/world-1"
        world = Resource.new(
            arn=service.arn("world", name),
            kind="world",
            id=name,
            status="Active",
            labels={key: [value] for key, value in {"bundle": bundle_label(PLACE), **labels}.items()},
            document={"bundle": BUNDLE},
        )
        return service.catalog.create(world, token=None).arn

    return add


def listed(service: Service, **filters: str) -> list[str]:
    given = {"filters": [{"name": name, "values": [value]} for name, value in filters.items()]} if filters else {}
    return [world["arn"] for world in call("ListWorlds", given, service)["worldSummaries"]]


def stored(service: Service) -> list[str]:
    return [info.key for info in service.store.list("robomaker", "worlds/")]


def test_worlds_are_listed_newest_first_in_pages(service: Service, generate: Callable[..., dict[str, Any]]) -> None:
    made = generate(floorplans=3)["finishedWorldsSummary"]["succeededWorlds"]

    first = call("ListWorlds", {"maxResults": 2}, service)
    second = call("ListWorlds", {"maxResults": 2, "nextToken": first["nextToken"]}, service)

    listed = [world["arn"] for page in (first, second) for world in page["worldSummaries"]]
    assert sorted(listed) == sorted(made)
    assert "nextToken" not in second
    created = [world["createdAt"] for page in (first, second) for world in page["worldSummaries"]]
    assert created == sorted(created, reverse=True)


def test_worlds_are_listed_by_what_they_came_from(service: Service, template: str, generate: Generate) -> None:
    first, second = generate(), generate()
    worlds = [job["finishedWorldsSummary"]["succeededWorlds"][0] for job in (first, second)]

    assert listed(service, generationJobId=first["arn"].split("/")[1]) == worlds[:1]
    assert listed(service, templateId=template.split("/")[1]) == worlds[::-1]
    assert listed(service, status="Active") == worlds[::-1]
    assert listed(service, status="Pending") == []
    with pytest.raises(InvalidParameterException, match=r"'generationJob'.*generationJobId"):
        listed(service, generationJob="generation-x")


@examples(25, suppress_health_check=(HealthCheck.function_scoped_fixture,))
@given(st.integers(1, 4), st.lists(st.sampled_from(["read", "add", "delete"]), max_size=12))
def test_pages_hold_every_world_once_whatever_comes_and_goes(
    service: Service, add_world: Callable[..., str], size: int, steps: list[str]
) -> None:
    for arn in listed(service):
        service.catalog.delete(arn)
    there = [add_world(service.chance.randrange(10**12)) for _ in range(7)]
    seen: list[str] = []
    deleted: set[str] = set()
    request: dict[str, Any] = {"maxResults": size}
    for step in [*steps, *["read"] * 24]:
        if step == "add":
            add_world(service.chance.randrange(10**12))
        elif step == "delete":
            arn = service.chance.choice(there)
            call("BatchDeleteWorlds", {"worlds": [arn]}, service)
            deleted.add(arn)
        elif step == "read" and request:
            page = call("ListWorlds", request, service)
            seen += [world["arn"] for world in page["worldSummaries"]]
            request = {"maxResults": size, "nextToken": page["nextToken"]} if "nextToken" in page else {}

    assert len(seen) == len(set(seen))
    before = [arn for arn in seen if arn in there]
    assert before == [arn for arn in reversed(there) if arn in before]
    assert set(there) - deleted <= set(before)


def test_deleted_worlds_are_gone_with_what_is_stored_of_them(service: Service, generate: Generate) -> None:
    job = generate(2)
    first, second = job["finishedWorldsSummary"]["succeededWorlds"]
    bundle = service.catalog.get(second).document["bundle"]
    missing = service.arn("world", "generation-000000000000/world-1")

    answer = call("BatchDeleteWorlds", {"worlds": [first, missing, job["arn"], first]}, service)

    assert answer == {"unprocessedWorlds": [missing, job["arn"]]}
    assert listed(service) == [second]
    assert stored(service) == [f"{bundle['prefix']}/{name}" for name in sorted(files(service, bundle))]
    with pytest.raises(ResourceNotFoundException):
        call("DescribeWorld", {"world": first}, service)
    # What the job made is history.
    assert call("DescribeWorldGenerationJob", {"job": job["arn"]}, service) == job
    assert call("BatchDeleteWorlds", {"worlds": [second]}, service) == {"unprocessedWorlds": []}
    assert stored(service) == []


def files(service: Service, bundle: dict[str, str]) -> list[str]:
    return ["manifest.json", *(file.path for file in read_manifest(service.store, **bundle).files)]


def test_a_shared_bundle_goes_with_its_last_world_and_can_be_made_again(service: Service, generate: Generate) -> None:
    worlds = [generate()["finishedWorldsSummary"]["succeededWorlds"][0] for _ in range(2)]
    before = stored(service)

    call("BatchDeleteWorlds", {"worlds": worlds[:1]}, service)
    shared = stored(service)
    call("BatchDeleteWorlds", {"worlds": worlds[1:]}, service)

    assert shared == before
    assert stored(service) == []
    generate()
    assert stored(service) == before


def test_a_world_whose_bundle_cannot_be_removed_is_not_processed(
    service: Service, add_world: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    world = add_world(1)

    def refuse(bucket: str, key: str) -> None:
        raise StorageError(f"{bucket}/{key} is protected")

    with monkeypatch.context() as broken:
        broken.setattr(service.store, "delete", refuse)
        assert call("BatchDeleteWorlds", {"worlds": [world]}, service) == {"unprocessedWorlds": [world]}
    assert listed(service) == [world]
    assert call("BatchDeleteWorlds", {"worlds": [world]}, service) == {"unprocessedWorlds": []}
    assert stored(service) == []


def test_a_world_is_not_deleted_while_another_with_its_content_is_added(
    service: Service, add_world: Callable[..., str]
) -> None:
    first = add_world(1)
    deletion = threading.Thread(target=call, args=("BatchDeleteWorlds", {"worlds": [first]}, service))

    with bundle_held(PLACE, service):
        deletion.start()
        # Time enough to do what it must not do; a busy machine only gives it less.
        deletion.join(0.5)
        assert deletion.is_alive()
        second = add_world(2)
    deletion.join(120)

    assert listed(service) == [second]
    assert files(service, BUNDLE) == ["manifest.json", "world.xml"]
