import json
from collections.abc import Callable
from datetime import datetime
from typing import Any

import pytest
from small_flat import BODY

from prefect_robomaker.flows.operation import call
from prefect_robomaker.schemas.errors import (
    IdempotentParameterMismatchException,
    InvalidParameterException,
    ResourceNotFoundException,
)
from prefect_robomaker.tasks.service import Service
from prefect_robomaker.tasks.storage import read_manifest


def test_a_template_is_described_and_its_body_returned_unchanged(service: Service) -> None:
    text = json.dumps(BODY, indent=3)
    made = call("CreateWorldTemplate", {"name": "two rooms", "templateBody": text, "tags": {"team": "nav"}}, service)

    described = call("DescribeWorldTemplate", {"template": made["arn"]}, service)

    assert made["arn"].startswith("arn:aws:robomaker:us-east-1:000000000000:world-template/template-")
    assert described["version"] == "1"
    assert described["tags"] == {"team": "nav"}
    assert isinstance(described["createdAt"], datetime)
    assert call("GetWorldTemplateBody", {"template": made["arn"]}, service) == {"templateBody": text}


def test_a_template_body_may_come_from_the_object_store(service: Service) -> None:
    service.store.ensure_bucket("templates")
    service.store.put_bytes("templates", "flat.json", json.dumps(BODY).encode())
    location = {"s3Bucket": "templates", "s3Key": "flat.json"}

    made = call("CreateWorldTemplate", {"name": "flat", "templateLocation": location}, service)

    assert json.loads(call("GetWorldTemplateBody", {"template": made["arn"]}, service)["templateBody"]) == BODY
    with pytest.raises(InvalidParameterException, match=r"s3://templates/other\.json does not exist"):
        call("CreateWorldTemplate", {"templateLocation": {**location, "s3Key": "other.json"}}, service)


def test_a_bad_body_is_refused_with_its_path_and_nothing_is_stored(service: Service) -> None:
    body = json.loads(json.dumps(BODY))
    body["Buildings"][0]["Floors"][0]["Floorplan"]["Rooms"][0]["Type"] = "Bedrom"

    with pytest.raises(InvalidParameterException, match=r"Rooms\[0\]\.Type.*Bedrom.*Bedroom"):
        call("CreateWorldTemplate", {"name": "bad", "templateBody": json.dumps(body)}, service)
    assert service.catalog.list("world-template").resources == ()


def test_interiors_of_one_floor_plan_share_it(service: Service, generate: Callable[..., dict[str, Any]]) -> None:
    job = generate(floorplans=1, interiors=2, worldTags={"night": "1"})

    assert job["status"] == "Completed"
    assert job["finishedWorldsSummary"]["finishedCount"] == 2
    worlds = [service.catalog.get(arn) for arn in job["finishedWorldsSummary"]["succeededWorlds"]]
    plans = []
    for world in worlds:
        bundle = world.document["bundle"]
        names = {file.path for file in read_manifest(service.store, **bundle).files}
        assert names == {"world.json", "world.xml", "map.pgm", "map.yaml", "floorplan.svg", "preview.png"}
        plans.append(json.loads(service.store.get_bytes(bundle["bucket"], bundle["prefix"] + "/world.json")))
    assert plans[0]["floorplan"]["walls"] == plans[1]["floorplan"]["walls"]
    assert plans[0]["furniture"] != plans[1]["furniture"]
    assert call("DescribeWorld", {"world": worlds[0].arn}, service)["tags"] == {"night": "1"}


def test_the_same_seed_gives_the_same_worlds(service: Service, generate: Callable[..., dict[str, Any]]) -> None:
    first, second = generate(), generate()

    bundles = [
        service.catalog.get(job["finishedWorldsSummary"]["succeededWorlds"][0]).document["bundle"]
        for job in (first, second)
    ]
    assert first["arn"] != second["arn"]
    assert bundles[0] == bundles[1]


def test_worlds_are_listed_newest_first_in_pages(service: Service, generate: Callable[..., dict[str, Any]]) -> None:
    made = generate(floorplans=3)["finishedWorldsSummary"]["succeededWorlds"]

    first = call("ListWorlds", {"maxResults": 2}, service)
    second = call("ListWorlds", {"maxResults": 2, "nextToken": first["nextToken"]}, service)

    listed = [world["arn"] for page in (first, second) for world in page["worldSummaries"]]
    assert sorted(listed) == sorted(made)
    assert "nextToken" not in second
    created = [world["createdAt"] for page in (first, second) for world in page["worldSummaries"]]
    assert created == sorted(created, reverse=True)


def test_the_body_is_kept_as_it_was_when_the_job_was_made(
    service: Service, generate: Callable[..., dict[str, Any]], template: str
) -> None:
    job = generate()
    service.catalog.update(template, lambda document: {**document, "templateBody": "{}"})

    body = call("GetWorldTemplateBody", {"generationJob": job["arn"]}, service)["templateBody"]

    assert json.loads(body) == BODY


def test_too_many_worlds_are_refused_and_nothing_is_stored(service: Service, template: str) -> None:
    count = {"floorplanCount": 17, "interiorCountPerFloorplan": 3}

    with pytest.raises(InvalidParameterException, match="51 worlds; a job may make at most 50"):
        call("CreateWorldGenerationJob", {"template": template, "worldCount": count}, service)
    assert service.catalog.list("world-generation-job").resources == ()


def test_a_cancelled_job_keeps_no_promise_but_ends(service: Service, template: str, prefect_server: str) -> None:
    from prefect_robomaker.flows.operation import registry

    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}
    job = call("CreateWorldGenerationJob", {"template": template, "worldCount": count}, service)
    service.catalog.request_cancel(job["arn"])

    ended = registry()["CreateWorldGenerationJob"].perform(job["arn"], service)

    assert ended["status"] == "Canceled"


def test_a_client_token_makes_creation_repeatable(service: Service, template: str) -> None:
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}
    request = {"template": template, "worldCount": count, "clientRequestToken": "once"}

    first, again = (call("CreateWorldGenerationJob", request, service) for _ in range(2))

    assert first == again
    with pytest.raises(IdempotentParameterMismatchException):
        call("CreateWorldGenerationJob", {**request, "worldTags": {"other": "1"}}, service)


def test_an_unknown_template_is_not_found(service: Service) -> None:
    arn = "arn:aws:robomaker:us-east-1:000000000000:world-template/template-000000000000"
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}

    with pytest.raises(ResourceNotFoundException, match="template-000000000000"):
        call("CreateWorldGenerationJob", {"template": arn, "worldCount": count}, service)
