"""Makes all requests of Prefect's client wait together while its server is away.

Prefect's client tries a request again for a minute, and each after the other; its events try ten times. Inside
`patient_requests` all of them share the patience of one `Outage`. It acts on httpx's transports, below the client's own
tries, which so see a server that answers, or an error that they do not try again.
"""

import threading
from collections.abc import Awaitable, Callable, Generator
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import Any
from urllib.parse import urlsplit

import anyio
import httpx
from prefect.events.clients import PrefectEventsClient

from ...schemas.wire.errors import RobomakerError
from .outage import Outage

_LOGS = "/logs"
_TOKEN = "/csrf-token"  # noqa: S105 - a path
"""URL path of the CSRF token, requested before the first change that a client makes, and when it has expired."""

_SHOWN = ("/artifacts", _LOGS, "/concurrency_limits", "/v2/concurrency_limits")
"""Paths of requests that do not wait for an absent server: they only inform, or are repeated anyway."""

_SHOWN_TIMEOUT_S = 15.0
_LOOK_S = 0.25

_Send = Callable[[httpx.HTTPTransport, httpx.Request], httpx.Response]
_SendAsync = Callable[[httpx.AsyncHTTPTransport, httpx.Request], Awaitable[httpx.Response]]


class PrefectServerAwayError(httpx.NetworkError, RobomakerError):
    """Raised when the Prefect server is away and waiting is over; Prefect's client does not retry it."""


@contextmanager
def patient_requests(outage: Outage, api_url: str) -> Generator[None]:
    """Makes all of Prefect's requests and events wait during an outage, inside the `with` block.

    Args:
        outage: State of the server's outage.
        api_url: URL of its API; requests to others are left alone.
    """
    patience = _Patience(outage, api_url)
    with (
        _replaced(httpx.HTTPTransport, "handle_request", patience.send),
        _replaced(httpx.AsyncHTTPTransport, "handle_async_request", patience.send_async),
        _replaced(PrefectEventsClient, "emit", patience.emit),
        outage.watched(),
    ):
        yield


@contextmanager
def _replaced(owner: type, name: str, replacement: Callable[..., Any]) -> Generator[None]:
    """Replaces a class's method in the block; the replacement is called with the former method and its arguments."""
    method = getattr(owner, name)
    setattr(owner, name, lambda *arguments: replacement(method, *arguments))
    try:
        yield
    finally:
        setattr(owner, name, method)


class _Patience:
    """Sends requests to one Prefect server, and repeats those that must arrive after an outage."""

    def __init__(self, outage: Outage, api_url: str) -> None:
        self._outage = outage
        self._server = urlsplit(api_url)

    def send(self, send: _Send, transport: httpx.HTTPTransport, request: httpx.Request) -> httpx.Response:
        """Sends a request to the Prefect server, and again after an outage; requests to other hosts are sent once.

        Raises PrefectServerAwayError if the server does not answer and the request does not wait for it (any longer).
        """
        outage = self._outage
        if not self._is_ours(request):
            return send(transport, request)
        waits = _waits(request, self._server.path)
        while not outage.is_on or (waits and outage.wait()):
            with outage.asking() as began:
                try:
                    return send(transport, request)
                except httpx.TransportError:
                    if not outage.look(began):
                        raise  # what went wrong is over, and Prefect's client tries again
        raise PrefectServerAwayError(self._outage.in_words, request=request)

    async def send_async(
        self, send: _SendAsync, transport: httpx.AsyncHTTPTransport, request: httpx.Request
    ) -> httpx.Response:
        """Sends a background request to the Prefect server, and again after an outage of it.

        While the server is away, logs are dropped and answered as if they were stored, and a request for a token gets
        none; other requests raise PrefectServerAwayError.
        """
        if not self._is_ours(request):
            return await send(transport, request)
        while await self._answers():
            with self._outage.asking() as began:
                try:
                    return await send(transport, request)
                except httpx.TransportError:
                    if not await anyio.to_thread.run_sync(self._outage.look, began):
                        raise
        path = request.url.path.removeprefix(self._server.path)
        if path.startswith(_LOGS):
            return httpx.Response(201)  # dropped like events: Prefect would print each line that it cannot send
        if path.startswith(_TOKEN):
            return httpx.Response(200, json=_no_token())  # what asks for it fails in its turn, or is dropped
        raise PrefectServerAwayError(self._outage.in_words, request=request)

    async def emit(self, emit: Callable[..., Awaitable[None]], client: PrefectEventsClient, event: Any) -> None:
        """Sends a Prefect event; drops it while the Prefect server is away."""
        if not await self._answers():
            return
        async with anyio.create_task_group() as tasks:

            async def give_up() -> None:
                while not self._outage.is_on or self._outage.is_waited_for:
                    await anyio.sleep(_LOOK_S)
                tasks.cancel_scope.cancel()

            tasks.start_soon(give_up)
            await emit(client, event)
            tasks.cancel_scope.cancel()

    async def _answers(self) -> bool:
        """Waits until the Prefect server answers or the waiting time is over; returns whether it answers."""
        while self._outage.is_waited_for:
            await anyio.sleep(_LOOK_S)
        return not self._outage.is_on

    def _is_ours(self, request: httpx.Request) -> bool:
        return (request.url.host, request.url.port) == (self._server.hostname, self._server.port)


def _no_token() -> dict[str, str]:
    """Returns a CSRF token that expires at once, so that the client requests one when the server is back."""
    return {"token": "", "client": "", "expiration": datetime.now(UTC).isoformat()}


def _waits(request: httpx.Request, root: str) -> bool:
    """Whether a request waits for the server: those of the main thread that begin and end flow runs.

    A request that does not wait is also answered soon or never, from its caller's view.
    """
    path = request.url.path.removeprefix(root)
    if threading.current_thread() is threading.main_thread() and not path.startswith(_SHOWN):
        return True
    timeouts = request.extensions.get("timeout", {})
    shortest = min(timeouts.get("read") or _SHOWN_TIMEOUT_S, _SHOWN_TIMEOUT_S)
    request.extensions["timeout"] = {**timeouts, "read": shortest}
    return False
