"""Requests of Prefect's client that wait for a server that is away in one place, and not each for itself.

Prefect's client tries a request again for a minute, and each after the other; its events try ten times. Inside
`patient_requests` all of them share the patience of one `Outage`. It acts on httpx's transports, below the client's own
tries, which so see a server that answers, or an error that they do not try again.
"""

import threading
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

import anyio
import httpx
from prefect.events.clients import PrefectEventsClient

from .outage import Outage

_LOGS = "/logs"
_SHOWN = ("/artifacts", _LOGS, "/concurrency_limits", "/v2/concurrency_limits")
"""What only informs, or is looked after again and again."""

_SHOWN_TIMEOUT_S = 15.0
_LOOK_S = 0.25


class PrefectServerAwayError(httpx.NetworkError):
    """The Prefect server is away and is not waited for; Prefect's client does not try this one again."""


@contextmanager
def patient_requests(outage: Outage, api_url: str) -> Generator[None]:
    """Has the requests and events of this process to a Prefect server share one patience inside the block.

    Args:
        outage: what knows whether the server is away.
        api_url: URL of its API; requests to others are left alone.
    """
    server = urlsplit(api_url)
    send, send_async, emit = (
        httpx.HTTPTransport.handle_request,
        httpx.AsyncHTTPTransport.handle_async_request,
        PrefectEventsClient.emit,
    )

    def is_ours(request: httpx.Request) -> bool:
        return (request.url.host, request.url.port) == (server.hostname, server.port)

    def handle_request(transport: httpx.HTTPTransport, request: httpx.Request) -> httpx.Response:
        if not is_ours(request):
            return send(transport, request)
        waits = _waits(request, server.path)
        while not outage.is_on or (waits and outage.wait()):
            with outage.asking() as began:
                try:
                    return send(transport, request)
                except httpx.TransportError:
                    if not outage.look(began):
                        raise  # what went wrong is over, and Prefect's client tries again
        raise PrefectServerAwayError("the Prefect server does not answer", request=request)

    async def handle_async_request(transport: httpx.AsyncHTTPTransport, request: httpx.Request) -> httpx.Response:
        if not is_ours(request):
            return await send_async(transport, request)
        while not outage.is_on or await _answers(outage):
            with outage.asking() as began:
                try:
                    return await send_async(transport, request)
                except httpx.TransportError:
                    if not await anyio.to_thread.run_sync(outage.look, began):
                        raise
        if request.url.path.startswith(f"{server.path}{_LOGS}"):
            return httpx.Response(201)  # dropped like events: Prefect would print each line that it cannot send
        raise PrefectServerAwayError("the Prefect server does not answer", request=request)

    async def emit_while_it_answers(client: PrefectEventsClient, event: Any) -> None:
        """Sends an event, unless the server is away for too long: the queue of events is emptied before we end."""
        if outage.is_on and not await _answers(outage):
            return
        async with anyio.create_task_group() as tasks:

            async def give_up() -> None:
                while not outage.is_on or outage.is_waited_for:
                    await anyio.sleep(_LOOK_S)
                tasks.cancel_scope.cancel()

            tasks.start_soon(give_up)
            await emit(client, event)
            tasks.cancel_scope.cancel()

    httpx.HTTPTransport.handle_request = handle_request
    httpx.AsyncHTTPTransport.handle_async_request = handle_async_request
    PrefectEventsClient.emit = emit_while_it_answers
    try:
        with outage.watched():
            yield
    finally:
        httpx.HTTPTransport.handle_request = send
        httpx.AsyncHTTPTransport.handle_async_request = send_async
        PrefectEventsClient.emit = emit


def _waits(request: httpx.Request, root: str) -> bool:
    """Whether a request waits for the server: those of the main thread that begin and end flow runs.

    One that does not is also answered soon or never, as far as its caller goes.
    """
    path = request.url.path.removeprefix(root)
    if threading.current_thread() is threading.main_thread() and not path.startswith(_SHOWN):
        return True
    timeouts = request.extensions.get("timeout", {})
    shortest = min(timeouts.get("read") or _SHOWN_TIMEOUT_S, _SHOWN_TIMEOUT_S)
    request.extensions["timeout"] = {**timeouts, "read": shortest}
    return False


async def _answers(outage: Outage) -> bool:
    """Waits until the server answers or patience has run out; says whether it answers."""
    while outage.is_waited_for:
        await anyio.sleep(_LOOK_S)
    return not outage.is_on
