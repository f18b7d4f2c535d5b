"""Server-sent events: streams changed parts of a page to browsers that show it."""

import asyncio
import json
import logging
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from contextlib import asynccontextmanager
from typing import Any

from starlette.responses import PlainTextResponse, StreamingResponse
from starlette.types import Receive, Scope, Send

from ...schemas.wire.errors import RobomakerError

LOGGER = logging.getLogger("robomaker.endpoint")

MOST_STREAMS = 64
"""Limit of console pages that are followed live at once."""

_SIGN_OF_LIFE_S = 15.0

Look = Callable[[], Iterator[tuple[str, Any]]]
"""Function that returns new events: name and JSON data; the event `end` is the last one."""


class Streams:
    """Live update streams from a server to browsers."""

    def __init__(self) -> None:
        self._open = 0
        self._ended = asyncio.Event()

    def end(self) -> None:
        """Ends all live update streams, so that the server can stop."""
        self._ended.set()

    def follow(self, look: Look, every_s: float) -> StreamingResponse:
        """Makes the HTTP response that streams changes to the browser (server-sent events).

        Args:
            look: Polled for changes, in a thread of its own.
            every_s: Seconds between two polls.
        """
        headers = {"cache-control": "no-store", "x-accel-buffering": "no"}
        return _Stream(self, self._events(look, every_s), headers)

    @asynccontextmanager
    async def admitted(self) -> AsyncIterator[bool]:
        """Counts a stream while it is open; yields whether there is room for it."""
        has_room = self._open < MOST_STREAMS
        self._open += has_room
        try:
            yield has_room
        finally:
            self._open -= has_room

    async def _events(self, look: Look, every_s: float) -> AsyncIterator[bytes]:
        silent_s = 0.0
        yield b"retry: 2000\n\n"
        while not self._ended.is_set():
            news = await asyncio.to_thread(_looked, look)
            if news is None:
                return
            for name, data in news:
                yield event(name, data)
                if name == "end":
                    return
            silent_s = 0.0 if news else silent_s + every_s
            if silent_s >= _SIGN_OF_LIFE_S:
                silent_s = 0.0
                yield b":\n\n"
            await self._pause(every_s)

    async def _pause(self, seconds: float) -> None:
        try:
            await asyncio.wait_for(self._ended.wait(), seconds)
        except TimeoutError:
            return


class _Stream(StreamingResponse):
    """Response that sends events, if not too many pages are followed already; streams are counted in the event loop."""

    def __init__(self, streams: Streams, events: AsyncIterator[bytes], headers: Mapping[str, str]) -> None:
        super().__init__(events, media_type="text/event-stream", headers=headers)
        self._streams = streams

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Sends the response to the browser (ASGI), or status 503 if too many pages are followed already."""
        async with self._streams.admitted() as has_room:
            if has_room:
                await super().__call__(scope, receive, send)
            else:
                words = f"{MOST_STREAMS} pages are followed already; close some\n"
                await PlainTextResponse(words, 503)(scope, receive, send)


def _looked(look: Look) -> list[tuple[str, Any]] | None:
    """Polls for events; `None` if that fails: the stream ends, and the browser reconnects, or shows the reason."""
    try:
        return list(look())
    except RobomakerError as error:
        LOGGER.warning("a page of the console cannot be followed: %s", error)
    except Exception:
        LOGGER.exception("a page of the console cannot be followed")
    return None


def event(name: str, data: Any) -> bytes:
    """Formats a server-sent event, with its data as JSON: `event: part`, `data: ...` and an empty line."""
    return f"event: {name}\ndata: {json.dumps(data)}\n\n".encode()


class Parts:
    """Detects which parts of a web page (by element id) changed since they were last sent."""

    def __init__(self) -> None:
        self._sent: dict[str, str] = {}

    def news(self, parts: Mapping[str, str]) -> Iterator[tuple[str, Any]]:
        """Yields an event `parts` with the HTML of the page parts that changed since the last call; else nothing."""
        changed = {name: html for name, html in parts.items() if self._sent.get(name) != html}
        self._sent.update(changed)
        if changed:
            yield "parts", changed
