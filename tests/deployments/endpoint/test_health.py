"""The pages for people and watchdogs."""

from html.parser import HTMLParser

import pytest
from helpers.asgi import Client

from prefect_robomaker.deployments.endpoint.application import Endpoint
from prefect_robomaker.deployments.endpoint.calling.access_keys import AccessKey
from prefect_robomaker.tasks.service.service import Service


class Text(HTMLParser):
    """The words of a page and the names of its elements."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.words = ""
        self.elements: set[str] = set()
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.elements.add(tag)

    def handle_data(self, data: str) -> None:
        self.words += data


def test_health_counts_resources(client: Client, template: str) -> None:
    answer = client.send("GET", "/health")

    assert (answer.status, answer.headers["content-type"]) == (200, "application/json")
    assert answer.json["status"] == "ok"
    assert (answer.json["region"], answer.json["account"]) == ("us-east-1", "000000000000")
    assert sum(answer.json["resources"]["world-template"].values()) >= 1
    assert answer.json["performer"] == {}


def test_the_page_says_how_to_reach_the_service(client: Client, template: str) -> None:
    answer = client.send("GET", "/", b"", {"host": "localhost:4711"})
    page = Text(answer.body.decode())

    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    assert "default-src 'none'" in answer.headers["content-security-policy"]
    assert "AWS_ENDPOINT_URL_ROBOMAKER=http://localhost:4711" in page.words
    assert 'endpoint_url="http://localhost:4711", region_name="us-east-1"' in " ".join(page.words.split())
    for said in ("000000000000", "us-east-1", "world-template", "Active"):
        assert said in page.words
    assert "prefers-color-scheme: dark" in answer.body.decode()
    assert not page.elements & {"script", "img", "form", "iframe"}


def test_everything_on_the_page_is_escaped(service: Service) -> None:
    nasty = "<script>alert('x')</script>"
    client = Client(Endpoint(service, access_keys=None, worker_status=lambda: {nasty: nasty}))
    page = Text(client.send("GET", "/").body.decode())
    health = client.send("GET", "/health").json
    client.close()

    assert "script" not in page.elements
    assert page.words.count(nasty) == 2
    assert health["performer"] == {nasty: nasty}


def test_hosts_on_the_page_are_escaped(service: Service) -> None:
    client = Client(Endpoint(service, access_keys={"a": AccessKey("a", "b")}))
    page = Text(client.send("GET", "/", b"", {"host": "x</pre><script>"}).body.decode())
    client.close()

    assert "script" not in page.elements


def test_strangers_learn_only_that_it_works(service: Service, template: str) -> None:
    keys = {"a": AccessKey("a", "b")}
    client = Client(Endpoint(service, access_keys=keys, worker_status=lambda: {"pid": 4711}))
    health, page = client.send("GET", "/health"), client.send("GET", "/")
    client.close()

    assert health.json == {"status": "ok"}
    assert page.status == 200
    for kept in ("4711", "000000000000", "world-template", "us-east-1"):
        assert kept not in page.body.decode()


@pytest.mark.parametrize("path", ["/", "/health"])
def test_pages_are_only_read(path: str, client: Client) -> None:
    head, post = client.send("HEAD", path), client.send("POST", path, b"{}")

    assert (head.status, head.body) == (200, b"")
    assert int(head.headers["content-length"]) > 10
    assert (post.status, post.error, post.headers["allow"]) == (405, "UnknownOperationException", "GET, HEAD")
