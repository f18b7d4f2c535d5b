"""What botocore makes of the shipped model, without a server."""

import json
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from typing import Any

import botocore.session
import pytest
from botocore.awsrequest import AWSPreparedRequest
from botocore.client import BaseClient
from botocore.exceptions import EndpointResolutionError, ParamValidationError, WaiterError
from botocore.model import ServiceModel, StructureShape
from botocore.parsers import create_parser
from botocore.stub import Stubber
from botocore.waiter import WaiterModel

from prefect_robomaker.deployments.service_model.installation import DATA_PATH, FILES, MODEL_FOLDER
from prefect_robomaker.deployments.service_model.model import model_files
from prefect_robomaker.schemas.operations.registry import OPERATIONS

JOB = "arn:aws:robomaker:us-east-1:000000000000:simulation-job/sim-1"
ROLE = "arn:aws:iam::000000000000:role/local"


@pytest.fixture(scope="module")
def session() -> Iterator[botocore.session.Session]:
    """A session that knows the shipped model by nothing but the environment variable, and reads it once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AWS_DATA_PATH", str(DATA_PATH))
        patch.delenv("AWS_ENDPOINT_URL_ROBOMAKER", raising=False)
        patch.delenv("AWS_ENDPOINT_URL", raising=False)
        yield botocore.session.get_session()


@pytest.fixture
def make_client(session: botocore.session.Session) -> Callable[..., Any]:
    def make(endpoint_url: str | None = "http://127.0.0.1:1") -> BaseClient:
        return session.create_client(
            "robomaker",
            region_name="us-east-1",
            endpoint_url=endpoint_url,
            aws_access_key_id="key",
            aws_secret_access_key="secret",
        )

    return make


class Sent(Exception):
    """Ends a call when its request is ready."""


def request_of(client: BaseClient, method: str, **members: Any) -> AWSPreparedRequest:
    """The signed request of a call, which is not sent."""
    requests = []

    def keep(request: AWSPreparedRequest, **_: Any) -> None:
        requests.append(request)
        raise Sent

    client.meta.events.register("before-send.robomaker", keep)
    with pytest.raises(Sent):
        getattr(client, method)(**members)
    return requests[0]


def body_of(request: AWSPreparedRequest) -> Any:
    """The JSON that a request carries."""
    assert isinstance(request.body, str | bytes)
    return json.loads(request.body)


def test_the_committed_files_are_current() -> None:
    """Run `python -m prefect_robomaker.deployments.service_model.model` after changes of the schemas."""
    made = model_files()
    for name in FILES:
        assert (MODEL_FOLDER / name).read_text() == made[name], name


def test_sessions_find_the_service_by_the_environment_variable(session: botocore.session.Session) -> None:
    assert "robomaker" in session.get_available_services()
    assert session.get_service_model("robomaker").api_version == "2018-06-29"


def test_a_client_has_every_operation_and_all_documentation_is_there(make_client: Callable[..., Any]) -> None:
    client = make_client()

    assert set(client.meta.method_to_api_mapping.values()) == OPERATIONS.keys()
    model: ServiceModel = client.meta.service_model
    assert [name for name in OPERATIONS if not model.operation_model(name).documentation.startswith("<p>")] == []
    undocumented = [
        f"{name}.{member}"
        for name in model.shape_names
        if isinstance(shape := model.shape_for(name), StructureShape) and not shape.metadata.get("exception")
        for member, value in shape.members.items()
        if not value.documentation.startswith("<p>")
    ]
    assert undocumented == []


def test_requests_carry_the_extensions_and_a_generated_token(make_client: Callable[..., Any]) -> None:
    config = {"application": "wanderer", "launchConfig": {"command": ["run"]}}

    request = request_of(
        make_client(),
        "create_simulation_job",
        maxJobDurationInSeconds=60,
        iamRole=ROLE,
        robotApplications=[config],
        seed=7,
        video="always",
    )

    body = body_of(request)
    token = body.pop("clientRequestToken")
    assert len(token) == 36
    assert body == {
        "maxJobDurationInSeconds": 60,
        "iamRole": ROLE,
        "robotApplications": [config],
        "seed": 7,
        "video": "always",
    }
    assert (request.method, request.url) == ("POST", "http://127.0.0.1:1/createSimulationJob")
    authorization: Any = request.headers["Authorization"]
    assert b"/us-east-1/robomaker/aws4_request" in authorization


def test_no_token_is_made_up_for_templates(make_client: Callable[..., Any]) -> None:
    request = request_of(make_client(), "create_world_template", templateBody="{}")

    assert body_of(request) == {"templateBody": "{}"}


def test_tag_requests_have_the_arn_in_the_path_and_keys_in_the_query(make_client: Callable[..., Any]) -> None:
    request = request_of(make_client(), "untag_resource", resourceArn=JOB, tagKeys=["a", "b c"])

    encoded = JOB.replace(":", "%3A").replace("/", "%2F")
    assert request.method == "DELETE"
    assert request.url == f"http://127.0.0.1:1/tags/{encoded}?tagKeys=a&tagKeys=b%20c"


def test_the_smallest_durations_are_checked_by_the_client(make_client: Callable[..., Any]) -> None:
    with pytest.raises(ParamValidationError, match="maxJobDurationInSeconds, value: 0, valid min value: 1"):
        make_client().create_simulation_job(maxJobDurationInSeconds=0, iamRole=ROLE)


def test_answers_are_parsed_with_times(session: botocore.session.Session) -> None:
    operation = session.get_service_model("robomaker").operation_model("DescribeSimulationJob")
    answer = {
        "status_code": 200,
        "headers": {},
        "body": b'{"arn": "arn:x", "lastStartedAt": 1700000000.25, "tags": {}, "compute": {"computeType": "CPU"}}',
    }

    assert operation.output_shape is not None
    parsed = create_parser("rest-json").parse(answer, operation.output_shape)

    assert parsed["lastStartedAt"] == datetime(2023, 11, 14, 22, 13, 20, 250000, tzinfo=UTC)
    assert parsed["tags"] == {}
    assert parsed["compute"] == {"computeType": "CPU"}


def test_errors_have_classes(make_client: Callable[..., Any]) -> None:
    client = make_client()
    with Stubber(client) as stub:
        stub.add_client_error("describe_fleet", "ResourceNotFoundException", "there is none")

        with pytest.raises(client.exceptions.ResourceNotFoundException, match="there is none"):
            client.describe_fleet(fleet=JOB)


def test_lists_are_walked_page_by_page(make_client: Callable[..., Any]) -> None:
    client = make_client()
    with Stubber(client) as stub:
        stub.add_response("list_worlds", {"worldSummaries": [{"arn": "a"}], "nextToken": "t"}, {"maxResults": 1})
        stub.add_response("list_worlds", {"worldSummaries": [{"arn": "b"}]}, {"maxResults": 1, "nextToken": "t"})

        pages = client.get_paginator("list_worlds").paginate(PaginationConfig={"PageSize": 1})

        assert list(pages.search("worldSummaries[].arn")) == ["a", "b"]


WAITERS = {
    "simulation_job_running": ("describe_simulation_job", "job"),
    "simulation_job_completed": ("describe_simulation_job", "job"),
    "simulation_job_batch_completed": ("describe_simulation_job_batch", "batch"),
    "world_generation_job_completed": ("describe_world_generation_job", "job"),
    "world_export_job_completed": ("describe_world_export_job", "job"),
}


def wait(client: BaseClient, waiter: str, *states: str) -> None:
    """Waits without pauses for a job that is in one state after the other; all of them have to be asked for."""
    method, member = WAITERS[waiter]
    with Stubber(client) as stub:
        for state in states:
            stub.add_response(method, {"status": state}, {member: JOB})
        try:
            client.get_waiter(waiter).wait(**{member: JOB}, WaiterConfig={"Delay": 0, "MaxAttempts": len(states)})
        finally:
            stub.assert_no_pending_responses()


def test_there_are_these_waiters(make_client: Callable[..., Any]) -> None:
    assert sorted(make_client().waiter_names) == sorted(WAITERS)


@pytest.mark.parametrize(
    ("waiter", "states"),
    [
        ("simulation_job_running", ["Pending", "Preparing", "Restarting", "Running"]),
        ("simulation_job_running", ["Pending", "Completed"]),
        ("simulation_job_completed", ["Pending", "Running", "Terminating", "Completed"]),
        ("simulation_job_batch_completed", ["Pending", "InProgress", "Completing", "Completed"]),
        ("world_generation_job_completed", ["Pending", "Running", "Completed"]),
        ("world_export_job_completed", ["Pending", "Running", "Completed"]),
    ],
)
def test_waiting_ends_where_it_should(waiter: str, states: list[str], make_client: Callable[..., Any]) -> None:
    wait(make_client(), waiter, *states)


@pytest.mark.parametrize(
    ("waiter", "end"),
    [
        *((waiter, end) for waiter in WAITERS for end in ("Failed", "Canceled")),
        ("simulation_job_running", "RunningFailed"),
        ("simulation_job_completed", "RunningFailed"),
        ("simulation_job_completed", "Terminated"),
        ("simulation_job_batch_completed", "TimedOut"),
        ("world_generation_job_completed", "PartialFailed"),
    ],
)
def test_waiting_ends_where_nothing_leads_on(waiter: str, end: str, make_client: Callable[..., Any]) -> None:
    with pytest.raises(WaiterError, match="terminal failure state"):
        wait(make_client(), waiter, "Pending", end)


def test_waiters_ask_within_ten_seconds_and_for_half_an_hour_at_least(session: botocore.session.Session) -> None:
    model = WaiterModel(session.get_component("data_loader").load_service_model("robomaker", "waiters-2"))

    for name in model.waiter_names:
        waiter = model.get_waiter(name)
        assert 1 <= waiter.delay <= 10
        assert waiter.delay * waiter.max_attempts >= 30 * 60


def test_without_an_endpoint_nothing_is_sent_anywhere(make_client: Callable[..., Any]) -> None:
    with pytest.raises(EndpointResolutionError, match="AWS_ENDPOINT_URL_ROBOMAKER"):
        make_client(None).list_worlds()


def test_the_endpoint_can_be_an_environment_variable(
    make_client: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AWS_ENDPOINT_URL_ROBOMAKER", "http://127.0.0.1:2")

    assert request_of(make_client(None), "list_worlds").url == "http://127.0.0.1:2/listWorlds"
