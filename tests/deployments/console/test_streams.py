"""How pages are followed: how many at once, what a stream tells when it cannot look any more."""

import asyncio
import logging
from collections.abc import Iterator
from typing import Any

import pytest

from prefect_robomaker.deployments.console import streams
from prefect_robomaker.deployments.console.streams import Streams
from prefect_robomaker.schemas.wire.errors import ServiceUnavailableException

SCOPE = {"type": "http", "method": "GET", "path": "/", "headers": []}


async def sent_by(response: Any) -> tuple[int, bytes]:
    """Status and content of what an answer sends to a browser that stays."""
    messages: list[Any] = []

    async def receive() -> Any:
        await asyncio.Event().wait()

    async def send(message: Any) -> None:
        messages.append(message)

    await response(SCOPE, receive, send)
    return messages[0]["status"], b"".join(each.get("body", b"") for each in messages)


def test_pages_that_begin_at_the_same_moment_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(streams, "MOST_STREAMS", 2)

    async def follow_all() -> list[tuple[int, bytes]]:
        of_server = Streams()
        asked = [of_server.follow(lambda: iter([]), 0.01) for _ in range(5)]  # as threads do, before any is sent
        asyncio.get_running_loop().call_later(0.2, of_server.end)
        return await asyncio.gather(*map(sent_by, asked))

    answers = asyncio.run(follow_all())

    assert [status for status, _ in answers] == [200, 200, 503, 503, 503]
    assert b"2 pages are followed already" in answers[-1][1]


@pytest.mark.parametrize("error", [ServiceUnavailableException("the catalog is away"), ValueError("odd")])
def test_a_look_that_fails_ends_its_stream_and_is_in_the_log(
    error: Exception, caplog: pytest.LogCaptureFixture
) -> None:
    looks = iter([[("parts", {"now": "1"})]])

    def look() -> Iterator[tuple[str, Any]]:
        news = next(looks, None)
        if news is None:
            raise error
        yield from news

    async def follow() -> tuple[int, bytes]:
        return await sent_by(Streams().follow(look, 0.01))

    with caplog.at_level(logging.WARNING, "robomaker.endpoint"):
        status, content = asyncio.run(follow())

    assert (status, b"event: parts" in content, b"event: end" in content) == (200, True, False)
    assert "cannot be followed" in caplog.text
    assert ("Traceback" in caplog.text) == isinstance(error, ValueError)
