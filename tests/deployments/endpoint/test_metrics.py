"""What a Prometheus server reads of the endpoint, parsed with Prometheus' own parser."""

import base64
from collections.abc import Iterator

import pytest
from helpers.asgi import Client
from prometheus_client.parser import text_string_to_metric_families

from prefect_robomaker.deployments.endpoint.application import Endpoint
from prefect_robomaker.deployments.endpoint.calling.access_keys import AccessKey
from prefect_robomaker.tasks.service.service import Service

Samples = dict[tuple[str, tuple[tuple[str, str], ...]], float]
KEY = AccessKey("AKIDEXAMPLE", "secret:with colon", scope="read")
CONFINED = AccessKey("AKIDCONFINED", "secret", names=("night-",))
WORLD_TEMPLATES = ("robomaker_resources", (("kind", "world-template"), ("status", "Active")))


def read(client: Client, **headers: str) -> Samples:
    answer = client.send("GET", "/metrics", b"", headers)
    assert (answer.status, answer.headers["content-type"].split(";")[0]) == (200, "text/plain")
    families = text_string_to_metric_families(answer.body.decode())
    return {(each.name, tuple(sorted(each.labels.items()))): each.value for of in families for each in of.samples}


def requests_of(samples: Samples) -> dict[tuple[str, str], float]:
    return {
        (dict(labels)["operation"], dict(labels)["status"]): value
        for (name, labels), value in samples.items()
        if name == "robomaker_http_requests_total"
    }


def test_requests_are_counted_by_operation_and_status(client: Client) -> None:
    client.send("POST", "/listWorlds", b"{}")
    client.send("POST", "/describeWorld", b'{"world": "arn:aws:robomaker:us-east-1:000000000000:world/none"}')
    for chosen in ("/a", "/b", "/c"):
        client.send("GET", chosen)

    samples = read(client)

    assert requests_of(samples) == {("ListWorlds", "200"): 1, ("DescribeWorld", "400"): 1, ("none", "404"): 3}
    assert samples["robomaker_http_request_duration_seconds_count", (("operation", "ListWorlds"),)] == 1
    assert requests_of(read(client))["none", "200"] == 1, "the first look at the metrics"


def test_resources_are_counted_as_the_catalog_holds_them(client: Client, template: str) -> None:
    assert read(client)[WORLD_TEMPLATES] == 1
    client.send("POST", "/deleteWorldTemplate", f'{{"template": "{template}"}}'.encode())
    assert WORLD_TEMPLATES not in read(client)


@pytest.mark.parametrize(("state", "ready"), [("ready", 1.0), ("waiting for Prefect", 0.0)])
def test_a_job_worker_that_waits_is_seen(service: Service, state: str, ready: float) -> None:
    client = Client(Endpoint(service, worker_status=lambda: {"state": state, "restarts": 2}))
    samples = read(client)
    client.close()

    assert samples["robomaker_job_worker_ready", ()] == ready
    assert samples["robomaker_job_worker_restarts_total", ()] == 2


@pytest.fixture
def guarded(service: Service) -> Iterator[Client]:
    client = Client(Endpoint(service, access_keys={key.id: key for key in (KEY, CONFINED)}))
    yield client
    client.close()


def basic(user: str, password: str) -> str:
    return "Basic " + base64.b64encode(f"{user}:{password}".encode()).decode()


def test_with_access_keys_they_are_read_with_one(guarded: Client) -> None:
    assert read(guarded, authorization=basic("AKIDEXAMPLE", "secret:with colon"))


@pytest.mark.parametrize(
    "authorization",
    [
        "",
        "Basic",
        "Basic !",
        "Basic /w==",
        basic("AKIDEXAMPLE", "secret"),
        basic("other", "secret:with colon"),
        basic("other", ""),
        basic("AKIDCONFINED", "secret"),
        basic("AKIDEXAMPLE", "secret:with colon").replace("Basic", "Bearer"),
    ],
)
def test_without_one_they_are_not_read(guarded: Client, authorization: str) -> None:
    answer = guarded.send("GET", "/metrics", b"", {"authorization": authorization})

    assert (answer.status, answer.headers["www-authenticate"]) == (401, 'Basic realm="robomaker metrics"')
    assert b"robomaker_" not in answer.body


def test_metrics_are_only_read(client: Client) -> None:
    assert client.send("POST", "/metrics", b"{}").status == 405
