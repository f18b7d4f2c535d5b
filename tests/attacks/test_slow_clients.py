"""A hundred clients that are slow on purpose, at the endpoint, its console and the local Prefect server."""

import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import httpx
import pytest
from helpers.bare_prefect_server import bare_prefect_server
from helpers.endpoint_process import Serve

pytestmark = pytest.mark.deep

OTHERS_WAIT_S = 120.0
"""Limit of a request of somebody else meanwhile; it takes milliseconds on an idle machine."""


def silent(connection: socket.socket) -> None:
    """Says nothing."""


def without_end(connection: socket.socket) -> None:
    """Sends a head that does not end."""
    connection.sendall(b"GET /console/jobs HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: ")


def half_a_body(connection: socket.socket) -> None:
    """Promises a body and sends a part of it."""
    head = b"POST /listWorlds HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"
    connection.sendall(head + b'Content-Length: 60000\r\n\r\n{"maxResults": 1')


def deaf(connection: socket.socket) -> None:
    """Asks for pages without reading any, through a buffer that is full at once."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
    connection.sendall(b"GET /console HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 20)


KINDS: tuple[Callable[[socket.socket], None], ...] = (silent, without_end, half_a_body, deaf)


@contextmanager
def hundred_slow_clients(port: int) -> Iterator[list[socket.socket]]:
    """Connects twenty-five clients of each kind."""
    with ExitStack() as stack:
        clients = []
        for number in range(100):
            client = stack.enter_context(socket.create_connection(("127.0.0.1", port), OTHERS_WAIT_S))
            KINDS[number % len(KINDS)](client)
            clients.append(client)
        yield clients


def test_a_hundred_slow_clients_keep_nobody_out_of_the_endpoint(serve: Serve) -> None:
    with serve("--execute", "none") as served, hundred_slow_clients(int(served.url.rpartition(":")[2])) as clients:
        with httpx.Client(base_url=served.url, timeout=OTHERS_WAIT_S, trust_env=False) as other:
            for path in ("/health", "/console", "/console/jobs") * 5:
                assert other.get(path).status_code == 200, path
        assert served.call("ListWorlds", {})["worldSummaries"] == []
        for number in (1, 2):  # a head, and a body, that do not end are not waited for
            clients[number].settimeout(OTHERS_WAIT_S)
            answer = clients[number].recv(1000)
            assert answer == b"" or b" 400 " in answer or b" 408 " in answer, answer


def test_a_hundred_slow_clients_keep_nobody_out_of_the_prefect_server(tmp_path_factory: pytest.TempPathFactory) -> None:
    with bare_prefect_server(tmp_path_factory.mktemp("slow")) as (_, guarded):
        port = httpx.URL(guarded).port
        assert port is not None
        with hundred_slow_clients(port), httpx.Client(timeout=OTHERS_WAIT_S, trust_env=False) as other:
            for number in range(10):
                assert other.get(f"{guarded}/api/health").json() is True
                flow = other.post(f"{guarded}/api/flows/", json={"name": f"flow-{number}"})
                assert flow.is_success, flow.text
