"""The application around another one: what it refuses never arrives, and answers lose what would let pages in."""

import asyncio
from typing import Any

import pytest

from prefect_robomaker.deployments.foreign_pages import Guard

OWN = (b"host", b"127.0.0.1:4200")
FOREIGN = (b"origin", b"http://evil.example")


async def generous(scope: Any, receive: Any, send: Any) -> None:
    scope["arrived"].append(scope["type"])
    if scope["type"] == "http":
        headers = [(b"Access-Control-Allow-Origin", b"*"), (b"content-security-policy", b"default-src 'none'")]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        await send({"type": "http.response.body", "body": b"secret"})
    elif scope["type"] == "websocket":
        await send({"type": "websocket.accept"})


def ask(kind: str, *headers: tuple[bytes, bytes]) -> tuple[list[str], list[dict[str, Any]]]:
    arrived: list[str] = []
    sent: list[dict[str, Any]] = []

    async def send(message: Any) -> None:
        sent.append(message)

    async def receive() -> Any:
        raise AssertionError("nothing is read")

    scope = {"type": kind, "method": "GET", "headers": list(headers), "arrived": arrived}
    asyncio.run(Guard(generous)(scope, receive, send))
    return arrived, sent


def test_an_answer_lets_no_other_page_read_or_frame_it() -> None:
    arrived, sent = ask("http", OWN)

    assert arrived == ["http"]
    headers = dict(sent[0]["headers"])
    assert not any(name.lower().startswith(b"access-control") for name in headers)
    assert headers[b"x-frame-options"] == b"DENY"
    assert headers[b"content-security-policy"] == b"default-src 'none'", "the application's own stays"


def test_a_refused_request_does_not_arrive() -> None:
    arrived, sent = ask("http", OWN, FOREIGN)

    assert (arrived, sent[0]["status"]) == ([], 403)
    assert b"evil.example" in sent[1]["body"]
    assert not any(name.startswith(b"access-control") for name, _ in sent[0]["headers"])


@pytest.mark.parametrize("headers", [(OWN, FOREIGN), ((b"host", b"evil.example"),)])
def test_a_refused_socket_is_never_accepted(headers: tuple[tuple[bytes, bytes], ...]) -> None:
    arrived, sent = ask("websocket", *headers)

    assert (arrived, [message["type"] for message in sent]) == ([], ["websocket.close"])


def test_sockets_of_programs_and_the_servers_start_pass() -> None:
    assert ask("websocket", OWN) == (["websocket"], [{"type": "websocket.accept"}])
    assert ask("lifespan") == (["lifespan"], [])
