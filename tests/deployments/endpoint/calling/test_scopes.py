"""What access keys may call, and on which resources, as boto3's signatures say who calls."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from botocore.auth import SigV4Auth
from botocore.awsrequest import AWSRequest
from botocore.credentials import Credentials
from helpers.asgi import Answer, Client

from prefect_robomaker.deployments.endpoint.application import Endpoint
from prefect_robomaker.deployments.endpoint.calling.access_keys import AccessKey
from prefect_robomaker.deployments.endpoint.calling.audit_log import AuditLog
from prefect_robomaker.deployments.endpoint.calling.scopes import named_resources, needed_scope
from prefect_robomaker.schemas.operations.registry import OPERATIONS
from prefect_robomaker.tasks.service.service import Service

SECRET = "never-written"
KEYS = {
    key.id: key
    for key in (
        AccessKey("READ", SECRET, "reader", "read"),
        AccessKey("SUBMIT", SECRET, "submitter", "submit"),
        AccessKey("ADMIN", SECRET, "admin"),
        AccessKey("CI", SECRET, "ci", "administer", ("ci-",)),
        AccessKey("RED", SECRET, "red", "administer", (), ("team=red",)),
    )
}
BODY = {"Buildings": [{"Floors": [{"Floorplan": {"Rooms": [{"Type": "Living", "Name": "a"}]}}]}]}

Call = Callable[..., Answer]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "audit.jsonl"


@pytest.fixture
def call(service: Service, log: Path) -> Iterator[Call]:
    """Calls an operation with an access key."""
    with AuditLog(log, service.clock) as audit_log:
        client = Client(Endpoint(service, access_keys=KEYS, audit_log=audit_log))

        def call(key: str, operation: str, **members: Any) -> Answer:
            shape, body = OPERATIONS[operation], json.dumps(members).encode()
            headers = {"host": "h", "content-type": "application/json", "x-amz-meta": f"{next(numbers)}"}
            request = AWSRequest(method=shape.method, url=f"http://h{shape.path}", data=body, headers=headers)
            SigV4Auth(Credentials(key, SECRET), "robomaker", "us-east-1").add_auth(request)
            return client.send(shape.method, shape.path, body, dict(request.headers.items()))

        numbers = iter(range(1000))
        yield call
        client.close()


def made(answer: Answer) -> str:
    assert answer.status == 200, answer.body
    return answer.json["arn"]


def is_denied(answer: Answer) -> bool:
    return (answer.status, answer.error) == (403, "AccessDeniedException")


def template(call: Call, key: str, name: str, **tags: str) -> Answer:
    return call(key, "CreateWorldTemplate", name=name, templateBody=json.dumps(BODY), tags=tags)


def test_every_operation_has_a_scope() -> None:
    by_scope: dict[str, set[str]] = {"read": set(), "submit": set(), "administer": set()}
    for name in OPERATIONS:
        by_scope[needed_scope(name)].add(name)

    assert {name: len(names) for name, names in by_scope.items()} == {"read": 25, "submit": 9, "administer": 23}
    assert not [name for name in by_scope["read"] if OPERATIONS[name].is_job]


def test_scopes(call: Call) -> None:
    arn = made(template(call, "ADMIN", "flat"))
    job = {"template": arn, "worldCount": {"floorplanCount": 1, "interiorCountPerFloorplan": 1}}

    assert call("READ", "DescribeWorldTemplate", template=arn).status == 200
    assert is_denied(call("READ", "CreateWorldGenerationJob", **job))
    assert is_denied(template(call, "SUBMIT", "other"))
    assert is_denied(call("SUBMIT", "DeleteWorldTemplate", template=arn))
    generation = made(call("SUBMIT", "CreateWorldGenerationJob", **job))
    assert is_denied(call("READ", "CancelWorldGenerationJob", job=generation))
    assert call("SUBMIT", "CancelWorldGenerationJob", job=generation).status == 200


def test_names_confine(call: Call) -> None:
    other = made(template(call, "ADMIN", "nightly"))
    own = made(template(call, "CI", "ci-flat"))

    assert is_denied(template(call, "CI", "flat"))
    assert is_denied(call("CI", "DescribeWorldTemplate", template=other))
    assert is_denied(call("CI", "DescribeWorldTemplate", template=f"{other}x"))  # whether it exists is not told
    assert is_denied(call("CI", "UpdateWorldTemplate", template=own, name="nightly"))
    assert call("CI", "UpdateWorldTemplate", template=own, name="ci-2").status == 200
    assert [each["arn"] for each in call("CI", "ListWorldTemplates").json["templateSummaries"]] == [own]
    assert len(call("ADMIN", "ListWorldTemplates").json["templateSummaries"]) == 2


def test_tags_confine(call: Call) -> None:
    own = made(template(call, "RED", "flat", team="red"))
    other = made(template(call, "ADMIN", "blue flat", team="blue"))
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}

    assert is_denied(template(call, "RED", "flat"))
    assert is_denied(call("RED", "CreateWorldGenerationJob", template=own, worldCount=count))
    assert is_denied(call("RED", "CreateWorldGenerationJob", template=other, worldCount=count, tags={"team": "red"}))
    job = made(call("RED", "CreateWorldGenerationJob", template=own, worldCount=count, tags={"team": "red"}))
    assert call("RED", "DescribeWorldGenerationJob", job=job).status == 200
    assert is_denied(call("CI", "DescribeWorldGenerationJob", job=job))
    assert call("RED", "UpdateWorldTemplate", template=own, name="flat 2").status == 200


def test_applications_are_confined_by_name_too(call: Call) -> None:
    def job(key: str, robot: str, **tags: str) -> Answer:
        robots = [{"application": robot, "launchConfig": {"command": ["true"]}}]
        role = "arn:aws:iam::000000000000:role/local"
        members = {"robotApplications": robots, "iamRole": role, "maxJobDurationInSeconds": 9}
        return call(key, "CreateSimulationJob", **members, tags=tags)

    uri = {"uri": "python://my_robot"}
    application = {"robotSoftwareSuite": {"name": "General"}, "environment": uri}
    mine = made(call("ADMIN", "CreateRobotApplication", name="rover", tags={"team": "red"}, **application))
    theirs = made(call("ADMIN", "CreateRobotApplication", name="other", **application))

    for reference in ("scout", "rover", mine):
        assert made(job("RED", reference, team="red"))
    for reference in ("other", theirs, "nowhere"):
        assert is_denied(job("RED", reference, team="red"))
    assert is_denied(job("RED", "scout", team="blue"))
    requests = [
        {"robotApplications": [{"application": "scout", "launchConfig": {}}], "maxJobDurationInSeconds": 9, **more}
        for more in ({"tags": {"team": "red"}}, {})
    ]
    answer = call("RED", "StartSimulationJobBatch", createSimulationJobRequests=requests, tags={"team": "red"})
    assert is_denied(answer)
    assert "createSimulationJobRequests[1].tags" in answer.json["message"]


def test_text_is_no_resource() -> None:
    arn = "arn:aws:robomaker:us-east-1:000000000000:world-template/a"
    launch = {"environmentVariables": {"A": arn}}
    request = {"iamRole": "arn:aws:iam::1:role/a", "tags": {"a": arn}, "robotApplications": [{"launchConfig": launch}]}

    assert list(named_resources(request)) == []
    assert list(named_resources({**request, "worlds": [arn]})) == [arn]


def test_the_audit_log_says_who_did_what(call: Call, log: Path) -> None:
    arn = made(template(call, "ADMIN", "flat"))
    call("READ", "DeleteWorldTemplate", template=arn)
    call("READ", "DescribeWorldTemplate", template=arn)
    call("NOBODY", "ListWorlds")

    lines = [json.loads(line) for line in log.read_text().splitlines()]
    told = [(each["caller"], each["operation"], each["resources"], each["outcome"]) for each in lines]
    assert told == [
        ("admin", "CreateWorldTemplate", [arn], "ok"),
        ("reader", "DeleteWorldTemplate", [], "AccessDeniedException"),
        ("reader", "DescribeWorldTemplate", [arn, arn], "ok"),
        (None, None, [], "UnrecognizedClientException"),
    ]
    assert {each["address"] for each in lines} == {"127.0.0.1"}
    assert all(each["time"].endswith("Z") for each in lines)
    assert log.stat().st_mode & 0o777 == 0o600
    assert SECRET not in log.read_text()


def test_client_tokens_belong_to_their_key(call: Call) -> None:
    """Another key's resource was named in an error, or given back as if it was one's own."""
    template = {"templateBody": json.dumps(BODY), "clientRequestToken": "a-token-that-both-use"}
    first = call("ADMIN", "CreateWorldTemplate", name="a", **template)

    same = call("CI", "CreateWorldTemplate", name="a", **template)
    other = call("CI", "CreateWorldTemplate", name="ci-b", **template)

    assert (same.status, other.status) == (403, 200), "the first may not make it; the token says nothing of it"
    assert made(other) != made(first)
    assert made(call("ADMIN", "CreateWorldTemplate", name="a", **template)) == made(first)
    refused = call("CI", "CreateWorldTemplate", name="ci-c", **template)
    assert refused.status == 400
    assert made(first).encode() not in refused.body
