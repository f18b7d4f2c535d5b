"""Requests and answers as they travel."""

import asyncio
import json
import logging
import re
import sqlite3
import threading
import uuid
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlencode

import pytest
from helpers.asgi import JSON, Client

from prefect_robomaker.deployments.endpoint.application import MAX_IN_PROGRESS, Endpoint
from prefect_robomaker.deployments.endpoint.failures import Failures
from prefect_robomaker.deployments.endpoint.request_bodies import LARGE_BODIES, SMALL_BODIES
from prefect_robomaker.deployments.endpoint.wire import MAX_BODY_BYTES
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.errors import ResourceNotFoundException
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service

LISTS = [name for name, entry in registry().items() if entry.shape.result_key]


@pytest.mark.parametrize("name", LISTS)
def test_lists_take_no_body_and_an_empty_object(name: str, client: Client) -> None:
    empty, nothing = client.call(name), client.send("POST", f"/{name[0].lower()}{name[1:]}", b"", {"content-type": ""})

    assert (empty.status, nothing.status) == (200, 200), (empty, nothing)
    assert empty.json == nothing.json
    assert isinstance(empty.json[registry()[name].shape.result_key], list)


def test_answers_are_json_with_a_request_id_and_times_in_seconds(
    client: Client, service: Service, template: str
) -> None:
    answer = client.call("DescribeWorldTemplate", template=template)

    assert answer.status == 200
    assert answer.headers["content-type"] == JSON
    assert uuid.UUID(answer.headers["x-amzn-requestid"]).version == 4
    created = service.catalog.get(template).created_at
    assert isinstance(answer.json["createdAt"], float)
    assert abs(datetime.fromtimestamp(answer.json["createdAt"], UTC) - created) <= timedelta(milliseconds=1)
    assert round(answer.json["createdAt"], 3) == answer.json["createdAt"]


def test_answers_are_those_of_direct_calls_without_absent_members(
    client: Client, service: Service, template: str
) -> None:
    direct = call("ListWorlds", {}, service)

    assert client.call("ListWorlds").json == direct == {"worldSummaries": []}
    assert None not in client.call("DescribeWorldTemplate", template=template).json.values()


def test_members_that_are_null_are_absent(client: Client) -> None:
    answer = client.call("ListWorlds", maxResults=None, nextToken=None, filters=None)

    assert answer.status == 200


def test_request_ids_differ(client: Client) -> None:
    assert len({client.call("ListWorlds").headers["x-amzn-requestid"] for _ in range(50)}) == 50


def test_errors_have_their_name_in_header_and_body(client: Client) -> None:
    answer = client.call("DescribeWorld", world="arn:aws:robomaker:us-east-1:000000000000:world/none")

    assert (answer.status, answer.error) == (400, "ResourceNotFoundException")
    assert answer.json.keys() == {"__type", "message"}
    assert "world/none" in answer.json["message"]


def test_long_errors_are_shortened(client: Client) -> None:
    answer = client.call("BatchDescribeSimulationJob", jobs=[f"x{number}" for number in range(100)])

    assert answer.error == "InvalidParameterException"
    assert 1000 < len(answer.json["message"]) <= 4096


BAD_BODIES = {
    "not JSON": b"{",
    "text behind": b"{} x",
    "number": b"1",
    "null": b"null",
    "array": b"[]",
    "text": b'"{}"',
    "spaces": b"  ",
    "not UTF-8": b'{"world": "\xff"}',
    "UTF-16": '{"world": "a"}'.encode("utf-16"),
    "byte order mark": b"\xef\xbb\xbf{}",
    "NaN": b'{"maxResults": NaN}',
    "infinity": b'{"maxResults": -Infinity}',
    "member twice": b'{"maxResults": 1, "maxResults": 2}',
    "member twice inside": b'{"filters": [{"name": "a", "name": "b"}]}',
    "deep": b'{"filters": ' + b"[" * 40 + b"]" * 40 + b"}",
    "very deep": b"[" * 200_000,
    "huge number": b'{"maxResults": ' + b"9" * 100_000 + b"}",
    "half a character": rb'{"nextToken": "\ud800"}',
    "control character": b'{"nextToken": "\x01"}',
}


@pytest.mark.parametrize("body", BAD_BODIES.values(), ids=BAD_BODIES)
def test_bodies_that_cannot_be_read(body: bytes, client: Client) -> None:
    answer = client.send("POST", "/listWorlds", body)

    assert (answer.status, answer.error) == (400, "SerializationException")
    assert answer.json["message"].startswith("the body")


@pytest.mark.parametrize("number", ["1e400", "9" * 400, "1.0", "-1", "0", "101"])
def test_numbers_that_are_no_page_size(number: str, client: Client) -> None:
    answer = client.send("POST", "/listWorlds", f'{{"maxResults": {number}}}'.encode())

    assert (answer.status, answer.error) == (400, "InvalidParameterException")
    assert "maxResults" in answer.json["message"]


@pytest.mark.parametrize(
    "content_type", [None, JSON, "application/json; charset=utf-8", "APPLICATION/JSON", "application/x-amz-json-1.1"]
)
def test_content_types_of_sdks(content_type: str | None, client: Client) -> None:
    assert client.send("POST", "/listWorlds", b"{}", {"content-type": content_type or ""}).status == 200


@pytest.mark.parametrize(
    "content_type", ["text/plain", "application/x-www-form-urlencoded", "multipart/form-data; boundary=a", "x", "a/b/c"]
)
def test_content_types_of_forms_and_others(content_type: str, client: Client) -> None:
    answer = client.send("POST", "/listWorlds", b"{}", {"content-type": content_type})

    assert (answer.status, answer.error) == (415, "UnsupportedMediaTypeException")


def test_bodies_over_the_limit(client: Client) -> None:
    declared = client.send("POST", "/listWorlds", b"", {"content-length": str(MAX_BODY_BYTES + 1)})
    absurd = client.send("POST", "/listWorlds", b"", {"content-length": "9" * 5000})
    unannounced = client.send("POST", "/listWorlds", [b" " * 1_000_000] * 11)
    at_the_limit = client.send("POST", "/listWorlds", b"{}".ljust(MAX_BODY_BYTES))

    for answer in (declared, absurd, unannounced):
        assert (answer.status, answer.error) == (413, "RequestEntityTooLargeException")
    assert at_the_limit.status == 200


def test_a_batch_of_a_thousand_requests_fits(client: Client, service: Service) -> None:
    job = {
        "maxJobDurationInSeconds": 60,
        "iamRole": "arn:aws:iam::000000000000:role/test",
        "robotApplications": [
            {
                "application": "scout",
                "launchConfig": {"environmentVariables": {f"NAME_{n}": "x" * 100 for n in range(20)}},
            }
        ],
        "simulationApplications": [{"application": "indoor-navigation", "launchConfig": {}}],
    }
    answer = client.call("StartSimulationJobBatch", createSimulationJobRequests=[job] * 1000)

    assert answer.status == 200, answer
    assert answer.json["arn"].startswith("arn:aws:robomaker:us-east-1:000000000000:simulation-job-batch/")


def test_jobs_that_were_stored_are_told(client: Client, submitted: list[str], template: str) -> None:
    request = {"template": template, "worldCount": {"floorplanCount": 1, "interiorCountPerFloorplan": 1}}
    job = client.call("CreateWorldGenerationJob", **request).json["arn"]
    client.call("DescribeWorldGenerationJob", job=job)
    client.call("CreateWorldGenerationJob", **{**request, "template": f"{template}x"})

    assert submitted == [job]


def test_a_job_is_answered_when_the_worker_cannot_be_told(
    service: Service, template: str, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(arn: str) -> None:
        raise RuntimeError("there is no listener")

    client = Client(Endpoint(service, on_submitted=broken))
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}
    answer = client.call("CreateWorldGenerationJob", template=template, worldCount=count)
    client.close()

    assert service.catalog.get(answer.json["arn"]).status == "Pending"
    assert "there is no listener" in caplog.text


def test_unknown_operations_and_methods(client: Client) -> None:
    unknown, method = client.send("POST", "/makeCoffee", b"{}"), client.send("GET", "/listWorlds")

    assert (unknown.status, unknown.error) == (404, "UnknownOperationException")
    assert (method.status, method.error) == (405, "UnknownOperationException")
    assert method.headers["allow"] == "POST"


class TestTags:
    def test_tags_travel_in_path_query_and_body(self, client: Client, service: Service, template: str) -> None:
        path = f"/tags/{quote(template, safe='')}"
        tags = {"a b": "1", "c:d": "2", "e+f": "3", "g/h=": ""}

        assert client.send("POST", path, json.dumps({"tags": tags}).encode()).json == {}
        assert client.send("GET", path, b"", {"content-type": ""}).json == {"tags": tags}

        query = urlencode([("tagKeys", "a b"), ("tagKeys", "e+f"), ("x-id", "UntagResource")], quote_via=quote)
        assert client.send("DELETE", f"{path}?{query}").json == {}
        assert service.catalog.get(template).tags == {"c:d": "2", "g/h=": ""}

    def test_one_key_is_a_list_too(self, client: Client, template: str) -> None:
        answer = client.send("DELETE", f"/tags/{quote(template, safe='')}?tagKeys=only")

        assert answer.status == 200

    def test_keys_have_to_be_there(self, client: Client, template: str) -> None:
        answer = client.send("DELETE", f"/tags/{quote(template, safe='')}")

        assert answer.error == "InvalidParameterException"
        assert "tagKeys" in answer.json["message"]

    def test_members_of_the_path_are_not_taken_from_the_body(self, client: Client, template: str) -> None:
        body = {"resourceArn": "arn:aws:other", "tags": {"a": "b"}}
        answer = client.send("POST", f"/tags/{quote(template, safe='')}", json.dumps(body).encode())

        assert answer.error == "InvalidParameterException"
        assert "resourceArn belongs into the path" in answer.json["message"]

    @pytest.mark.parametrize("query", ["tagKeys=%FF", "&".join(["tagKeys=a"] * 1001)], ids=["not UTF-8", "too many"])
    def test_queries_that_cannot_be_read(self, query: str, client: Client, template: str) -> None:
        answer = client.send("DELETE", f"/tags/{quote(template, safe='')}?{query}")

        assert (answer.status, answer.error) == (400, "SerializationException")


class TestFailures:
    @pytest.mark.parametrize(
        ("operation", "members", "status", "error"),
        [
            ("ListWorlds", {}, 500, "InternalServerException"),
            (
                "CreateWorldExportJob",
                {
                    "worlds": ["arn:aws:robomaker:us-east-1:000000000000:world/none"],
                    "outputLocation": {"s3Bucket": "results"},
                    "iamRole": "arn:aws:iam::000000000000:role/test",
                },
                503,
                "ServiceUnavailableException",
            ),
        ],
    )
    def test_a_catalog_that_does_not_answer(
        self,
        client: Client,
        service: Service,
        caplog: pytest.LogCaptureFixture,
        operation: str,
        members: dict[str, Any],
        status: int,
        error: str,
    ) -> None:
        with sqlite3.connect(service.settings.home / "catalog.db") as connection:
            connection.execute("DROP TABLE resources")
        connection.close()
        answer = client.call(operation, **members)

        assert (answer.status, answer.error) == (status, error)
        assert str(service.settings.home) not in answer.json["message"]
        assert answer.headers["x-amzn-requestid"] in answer.json["message"]
        assert answer.headers["x-amzn-requestid"] in caplog.text
        assert "no such table" in caplog.text

    def test_places_on_this_machine_are_not_told(self, client: Client, service: Service) -> None:
        location = {"s3Bucket": "nowhere", "s3Key": "body.json"}
        answer = client.call("CreateWorldTemplate", name="a", templateLocation=location)

        assert (answer.status, answer.error) == (400, "InvalidParameterException")
        assert "nowhere" in answer.json["message"]
        assert str(service.settings.home) not in answer.json["message"]

    @pytest.mark.parametrize("store", ["aws", "http://127.0.0.1:9000", "/data/objects", "objects"])
    def test_only_places_on_this_machine_are_left_out_of_messages(self, store: str) -> None:
        settings = Settings.from_environment({"ROBOMAKER_HOME": "/data", "ROBOMAKER_OBJECT_STORE": store})
        words = "arn:aws:robomaker:us-east-1:1:world/objects at s3://bucket/data/objects and s3://b/x/data-1/"

        answer = Failures(settings).answer(ResourceNotFoundException(words), None, "id")

        assert json.loads(bytes(answer.body))["message"] == words

    @pytest.mark.parametrize(
        ("store", "place", "shown"),
        [
            ("/data/objects", "no bucket b in /data/objects", "no bucket b in the object store"),
            ("/data/objects/", "read file:///data/objects/b/c", "read file://the object store/b/c"),
            ("objects", f"no bucket b in {Path.cwd()}/objects.", "no bucket b in the object store."),
            ("http://127.0.0.1:9000/", "http://127.0.0.1:9000/b/k fails", "the object store/b/k fails"),
            ("aws", "the file '/data/jobs/x' is gone", "the file '$ROBOMAKER_HOME/jobs/x' is gone"),
        ],
    )
    def test_places_on_this_machine_have_names(self, store: str, place: str, shown: str) -> None:
        settings = Settings.from_environment({"ROBOMAKER_HOME": "/data", "ROBOMAKER_OBJECT_STORE": store})

        answer = Failures(settings).answer(ResourceNotFoundException(place), None, "id")

        assert json.loads(bytes(answer.body))["message"] == shown

    def test_defects_are_told_to_the_log_only(self, service: Service, caplog: pytest.LogCaptureFixture) -> None:
        def broken() -> dict[str, object]:
            raise ZeroDivisionError("a secret of this machine")

        client = Client(Endpoint(service, worker_status=broken))
        with caplog.at_level(logging.ERROR):
            answer = client.send("GET", "/health")
        client.close()

        assert (answer.status, answer.error) == (500, "InternalServerException")
        assert not re.search("secret|Traceback|Zero|test_wire", answer.body.decode())
        assert "ZeroDivisionError: a secret of this machine" in caplog.text
        assert answer.headers["x-amzn-requestid"] in caplog.text


class Crowd:
    """Requests that are all under way at once."""

    def __init__(self, client: Client) -> None:
        self._application = client.application
        self._gone = asyncio.Event()
        self.waiting: list[asyncio.Task[list[dict[str, Any]]]] = []

    async def come(self, number: int, **headers: str) -> None:
        """Sends the beginning of some requests, whose bodies do not come."""
        self.waiting += [asyncio.create_task(self.ask(self._slow, "/listWorlds", headers)) for _ in range(number)]
        await asyncio.sleep(0)

    async def leave(self) -> list[list[dict[str, Any]]]:
        """Hangs up; returns what each was sent."""
        self._gone.set()
        return await asyncio.gather(*self.waiting)

    async def _slow(self) -> dict[str, Any]:
        await self._gone.wait()
        return {"type": "http.disconnect"}

    async def quick(self) -> dict[str, Any]:
        return {"type": "http.request", "body": b""}

    async def ask(self, receive: Any, path: str, headers: dict[str, str]) -> list[dict[str, Any]]:
        sent: list[dict[str, Any]] = []
        given = {"host": "localhost", **{name.replace("_", "-"): value for name, value in headers.items()}}
        scope = {
            "type": "http",
            "method": "POST" if path == "/listWorlds" else "GET",
            "raw_path": path.encode(),
            "query_string": b"",
            "headers": [(name.encode(), value.encode()) for name, value in given.items()],
        }

        async def send(message: dict[str, Any]) -> None:
            sent.append(message)

        await self._application(scope, receive, send)
        return sent

    async def status(self, path: str = "/listWorlds", **headers: str) -> tuple[int, bytes]:
        """How a quick request fares: status and kind of error."""
        [start, *_] = await self.ask(self.quick, path, headers)
        answered = dict(start["headers"])
        assert (b"retry-after" in answered) == (answered.get(b"x-amzn-errortype") == b"ThrottlingException")
        return start["status"], answered.get(b"x-amzn-errortype", b"")


@pytest.mark.parametrize(
    ("number", "headers", "others"),
    [
        (SMALL_BODIES, {"content_length": "2"}, (400, b"ThrottlingException")),
        (SMALL_BODIES - 1, {"content_length": "2"}, (200, b"")),
        (LARGE_BODIES, {"content_length": "9000000"}, (200, b"")),
        (LARGE_BODIES, {"transfer_encoding": "chunked"}, (200, b"")),
    ],
)
def test_slow_senders_of_large_bodies_do_not_block_others(
    client: Client, number: int, headers: dict[str, str], others: tuple[int, bytes]
) -> None:
    async def meet() -> tuple[tuple[int, bytes], tuple[int, bytes], tuple[int, bytes]]:
        crowd = Crowd(client)
        await crowd.come(number, **headers)
        of_others, of_same = await crowd.status(), await crowd.status(**headers)
        assert await crowd.leave() == [[]] * number
        return of_others, of_same, await crowd.status(**headers)

    of_others, of_same, afterwards = asyncio.run(meet())

    assert of_others == others
    assert of_same == ((200, b"") if number == SMALL_BODIES - 1 else (400, b"ThrottlingException"))
    assert afterwards == (200, b"")


def test_too_many_whole_requests_at_once_are_asked_to_come_again(service: Service) -> None:
    free = threading.Event()
    application = Endpoint(service, worker_status=lambda: {"waited": free.wait(200)})
    client = Client(application)

    async def meet() -> tuple[tuple[int, bytes], list[int]]:
        crowd = Crowd(client)
        asked = [asyncio.create_task(crowd.status("/health")) for _ in range(MAX_IN_PROGRESS)]
        for _ in range(20):  # rounds of the loop, so that all are in progress however slow the machine is
            await asyncio.sleep(0)
        refused = await crowd.status("/health")
        free.set()
        return refused, [status for status, _ in await asyncio.gather(*asked)]

    refused, served = asyncio.run(meet())
    client.close()

    assert refused == (400, b"ThrottlingException")
    assert served == [200] * MAX_IN_PROGRESS
