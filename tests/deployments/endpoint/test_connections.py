"""Slow clients of a real server: they lose their connections, and cost others nothing."""

import http.client
import signal
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeVar

import pytest
from helpers.endpoint_server import http_request

from prefect_robomaker.deployments.endpoint import application as application_module
from prefect_robomaker.deployments.endpoint.application import Endpoint
from prefect_robomaker.deployments.endpoint.connections import ConnectionLimits, most_connections
from prefect_robomaker.deployments.endpoint.server import run_server
from prefect_robomaker.tasks.service.service import Service

PATIENCE_S = 60.0
HASTY = ConnectionLimits(connections=100, head_s=0.5, answer_s=0.5)
UNHURRIED = ConnectionLimits(connections=100, head_s=4.0, answer_s=PATIENCE_S)
"""For clients that have to send something before they are too slow, on a machine that is busy."""
REQUEST = http_request("/listWorlds", {})

T = TypeVar("T")
Ended = bytes | None
"""What a client was sent before its connection ended; `None`: it did not end."""


def served(application: Any, client: Callable[[int], T], limits: ConnectionLimits = HASTY) -> T:
    """What a client of a server gets; the client has a thread of its own."""
    results: list[T] = []

    def ready(port: int) -> None:
        def run() -> None:
            try:
                results.append(client(port))
            finally:
                signal.raise_signal(signal.SIGTERM)

        threading.Thread(target=run, daemon=True).start()

    run_server(application, "127.0.0.1", 0, ready=ready, limits=limits)
    [result] = results
    return result


def trickle(connection: socket.socket, byte: bytes = b"x") -> Ended:
    """Sends a byte ten times a second until the other side has ended the connection."""
    connection.settimeout(0.1)
    received = b""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        try:
            connection.sendall(byte)
            part = connection.recv(65536)
        except TimeoutError:
            continue
        except OSError:
            return received
        if not part:
            return received
        received += part
    return None


def connect(port: int) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)


def ask(port: int) -> int:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)
    connection.request("POST", "/listWorlds", b"{}")
    status = connection.getresponse().status
    connection.close()
    return status


def test_a_head_that_never_ends_ends_the_connection(service: Service) -> None:
    def client(port: int) -> Ended:
        with connect(port) as connection:
            connection.sendall(b"POST /listWorlds HTTP/1.1\r\nHost: localhost\r\nX-Slow: ")
            return trickle(connection)

    assert served(Endpoint(service), client) == b""


def test_a_second_head_that_never_ends_ends_the_connection_after_the_first_answer(service: Service) -> None:
    def client(port: int) -> Ended:
        with connect(port) as connection:
            connection.sendall(REQUEST)
            answer = b""
            while not answer.endswith(b'{"worldSummaries":[]}'):
                answer += (part := connection.recv(65536))
                assert part, "its connection ended before the first answer"
            connection.sendall(REQUEST[:10])
            return trickle(connection)

    assert served(Endpoint(service), client, UNHURRIED) == b""


def test_who_says_nothing_is_not_waited_for(service: Service) -> None:
    def client(port: int) -> bytes:
        with connect(port) as connection:
            return connection.recv(100)

    assert served(Endpoint(service), client) == b""


def test_a_body_that_never_ends_is_answered_and_its_rest_is_not_waited_for(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = application_module.read_body
    monkeypatch.setattr(
        application_module, "read_body", lambda request, declared, most, _: real(request, declared, most, 0.3)
    )

    def client(port: int) -> Ended:
        with connect(port) as connection:
            connection.sendall(b"POST /listWorlds HTTP/1.1\r\nHost: localhost\r\nContent-Length: 60000\r\n\r\n{")
            return trickle(connection, b" ")

    answer = served(Endpoint(service), client, UNHURRIED)
    assert answer is not None
    assert answer.startswith(b"HTTP/1.1 408")


def test_an_answer_that_nobody_reads_is_given_up() -> None:
    given_up = threading.Event()

    async def large(scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] != "http":
            return
        await send({"type": "http.response.start", "status": 200, "headers": []})
        for _ in range(1000):
            await send({"type": "http.response.body", "body": bytes(1 << 20), "more_body": True})
            if (await_disconnect := getattr(receive, "__self__", None)) is not None and await_disconnect.disconnected:
                given_up.set()
                return

    def client(port: int) -> bool:
        with connect(port) as connection:
            connection.sendall(REQUEST)
            return given_up.wait(PATIENCE_S)

    assert served(large, client, ConnectionLimits(connections=100, head_s=PATIENCE_S, answer_s=0.5))


def test_a_crowd_of_silent_clients_keeps_nobody_out(service: Service) -> None:
    limits = ConnectionLimits(connections=5, head_s=PATIENCE_S * 2)

    def client(port: int) -> tuple[list[int], bytes, bool]:
        crowd = [connect(port) for _ in range(5)]
        statuses = [ask(port) for _ in range(3)]
        crowd[0].settimeout(PATIENCE_S)
        first = crowd[0].recv(100)
        crowd[-1].settimeout(0.2)
        is_last_open = False
        with suppress(ConnectionError):
            try:
                crowd[-1].recv(100)
            except TimeoutError:
                is_last_open = True
        for one in crowd:
            one.close()
        return statuses, first, is_last_open

    assert served(Endpoint(service), client, limits) == ([200] * 3, b"", True)


def test_limits_leave_files_for_everything_else() -> None:
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (512, hard))
        assert most_connections() == 384
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
