"""Operations called from Python: one sentence for a wrong call, and no traceback of Prefect's engine."""

import json
import traceback
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

import prefect.flow_engine
import pytest
from prefect import Flow, flow, task
from prefect.states import Completed

from prefect_robomaker.flows import operations
from prefect_robomaker.flows.lookup import find_flow
from prefect_robomaker.flows.operation_flow import LightFlow
from prefect_robomaker.schemas.wire.errors import InvalidParameterException, ResourceNotFoundException, RobomakerError
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

NO_WORLD = "arn:aws:robomaker:us-east-1:000000000000:world/x"


@pytest.fixture
def no_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes Prefect refuse to begin any run."""

    def begin(**_: Any) -> None:
        raise AssertionError("a run was begun")

    monkeypatch.setattr(prefect.flow_engine, "run_flow", begin)


def refusal(attempt: Callable[[], Any]) -> RobomakerError:
    """The error of a call, which shows no traceback but that of the call itself."""
    with pytest.raises(RobomakerError) as raised:
        attempt()
    error = raised.value
    shown = "".join(traceback.format_exception(error))
    assert shown.count("Traceback") == 1
    assert "site-packages" not in shown
    return error


@pytest.mark.usefixtures("no_run")
@pytest.mark.parametrize(
    ("operation", "members"),
    [
        ("CreateWorldTemplate", {"nam": "flat", "templateBody": "{}"}),
        ("DescribeWorld", {}),
        ("CreateSimulationJob", {"maxJobDurationInSeconds": -5}),
        ("CreateWorldGenerationJob", {"template": "flat", "seed": "x"}),
        ("ListWorlds", {"maxResults": 1000}),
    ],
)
def test_a_wrong_call_is_answered_as_the_command_line_answers_it_and_begins_nothing(
    operation: str, members: dict[str, Any], service: Service
) -> None:
    needed = {"CreateSimulationJob": {"iamRole": "arn:aws:iam::000000000000:role/local"}}
    worlds = {"CreateWorldGenerationJob": {"worldCount": {"floorplanCount": 1, "interiorCountPerFloorplan": 1}}}
    whole = {**needed.get(operation, {}), **worlds.get(operation, {}), **members}
    with pytest.raises(InvalidParameterException) as expected:
        call(operation, whole, service)

    assert str(refusal(lambda: find_flow(operation)(**members))) == str(expected.value)


@pytest.mark.usefixtures("no_run")
def test_members_have_names_and_so_have_flows_with_other_options() -> None:
    assert str(refusal(lambda: find_flow("DescribeWorld")(NO_WORLD))) == (
        "DescribeWorld: members are given by name, such as DescribeWorld(world=…)"
    )
    named = find_flow("CreateWorldTemplate").with_options(flow_run_name="mine")
    assert "did you mean 'name'?" in str(refusal(lambda: named(nam="flat")))
    assert "'arn'" in str(refusal(lambda: operations.PerformWorldExportJob()))  # pyright: ignore[reportCallIssue]


def test_an_error_of_the_service_has_its_own_type_and_one_traceback(service: Service, prefect_server: str) -> None:
    with service.activated():
        error = refusal(lambda: find_flow("DescribeWorld")(world=NO_WORLD))

    assert isinstance(error, ResourceNotFoundException)


def test_a_defect_keeps_its_traceback(service: Service, prefect_server: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def defect(*_: Any) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(operations, "read", defect)
    with service.activated(), pytest.raises(ZeroDivisionError) as raised:
        find_flow("ListWorlds")()

    assert any(each.name == "defect" for each in raised.traceback)


def test_members_may_be_futures_in_a_flow(service: Service, prefect_server: str) -> None:
    @task
    def name() -> str:
        return "flat"

    @flow
    def mine() -> Any:
        return find_flow("CreateWorldTemplate")(name=name.submit(), templateBody="{}")

    with service.activated():
        assert mine()["name"] == "flat"


def test_a_call_without_what_has_a_default_does_it(service: Service, prefect_server: str) -> None:
    source = [{"s3Bucket": "applications", "s3Key": "a.tar.gz"}]
    service.store.ensure_bucket("applications")
    service.store.put_bytes("applications", "a.tar.gz", b"an archive")
    with service.activated():
        made = find_flow("CreateRobotApplication")(name="scout-2", sources=source)
        # The role and the bucket are those of the defaults; what is refused is that the world is not there.
        error = refusal(lambda: find_flow("CreateWorldExportJob")(worlds=[NO_WORLD]))

    assert made["robotSoftwareSuite"] == {"name": "General"}
    assert NO_WORLD in str(error)
    assert "iamRole" not in str(error)
    assert "outputLocation" not in str(error)


@pytest.mark.parametrize(
    "value",
    [
        {"a": [1, 2.5, None, "ä"], "b": {"c": True}},
        ("a", 1),
        datetime(2026, 1, 2, tzinfo=UTC),
        {datetime(2026, 1, 2, tzinfo=UTC): 1},
        {1, 2},
        object(),
        Completed(),
    ],
    ids=["json", "tuple", "time", "time as key", "set", "object", "state"],
)
def test_parameters_are_stored_as_prefect_stores_them(value: Any) -> None:
    def body(value: Any) -> Any:
        return value

    light, own = (made(body).serialize_parameters({"value": value}) for made in (LightFlow, Flow))

    assert json.dumps(light) == json.dumps(own)
