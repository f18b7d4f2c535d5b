import inspect
from datetime import datetime

import pytest

from prefect_robomaker.flows import operations
from prefect_robomaker.flows.lookup import find_flow, find_perform_flow
from prefect_robomaker.flows.request_defaults import default_members
from prefect_robomaker.schemas.operations.registry import OPERATIONS
from prefect_robomaker.schemas.wire.errors import InvalidParameterException
from prefect_robomaker.tasks.operations import registry as operation
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service


def test_every_operation_is_registered() -> None:
    assert set(registry()) == set(OPERATIONS)


@pytest.mark.parametrize("name", sorted(OPERATIONS))
def test_every_operation_is_a_flow_of_its_name_with_the_members_as_parameters(name: str) -> None:
    flow = find_flow(name)

    assert flow.name == name
    parameters = inspect.signature(flow.fn).parameters
    assert set(parameters) == set(OPERATIONS[name].request.model_fields)
    required = {member for member, field in OPERATIONS[name].request.model_fields.items() if field.is_required()}
    assert set(flow.parameters.required) == required - set(default_members(OPERATIONS[name]))
    assert getattr(operations, name) is flow
    assert flow.fn.__module__ == operations.__name__


def test_job_operations_have_a_flow_that_performs_a_stored_job() -> None:
    jobs = {name for name, entry in registry().items() if entry.run_job}

    assert {find_perform_flow(name).name for name in jobs} == {
        "PerformDeploymentJob",
        "PerformSimulationJob",
        "PerformSimulationJobBatch",
        "PerformWorldExportJob",
        "PerformWorldGenerationJob",
    }


def test_there_is_no_flow_of_another_name() -> None:
    with pytest.raises(AttributeError, match="CreateWorlds"):
        getattr(operations, "CreateWorlds")  # noqa: B009 - a type checker sees as well that it is not there


def test_a_flow_run_answers_like_a_direct_call(service: Service, prefect_server: str) -> None:
    with service.activated():
        made = find_flow("CreateWorldTemplate")(name="default", templateBody="{}")

    assert isinstance(made["createdAt"], datetime)
    assert call("DescribeWorldTemplate", {"template": made["arn"]}, service)["name"] == "default"


def test_a_refused_request_fails_the_flow_run_with_the_services_error(service: Service, prefect_server: str) -> None:
    with service.activated(), pytest.raises(InvalidParameterException, match="templateBody"):
        find_flow("CreateWorldTemplate")(name="neither body nor location")


def test_an_unknown_operation_is_refused_with_the_nearest_name(service: Service) -> None:
    with pytest.raises(InvalidParameterException, match="ListWorlds"):
        call("ListWorld", {}, service)


def test_an_unknown_member_is_refused_with_the_nearest_name(service: Service) -> None:
    with pytest.raises(InvalidParameterException, match="maxResults"):
        call("ListWorlds", {"maxResult": 3}, service)


def test_a_quick_operation_has_nothing_to_perform(service: Service) -> None:
    with pytest.raises(InvalidParameterException, match="ListWorlds"):
        registry()["ListWorlds"].perform("arn:aws:robomaker:us-east-1:000000000000:world/x", service)


def test_decorating_a_quick_operation_with_a_worker_is_a_mistake() -> None:
    with pytest.raises(ValueError, match="DescribeWorld"):
        operation.operation("DescribeWorld", perform=lambda arn, service: None)(lambda request, service: request)
