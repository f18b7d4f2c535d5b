"""Steps that make templates: one that is there already is taken, another body is made anew."""

import json
from typing import Any

import pytest
from helpers.small_flat import BODY
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.wire.errors import ResourceAlreadyExistsException
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.operations.step_operations import existing_resource
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.worlds.reuse import same_body

REQUEST = {"name": "flat", "templateBody": json.dumps(BODY)}


def taken(service: Service, request: dict[str, Any], **members: str) -> str | None:
    """ARN of the template that a step takes instead of making one."""
    step = {"operation": "CreateWorldTemplate", "input": request, **members}
    checked = load_spec(json.dumps({"version": 1, "name": "one", "steps": {"template": step}}), "one.json")
    answer = existing_resource(checked.steps["template"], request, service)
    return answer["arn"] if answer else None


def turned(value: Any) -> Any:
    """The same JSON with the members of all objects the other way round."""
    if isinstance(value, dict):
        return {name: turned(inner) for name, inner in reversed(value.items())}
    return [turned(inner) for inner in value] if isinstance(value, list) else value


def test_a_template_whose_body_did_not_change_is_taken_however_it_is_written(service: Service) -> None:
    assert taken(service, REQUEST) is None
    made = call("CreateWorldTemplate", REQUEST, service)["arn"]
    assert taken(service, REQUEST) == made
    assert taken(service, {**REQUEST, "templateBody": json.dumps(turned(BODY), indent=4)}) == made
    assert taken(service, {**REQUEST, "templateBody": json.dumps({"name": "x", "templateBody": BODY})}) == made


def test_another_body_name_or_tag_is_made_anew(service: Service) -> None:
    call("CreateWorldTemplate", REQUEST, service)
    other = json.loads(json.dumps(BODY))
    other["Buildings"][0]["Floors"][0]["Floorplan"]["Ceiling"] = {"Height": 2.9}
    assert taken(service, {**REQUEST, "templateBody": json.dumps(other)}) is None
    assert taken(service, {**REQUEST, "name": "loft"}) is None
    assert taken(service, {**REQUEST, "tags": {"team": "red"}}) is None


def test_a_template_that_was_changed_since_is_not_taken_for_what_it_was(service: Service) -> None:
    made = call("CreateWorldTemplate", REQUEST, service)["arn"]
    other = json.loads(json.dumps(BODY))
    other["Buildings"][0]["Floors"][0]["Floorplan"]["Ceiling"] = {"Height": 2.9}
    call("UpdateWorldTemplate", {"template": made, "templateBody": json.dumps(other)}, service)
    assert taken(service, REQUEST) is None


def test_an_older_template_of_the_body_is_found_behind_newer_ones_of_the_name(service: Service) -> None:
    made = call("CreateWorldTemplate", REQUEST, service)["arn"]
    for height in range(25):  # more than a page of the list
        other = json.loads(json.dumps(BODY))
        other["Buildings"][0]["Floors"][0]["Floorplan"]["Ceiling"] = {"Height": 2.5 + height / 100}
        call("CreateWorldTemplate", {**REQUEST, "templateBody": json.dumps(other)}, service)
    assert taken(service, REQUEST) == made


def test_fail_refuses_a_name_that_is_taken(service: Service) -> None:
    assert taken(service, REQUEST, ifExists="fail") is None
    call("CreateWorldTemplate", REQUEST, service)
    with pytest.raises(ResourceAlreadyExistsException, match="has the name 'flat' already"):
        taken(service, REQUEST, ifExists="fail")


@given(
    st.recursive(st.none() | st.booleans() | st.integers() | st.text(), lambda each: st.dictionaries(st.text(), each))
)
def test_the_order_of_members_never_tells_two_bodies_apart(value: Any) -> None:
    assert same_body(json.dumps(value), json.dumps(turned(value), indent=1))
    assert not same_body(json.dumps({"a": 1, "b": value}), json.dumps({"a": True, "b": value}))


def test_fail_takes_the_template_that_the_same_step_made_before_its_answer_was_lost(service: Service) -> None:
    request = {**REQUEST, "clientRequestToken": "nightly-20260302-template"}
    call("CreateWorldTemplate", request, service)
    assert taken(service, request, ifExists="fail") is None
    assert len(call("ListWorldTemplates", {}, service)["templateSummaries"]) == 1
    with pytest.raises(ResourceAlreadyExistsException):
        taken(service, {**request, "clientRequestToken": "nightly-20260303-template"}, ifExists="fail")
