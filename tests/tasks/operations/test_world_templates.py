"""World templates: what is kept of them, how they change and go."""

import json
from collections.abc import Callable
from datetime import datetime
from typing import Any

import pytest
from helpers.small_flat import BODY

from prefect_robomaker.schemas.wire.errors import InvalidParameterException, ResourceNotFoundException
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

OTHER = {"Buildings": [{"Floors": [{"Floorplan": {"Ceiling": {"Height": 2.8}}}]}]}
NOWHERE = "arn:aws:robomaker:us-east-1:000000000000:world-template/template-000000000000"


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


@pytest.mark.parametrize("as_text", [True, False])
def test_a_wrapped_body_is_unwrapped(service: Service, as_text: bool) -> None:
    wrapped = {"name": "sample", "templateBody": BODY}

    made = call("CreateWorldTemplate", {"templateBody": json.dumps(wrapped) if as_text else wrapped}, service)

    assert json.loads(call("GetWorldTemplateBody", {"template": made["arn"]}, service)["templateBody"]) == BODY
    assert "name" not in made


def test_an_update_changes_what_it_names_and_nothing_else(service: Service, template: str) -> None:
    before = call("DescribeWorldTemplate", {"template": template}, service)

    renamed = call("UpdateWorldTemplate", {"template": template, "name": "flat two"}, service)
    body = call("GetWorldTemplateBody", {"template": template}, service)["templateBody"]
    call("UpdateWorldTemplate", {"template": template, "templateBody": OTHER}, service)

    assert renamed.keys() == {"arn", "name", "createdAt", "lastUpdatedAt"}
    assert (renamed["arn"], renamed["name"], renamed["createdAt"]) == (template, "flat two", before["createdAt"])
    assert renamed["lastUpdatedAt"] > before["lastUpdatedAt"]
    assert json.loads(body) == BODY
    assert json.loads(call("GetWorldTemplateBody", {"template": template}, service)["templateBody"]) == OTHER
    after = call("DescribeWorldTemplate", {"template": template}, service)
    assert after["lastUpdatedAt"] > renamed["lastUpdatedAt"]
    assert {**after, "lastUpdatedAt": 0} == {**before, "name": "flat two", "lastUpdatedAt": 0}


def test_an_update_may_take_the_body_from_the_object_store(service: Service, template: str) -> None:
    service.store.ensure_bucket("templates")
    service.store.put_bytes("templates", "flat.json", json.dumps(OTHER).encode())

    location = {"s3Bucket": "templates", "s3Key": "flat.json"}
    call("UpdateWorldTemplate", {"template": template, "templateLocation": location}, service)

    assert json.loads(call("GetWorldTemplateBody", {"template": template}, service)["templateBody"]) == OTHER


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({}, InvalidParameterException, "nothing is to be changed"),
        (
            {"templateBody": "{}", "templateLocation": {"s3Bucket": "abc", "s3Key": "k"}},
            InvalidParameterException,
            "both given",
        ),
        ({"name": "new", "templateBody": '{"Building": []}'}, InvalidParameterException, "Building: unknown"),
        ({"templateLocation": {"s3Bucket": "nowhere", "s3Key": "k"}}, InvalidParameterException, "nowhere"),
        ({"template": NOWHERE, "name": "new"}, ResourceNotFoundException, "template-000000000000"),
    ],
)
def test_an_update_that_cannot_be_made_changes_nothing(
    service: Service, template: str, change: dict[str, Any], error: type[Exception], words: str
) -> None:
    before = service.catalog.get(template)

    with pytest.raises(error, match=words):
        call("UpdateWorldTemplate", {"template": template, **change}, service)
    assert service.catalog.get(template) == before


def test_templates_are_listed_newest_first_and_no_page_repeats_one(service: Service) -> None:
    def create(name: str) -> str:
        return call("CreateWorldTemplate", {"name": name, "templateBody": "{}"}, service)["arn"]

    made = [create(f"flat {number}") for number in range(5)]
    pages = [call("ListWorldTemplates", {"maxResults": 2}, service)]
    while "nextToken" in pages[-1]:
        create("made meanwhile")
        request = {"maxResults": 2, "nextToken": pages[-1]["nextToken"]}
        pages.append(call("ListWorldTemplates", request, service))

    summaries = [summary for page in pages for summary in page["templateSummaries"]]
    assert [summary["arn"] for summary in summaries] == made[::-1]
    assert summaries[0].keys() == {"arn", "createdAt", "lastUpdatedAt", "name", "version"}
    assert summaries[0]["name"] == "flat 4"
    with pytest.raises(InvalidParameterException, match="nextToken"):
        call("ListWorlds", {"nextToken": pages[0]["nextToken"]}, service)


def test_an_empty_list_is_there(service: Service) -> None:
    assert call("ListWorldTemplates", {}, service) == {"templateSummaries": []}
    assert call("ListWorlds", {}, service) == {"worldSummaries": []}
    assert call("ListWorldGenerationJobs", {}, service) == {"worldGenerationJobSummaries": []}
    assert call("ListWorldExportJobs", {}, service) == {"worldExportJobSummaries": []}


@pytest.mark.usefixtures("known_worlds")
def test_what_was_made_of_a_deleted_template_stays(
    service: Service, template: str, generate: Callable[..., dict[str, Any]]
) -> None:
    job = generate()
    (world,) = job["finishedWorldsSummary"]["succeededWorlds"]

    assert call("DeleteWorldTemplate", {"template": template}, service) == {}

    assert call("DescribeWorld", {"world": world}, service)["template"] == template
    assert call("DescribeWorldGenerationJob", {"job": job["arn"]}, service) == job
    assert json.loads(call("GetWorldTemplateBody", {"generationJob": job["arn"]}, service)["templateBody"]) == BODY
    for operation in ("DescribeWorldTemplate", "GetWorldTemplateBody", "DeleteWorldTemplate"):
        with pytest.raises(ResourceNotFoundException, match=template):
            call(operation, {"template": template}, service)
