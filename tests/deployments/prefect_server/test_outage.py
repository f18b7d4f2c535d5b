"""An outage of the Prefect server: told at once, waited for once, by all requests together."""

import asyncio
import http.server
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise

import httpx
import pytest
from helpers.ports import free_port
from helpers.processes import wait_for
from hypothesis import given
from hypothesis import strategies as st
from prefect.client.base import PrefectHttpxAsyncClient
from prefect.settings import PREFECT_CLIENT_MAX_RETRIES, temporary_settings

from prefect_robomaker.deployments.prefect_server import outage as outage_module
from prefect_robomaker.deployments.prefect_server.outage import BUSY_PATIENCE_S, DEAD_PATIENCE_S, Health, Outage
from prefect_robomaker.deployments.prefect_server.patient_requests import PrefectServerAwayError, patient_requests

LOCAL = "http://127.0.0.1:4200/api"


class Server:
    """A server that is as a test wants it, and a clock."""

    def __init__(self, *, is_own: bool = True) -> None:
        self.health = Health.HEALTHY
        self.now_s = 100.0
        self.told: list[str] = []
        self.outage = Outage(LOCAL, lambda: self.health, self.told.append, is_own, lambda: self.now_s, look_s=0.01)


def test_an_outage_is_told_once_with_what_is_away_and_how_long_it_is_waited_for() -> None:
    server = Server()
    assert not server.outage.look(100.0)
    assert server.told == []

    server.health = Health.BUSY
    assert server.outage.look(100.0)
    assert server.outage.look(101.0)

    (told,) = server.told
    assert told.startswith(f"the Prefect server at {LOCAL} does not answer: it is silent; what runs goes on")
    assert told.endswith("90 s at most in all")


@pytest.mark.parametrize(
    ("is_own", "health", "patience_s"),
    [
        (True, Health.BUSY, BUSY_PATIENCE_S),
        (True, Health.AWAY, DEAD_PATIENCE_S),  # it is not started by anybody else
        (False, Health.AWAY, BUSY_PATIENCE_S),  # also on this machine: systemd or a container engine starts it again
    ],
)
def test_it_is_waited_for_as_long_as_it_may_come_back(is_own: bool, health: Health, patience_s: float) -> None:
    server = Server(is_own=is_own)
    server.health = health
    server.outage.look(100.0)

    server.now_s = 100.0 + patience_s - 1
    assert server.outage.is_waited_for
    server.now_s = 100.0 + patience_s
    assert not server.outage.is_waited_for
    assert not server.outage.wait()
    assert len(server.told) == 2


def test_one_that_answers_again_has_a_new_patience_the_next_time() -> None:
    server = Server()
    for since in (100.0, 1000.0):
        server.now_s, server.health = since, Health.BUSY
        server.outage.look(since)
        assert server.outage.is_waited_for
        server.now_s, server.health = since + 40, Health.HEALTHY
        server.outage.look(since)
        assert server.outage.wait()
    assert server.told[1] == server.told[3] == f"the Prefect server at {LOCAL} answers again, after 40 s"


@given(looks=st.lists(st.tuples(st.sampled_from(Health), st.floats(0, 30)), max_size=30))
def test_what_is_told_is_never_told_twice(looks: list[tuple[Health, float]]) -> None:
    server = Server()
    for server.health, passed_s in looks:
        server.now_s += passed_s
        server.outage.look(server.now_s)
    assert all(before != after for before, after in pairwise(server.told))


class Answering(http.server.BaseHTTPRequestHandler):
    """Answers everything."""

    def do_GET(self) -> None:
        """Answers."""
        self.send_response(200)
        self.send_header("content-length", "0")
        self.end_headers()

    def log_message(self, format: str, *arguments: object) -> None:  # noqa: A002 - its name there
        """Says nothing."""


@contextmanager
def listening(port: int = 0) -> Iterator[int]:
    with http.server.ThreadingHTTPServer(("127.0.0.1", port), Answering) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        try:
            yield server.server_port
        finally:
            server.shutdown()
            thread.join()


@contextmanager
def client_of(port: int) -> Iterator[tuple[httpx.Client, list[str]]]:
    url, told = f"http://127.0.0.1:{port}/api", list[str]()

    def ask() -> Health:
        with socket.socket() as probe:
            return Health.AWAY if probe.connect_ex(("127.0.0.1", port)) else Health.HEALTHY

    outage = Outage(url, ask, told.append, is_own=True, look_s=0.05)
    with patient_requests(outage, url), httpx.Client(base_url=url) as client:
        yield client, told


def test_a_request_of_the_main_thread_waits_for_a_server_that_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outage_module, "DEAD_PATIENCE_S", 120.0)  # on a busy machine it comes back late
    port = free_port()
    with client_of(port) as (client, told):

        def come_back() -> None:
            wait_for(lambda: told, "the outage")
            with listening(port):
                wait_for(lambda: len(told) > 1, "the end of the outage")
                wait_for(lambda: answers, "the answer")

        answers: list[int] = []
        coming = threading.Thread(target=come_back)
        coming.start()
        answers.append(client.get("/flows").status_code)
        coming.join()
    assert answers == [200]
    assert [text.partition(" at ")[0] for text in told] == ["the Prefect server"] * 2


def test_a_request_that_only_informs_fails_at_once_and_others_once_patience_has_run_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(outage_module, "DEAD_PATIENCE_S", 0.5)
    port = free_port()
    with client_of(port) as (client, told):
        with pytest.raises(PrefectServerAwayError):
            client.get("/artifacts/")
        assert len(told) == 1
        with pytest.raises(PrefectServerAwayError):
            client.get("/flows")
    assert told[1].endswith("is not waited for any longer; what runs goes on without it")


def test_requests_to_others_are_left_alone() -> None:
    with listening() as port, listening() as other, client_of(port) as (client, told):
        assert client.get(f"http://127.0.0.1:{other}/").status_code == 200
    assert told == []
    with listening() as other, client_of(other) as (client, told), pytest.raises(httpx.ConnectError):
        client.get(f"http://127.0.0.1:{port}/")
    assert told == []


def test_lines_of_logs_are_dropped_also_by_a_client_that_has_no_token_yet() -> None:
    """It asks for one before its first change; Prefect prints whatever goes wrong on the way of a line."""
    port = free_port()
    url = f"http://127.0.0.1:{port}/api"
    outage = Outage(url, lambda: Health.AWAY, lambda _: None, is_own=True, look_s=0.01)
    outage.look(0.0)

    async def send() -> None:
        chosen = {"enable_csrf_support": True, "base_url": url, "raise_on_all_errors": False}
        async with PrefectHttpxAsyncClient(**chosen) as client:  # what Prefect's client sends by
            assert (await client.post("/logs/", json=[])).status_code == 201
            with pytest.raises(PrefectServerAwayError):
                await client.post("/flows/", json={})

    with patient_requests(outage, url), temporary_settings({PREFECT_CLIENT_MAX_RETRIES: 0}):
        wait_for(lambda: not outage.is_waited_for, "the end of patience")
        asyncio.run(send())
