"""Worlds of a fixed seed are found again: by template, seeds and generator, while their bundle is stored."""

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from helpers.small_flat import BODY

from prefect_robomaker.schemas.documents.worlds import WorldDocument
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Progress, Service
from prefect_robomaker.tasks.worlds import generation
from prefect_robomaker.tasks.worlds.builders import WorldBuilders

pytestmark = pytest.mark.usefixtures("known_worlds")

Generate = Callable[..., dict[str, Any]]


@pytest.fixture
def again(service: Service, template: str, prefect_server: str) -> Generate:
    """Generates worlds in a run that may take some over."""
    reusing = service.ordered_by("night-2", reuse=True)

    def run(floorplans: int = 2, **members: Any) -> dict[str, Any]:
        count = {"floorplanCount": floorplans, "interiorCountPerFloorplan": 1}
        job = call("CreateWorldGenerationJob", {"template": template, "worldCount": count, **members}, reusing)
        return registry()["CreateWorldGenerationJob"].perform(job["arn"], service)

    return run


@pytest.fixture
def built(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """The seeds of worlds that are built."""
    seeds: list[tuple[int, int]] = []
    build = WorldBuilders.build

    def noted(builders: WorldBuilders, body: str, *rest: Any) -> str:
        seeds.append(rest[:2])
        return build(builders, body, *rest)

    monkeypatch.setattr(WorldBuilders, "build", noted)
    return seeds


def bundles(service: Service, job: dict[str, Any]) -> list[Any]:
    arns = job["finishedWorldsSummary"]["succeededWorlds"]
    return [WorldDocument.of(service.catalog.get(arn)).bundle for arn in arns]


def test_worlds_of_a_seed_are_found_again(
    service: Service, generate: Generate, again: Generate, built: list[Any]
) -> None:
    first = generate(floorplans=2)
    assert len(built) == 2

    second = again(seed=7, worldTags={"night": "2"})
    assert len(built) == 2, "none was built"
    assert second["status"] == "Completed"
    assert bundles(service, second) == bundles(service, first)
    worlds = second["finishedWorldsSummary"]["succeededWorlds"]
    assert not set(worlds) & set(first["finishedWorldsSummary"]["succeededWorlds"]), "worlds of their own"
    told = call("DescribeWorld", {"world": worlds[1]}, service)
    assert (told["generationJob"], told["tags"]) == (second["arn"], {"night": "2"})
    origin = WorldDocument.of(service.catalog.get(worlds[1])).reused_from
    assert origin == first["finishedWorldsSummary"]["succeededWorlds"][1]

    third = again(3, seed=7)
    assert len(built) == 3, "only the one that is new"
    assert bundles(service, third)[:2] == bundles(service, first)


def test_worlds_that_are_taken_over_are_counted_as_such(service: Service, template: str, generate: Generate) -> None:
    generate(floorplans=1)
    told: list[Progress] = []
    reusing = service.ordered_by("night-2", reuse=True)
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}
    job = call("CreateWorldGenerationJob", {"template": template, "worldCount": count, "seed": 7}, reusing)
    registry()["CreateWorldGenerationJob"].perform(job["arn"], replace(service, report_progress=told.append))
    counts = {state: number for state, number in told[-1].counts.items() if number}
    assert (counts, told[-1].total) == ({"taken over": 1}, 1)


@pytest.mark.deep
def test_what_is_asked_for_anew_is_built(
    service: Service, generate: Generate, again: Generate, built: list[Any], template: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    generate(floorplans=1)
    generate(floorplans=1)
    assert len(built) == 2, "without reuse"
    again(1, seed=8)
    assert len(built) == 3, "another seed"
    again(1)
    assert len(built) == 4, "no seed"
    with monkeypatch.context() as patch:
        patch.setattr(generation, "GENERATOR_VERSION", "9.9")
        again(1, seed=7)
    assert len(built) == 5, "another generator"
    call("UpdateWorldTemplate", {"template": template, "templateBody": json.dumps({**BODY, "Version": "1"})}, service)
    again(1, seed=7)
    assert len(built) == 6, "another template"


def test_a_world_that_was_deleted_is_made_again(
    service: Service, generate: Generate, again: Generate, built: list[Any]
) -> None:
    (world,) = generate(floorplans=1)["finishedWorldsSummary"]["succeededWorlds"]
    taken = again(1, seed=7)["finishedWorldsSummary"]["succeededWorlds"]
    call("BatchDeleteWorlds", {"worlds": [world]}, service)
    assert again(1, seed=7)["status"] == "Completed"
    assert len(built) == 1, "the other world keeps the bundle"

    worlds = [each.arn for each in service.catalog.list("world").resources]
    assert taken[0] in worlds
    call("BatchDeleteWorlds", {"worlds": worlds}, service)
    assert again(1, seed=7)["status"] == "Completed"
    assert len(built) == 2
