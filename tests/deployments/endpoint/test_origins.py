"""Web pages are kept out of a service that checks no signatures."""

import pytest
from helpers.asgi import Client

from prefect_robomaker.deployments.endpoint.origins import is_local_host, is_loopback

TARGETS = [("POST", "/listWorlds"), ("GET", "/"), ("GET", "/health"), ("OPTIONS", "/listWorlds"), ("GET", "/tags/a")]


@pytest.mark.parametrize(
    "host",
    [
        "localhost",
        "localhost:8080",
        "LOCALHOST",
        "localhost.",
        "127.0.0.1:8080",
        "10.1.2.3",
        "[::1]:80",
        "robomaker:80",
    ],
)
def test_hosts_that_no_web_site_can_have(host: str, client: Client) -> None:
    assert is_local_host(host)
    assert client.send("POST", "/listWorlds", b"{}", {"host": host}).status == 200


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "evil.example:8080",
        "127.0.0.1.evil.example",
        "localhost.evil.example",
        "evil.example.",
        "127.0.0.1@evil.example",
        "localhost:80:80",
        "localhost:x",
        "[::1",
        ":80",
        "\xe9vil.example",
        "[evil.example]",
        "a b",
    ],
)
def test_hosts_that_a_web_site_can_have(host: str, client: Client) -> None:
    for method, path in TARGETS:
        answer = client.send(method, path, b"", {"host": host})

        assert (answer.status, answer.error) == (403, "AccessDeniedException"), path
        assert "access keys" in answer.json["message"], path


def test_one_host_is_needed(client: Client) -> None:
    for headers in ([], [(b"host", b"localhost"), (b"host", b"localhost")]):
        assert client.send("POST", "/listWorlds", b"", headers).status == 403


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://localhost:8080", "\xe9"])
def test_requests_of_web_pages(origin: str, client: Client) -> None:
    for method, path in TARGETS:
        answer = client.send(method, path, b"", {"origin": origin})

        assert (answer.status, answer.error) == (403, "AccessDeniedException"), path
        assert not any(name.startswith("access-control") for name in answer.headers), path


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
@pytest.mark.parametrize("dest", ["image", "iframe", "empty"])
def test_what_pages_of_other_sites_embed(site: str, dest: str, client: Client) -> None:
    headers = {"sec-fetch-site": site, "sec-fetch-mode": "no-cors", "sec-fetch-dest": dest}
    for method, path in TARGETS:
        answer = client.send(method, path, b"", headers)

        assert (answer.status, answer.error) == (403, "AccessDeniedException"), path


def test_a_link_of_another_site_leads_to_the_page(client: Client) -> None:
    headers = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate", "sec-fetch-dest": "document"}

    assert client.send("GET", "/", b"", headers).status == 200
    assert client.send("POST", "/listWorlds", b"{}", headers).status == 403


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        ("localhost", True),
        ("127.0.0.2", True),
        ("::1", True),
        ("[::1]", True),
        ("0.0.0.0", False),
        ("::", False),
        ("robomaker", False),
        ("192.168.1.1", False),
        ("", False),
    ],
)
def test_loopback(host: str, expected: bool) -> None:
    assert is_loopback(host) == expected
