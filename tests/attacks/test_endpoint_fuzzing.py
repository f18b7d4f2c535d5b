"""Anything at all, sent to the endpoint: it answers with the service's own errors, and a refusal changes nothing."""

import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlencode

import pytest
from helpers.asgi import Answer, Client
from helpers.examples import examples
from helpers.fleet_calls import Fleets
from helpers.paths import REPOSITORY
from helpers.request_strategies import WILD, broken, requests, spoilt
from helpers.small_flat import BODY, ROLE
from hypothesis import HealthCheck, Phase, event, find, given
from hypothesis import strategies as st
from hypothesis.errors import NoSuchExample

from prefect_robomaker.deployments.endpoint.application import Endpoint
from prefect_robomaker.deployments.endpoint.calling.access_keys import AccessKey
from prefect_robomaker.deployments.endpoint.protocol_errors import ProtocolError
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.wire.operation_shape import OperationShape
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.service.service import Service

HEALTH_CHECKS: list[Any] = list(HealthCheck)  # its metaclass hides from type checkers what it lists
ARN = "arn:aws:robomaker:us-east-1:000000000000"


def protocol_errors() -> set[str]:
    """Names of the errors that are not of an operation."""
    return {each.__name__ for each in ProtocolError.__subclasses__()}


@dataclass(repr=False, eq=False)
class Target:
    """An endpoint, and values that mean something to it."""

    service: Service
    client: Client
    guarded: Client
    """A client of an endpoint that wants signatures."""
    catalog: sqlite3.Connection
    """Only reads."""

    known: dict[str, list[str]] = field(default_factory=dict)
    _dumped: tuple[int, list[str]] | None = None
    """Everything in the catalog, and SQLite's number of when it was read; that changes with every commit."""

    @cache  # noqa: B019 - one target lives as long as its module's tests
    def requests_of(self, name: str) -> st.SearchStrategy[dict[str, Any]]:
        """Requests that an operation's model allows."""
        return requests(registry()[name].shape.request, self.known)

    def dump(self) -> list[str]:
        """Everything in the catalog, but who held a resource last: a call that is refused may hold a fleet."""
        [version] = self.catalog.execute("PRAGMA data_version").fetchone()
        if self._dumped is None or self._dumped[0] != version:
            with closing(sqlite3.connect(":memory:")) as copy:
                self.catalog.backup(copy)
                copy.execute("UPDATE resources SET last_owner = NULL, owner_since = NULL")
                self._dumped = version, list(copy.iterdump())
        return self._dumped[1]


@contextmanager
def opened(home: Path) -> Iterator[Target]:
    """An endpoint with one resource of each kind."""
    service = Service.open(Settings.from_environment({"ROBOMAKER_HOME": str(home)}), {})
    client = Client(Endpoint(service, on_submitted=lambda arn: None))
    template = call("CreateWorldTemplate", {"name": "flat", "templateBody": json.dumps(BODY)}, service)["arn"]
    count = {"floorplanCount": 1, "interiorCountPerFloorplan": 1}
    job = {
        "maxJobDurationInSeconds": 60,
        "iamRole": ROLE,
        "robotApplications": [{"application": "scout", "launchConfig": {}}],
        "simulationApplications": [{"application": "indoor-navigation", "launchConfig": {}}],
    }
    robot = {"name": "mine", "robotSoftwareSuite": {"name": "General"}, "environment": {"uri": "python://a.b"}}
    simulation = {
        "name": "arena",
        "robotSoftwareSuite": {"name": "General"},
        "simulationSoftwareSuite": {"name": "SimulationRuntime"},
        "environment": {"uri": "python://a.b"},
    }
    generation = call("CreateWorldGenerationJob", {"template": template, "worldCount": count}, service)["arn"]
    run = call("CreateSimulationJob", job, service)["arn"]
    batch = call("StartSimulationJobBatch", {"createSimulationJobRequests": [job]}, service)["arn"]
    jobs = [generation, run, batch]
    applications = [
        call("CreateRobotApplication", robot, service)["arn"],
        call("CreateSimulationApplication", simulation, service)["arn"],
        "scout",
        "indoor-navigation",
    ]
    fleets = Fleets(service)
    fleet, rover = fleets.fleet(), fleets.robot()
    world = f"{ARN}:world/generation-0/world-1"
    known = {
        "iamRole": [ROLE],
        "templateBody": [json.dumps(BODY)],
        "uri": ["python://a.b"],
        "currentRevisionId": [""],
        "tagKeys": ["a"],
        "application": applications,
        "applications": applications,
        "job": jobs,
        "jobs": jobs,
        "robot": [rover],
        "robots": [rover],
        "world": [world],
        "worlds": [world],
        "batch": [batch],
        "fleet": [fleet],
        "generationJob": [generation],
        "resourceArn": [template, *jobs, fleet, rover, world, *applications],
        "template": [template],
    }
    guarded = Client(Endpoint(service, access_keys={"known": AccessKey("known", "secret")}))
    catalog = sqlite3.connect(home / "catalog.db", isolation_level=None)
    yield Target(service, client, guarded, catalog, known)
    catalog.close()
    client.close()
    guarded.close()


@pytest.fixture(scope="module")
def target(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Target]:
    """One for all requests; what some of them create does no harm to the others."""
    with opened(tmp_path_factory.mktemp("fuzzed") / "home") as one:
        yield one


@pytest.fixture
def fresh_target(tmp_path: Path) -> Iterator[Target]:
    """One that no request has changed: other tests delete what a request that succeeds would name."""
    with opened(tmp_path / "home") as one:
        yield one


@st.composite
def messages(draw: st.DrawFn, operation: OperationShape, request: dict[str, Any]) -> tuple[str, bytes]:
    """A request as target and body: members where they belong, now and then where they do not."""
    path, query, body = operation.path, [], dict(request)
    for name, location in operation.locations.items():
        if name not in body or draw(st.integers(0, 9)) == 0:
            continue
        value = body.pop(name)
        if location == "uri":
            text = value if isinstance(value, str) else json.dumps(value)
            path = path.replace(f"{{{name}}}", quote(text.encode("utf-8", "surrogatepass"), safe=""))
        else:
            query += [
                (name, str(each).encode("utf-8", "surrogatepass"))
                for each in (value if isinstance(value, list) else [value])
            ]
    return path + (f"?{urlencode(query)}" if query else ""), draw(spoilt(body))


def check(answer: Answer, target: Target, errors: set[str], before: list[str]) -> None:
    """What holds for every answer."""
    text = answer.body.decode()
    assert answer.status < 500, text
    assert len(answer.headers["x-amzn-requestid"]) == 36
    assert "Traceback" not in text
    assert str(target.service.settings.home) not in text
    assert str(REPOSITORY) not in text
    if answer.status == 200:
        is_page = answer.headers["content-type"].startswith("text/html")
        assert is_page or answer.body == b"" or isinstance(answer.json, dict)
        return
    assert answer.error in errors, text
    assert answer.json["message"].strip()
    assert target.dump() == before


@examples(500, suppress_health_check=tuple(HEALTH_CHECKS))
@given(name=st.sampled_from(sorted(registry())), data=st.data())
def test_requests_of_any_operation(name: str, target: Target, data: st.DataObject) -> None:
    shape = registry()[name].shape
    right = data.draw(target.requests_of(name), "request")
    path, body = data.draw(messages(shape, data.draw(broken(right), "broken")), "message")
    before = target.dump()

    answer = target.client.send(shape.method, path, body)

    event(str(answer.status))
    check(answer, target, {each.__name__ for each in shape.errors} | protocol_errors(), before)


@examples(300, suppress_health_check=tuple(HEALTH_CHECKS))
@given(name=st.sampled_from(sorted(registry())), document=WILD, data=st.data())
def test_any_json_for_any_operation(name: str, target: Target, document: Any, data: st.DataObject) -> None:
    shape = registry()[name].shape
    before = target.dump()

    answer = target.client.send(shape.method, shape.path.replace("{resourceArn}", "x"), data.draw(spoilt(document)))

    check(answer, target, {each.__name__ for each in shape.errors} | protocol_errors(), before)


SIGNED = (
    b"AWS4-HMAC-SHA256 Credential=known/20260101/us-east-1/robomaker/aws4_request, SignedHeaders=host;date, Signature="
    + b"0" * 64
)
HEADER_NAMES = st.one_of(
    st.sampled_from(
        [
            "host",
            "origin",
            "content-type",
            "content-length",
            "authorization",
            "x-amz-date",
            "x-amz-content-sha256",
            "x-amz-security-token",
            "transfer-encoding",
            "content-encoding",
            "accept",
            "expect",
            "date",
        ]
    ),
    st.from_regex(r"[!#$%&'*+.^_`|~0-9a-z-]{1,12}", fullmatch=True),
)
HEADER_VALUES = st.one_of(
    st.binary(max_size=30).map(lambda value: value.translate(None, b"\r\n\0")),
    st.sampled_from(
        [
            b"localhost",
            b"application/json",
            b"text/plain",
            b"gzip",
            b"chunked",
            b"-1",
            b"9" * 20,
            b"[::1",
            b"\xff",
            b"20260101T000000Z",
            SIGNED.partition(b",")[0],
            SIGNED,
        ]
    ),
)
PATHS = st.one_of(
    st.sampled_from([entry.shape.path for entry in registry().values()]),
    st.sampled_from(
        ["/", "/health", "/tags/%00", "/tags/%FF", "/tags/%", "/tags/{resourceArn}", "/../", "/%2e%2e/tags/a"]
    ),
    st.from_regex(r"/[!-~]{0,40}", fullmatch=True),
).map(lambda path: path.replace("?", "%3F"))


@pytest.mark.parametrize("which", ["client", "guarded"])
@examples(200, suppress_health_check=tuple(HEALTH_CHECKS))
@given(
    method=st.one_of(
        st.sampled_from(["GET", "POST", "DELETE", "HEAD", "PUT", "OPTIONS"]),
        st.from_regex(r"[A-Z]{1,9}", fullmatch=True),
    ),
    path=PATHS,
    query=st.one_of(st.just(""), st.from_regex(r"\?[!-~]{0,60}", fullmatch=True), st.just("?tagKeys=%FF&tagKeys=%")),
    headers=st.lists(st.tuples(HEADER_NAMES.map(str.encode), HEADER_VALUES), max_size=6),
    host=st.sampled_from([[(b"host", b"localhost")], []]),
    parts=st.lists(st.one_of(st.binary(max_size=30), st.sampled_from([b"{}", b'{"tags": {"a": "b"}}'])), max_size=3),
)
@pytest.mark.deep
def test_any_request_at_all(
    which: str,
    method: str,
    path: str,
    query: str,
    headers: list[tuple[bytes, bytes]],
    host: list[tuple[bytes, bytes]],
    parts: list[bytes],
    target: Target,
) -> None:
    client: Client = getattr(target, which)
    before = target.dump()
    answer = client.send(method, (path + query).encode(), parts, [*host, *headers])

    if method == "HEAD" and answer.status != 200:
        assert answer.body == b""
        assert answer.status < 500
        return
    errors = {each.__name__ for entry in registry().values() for each in entry.shape.errors}
    check(answer, target, errors | protocol_errors(), before)


def succeeds(name: str, target: Target) -> bool:
    """Whether one of some requests made for an operation succeeds."""
    shape = registry()[name].shape
    succeeded: set[tuple[str, bytes]] = set()

    def is_answered(message: tuple[str, bytes]) -> bool:
        if message not in succeeded and target.client.send(shape.method, *message).status == 200:
            succeeded.add(message)  # hypothesis asks again, and a name may be given once
        return message in succeeded

    few = examples(40, derandomize=True, suppress_health_check=tuple(HEALTH_CHECKS), phases=[Phase.generate])
    with suppress(NoSuchExample):
        find(target.requests_of(name).flatmap(partial(messages, shape)), is_answered, settings=few)
    return bool(succeeded)


@pytest.mark.slow
@pytest.mark.deep
def test_most_operations_are_reached_beyond_their_checks(fresh_target: Target) -> None:
    """The strategies make requests that succeed; otherwise they would try the validation only."""
    failed = {name for name in registry() if not succeeds(name, fresh_target)}

    assert len(failed) < 0.5 * len(registry()), failed
