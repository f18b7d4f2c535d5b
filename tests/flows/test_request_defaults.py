"""Defaults of members that the service requires."""

import re
from typing import Any

import pytest

from prefect_robomaker.flows.lookup import find_flow
from prefect_robomaker.flows.request_defaults import default_members, with_defaults, with_defaults_of
from prefect_robomaker.schemas.operations.registry import OPERATIONS, parse_request
from prefect_robomaker.schemas.wire.errors import InvalidParameterException
from prefect_robomaker.tasks.service.service import Service


def problems_of(operation: str, members: dict[str, Any]) -> str:
    try:
        parse_request(operation, members)
    except InvalidParameterException as error:
        return str(error)
    return ""


@pytest.mark.parametrize("name", OPERATIONS)
def test_defaults_are_of_required_members_are_right_by_themselves_and_change_nothing_given(name: str) -> None:
    shape = OPERATIONS[name]
    required = {member for member, field in shape.request.model_fields.items() if field.is_required()}

    assert set(default_members(shape)) <= required
    made = with_defaults(shape, {}, bucket="any-bucket", token="any")
    assert not [each for each in made if re.search(rf"^{name}: {each}\b", problems_of(name, made), re.MULTILINE)]
    assert with_defaults(shape, dict.fromkeys(made, "given"), bucket="b", token="t") == dict.fromkeys(made, "given")


def test_an_update_never_changes_what_its_caller_did_not_name() -> None:
    assert all(not default_members(shape) for name, shape in OPERATIONS.items() if name.startswith("Update"))


def test_each_call_has_a_token_of_its_own(service: Service) -> None:
    shape = OPERATIONS["SyncDeploymentJob"]
    tokens = {with_defaults_of(shape, {}, service)["clientRequestToken"] for _ in range(3)}

    assert len(tokens) == 3
    assert all(re.fullmatch("[0-9a-f]{32}", token) for token in tokens)


def test_forms_of_prefect_show_the_defaults() -> None:
    schema = find_flow("CreateSimulationJob").parameters

    assert not {"iamRole", "maxJobDurationInSeconds"} & set(schema.required or [])
    assert schema.properties["iamRole"]["default"] == "arn:aws:iam::000000000000:role/local"
    assert "worlds" in (find_flow("CreateWorldExportJob").parameters.required or [])
