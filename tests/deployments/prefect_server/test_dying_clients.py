"""Clients that die in the middle of their requests cost nobody else an answer."""

import base64
import json
import socket
import threading
import time
import urllib.parse
import uuid
from collections.abc import Iterator
from contextlib import closing, contextmanager
from itertools import cycle
from pathlib import Path
from random import Random

import httpx
import pytest
from helpers.prefect_server import provide_tables
from helpers.server_log import tracebacks, where_it_was_stuck

from prefect_robomaker.deployments.prefect_server.local_server import ensure_server, server_status, stop_server
from prefect_robomaker.deployments.prefect_server.secret import auth_string, server_folder
from prefect_robomaker.schemas.settings import Settings

NOTHING = {"PREFECT_PROFILES_PATH": "/nowhere"}
CLIENTS = 4
MOST_ANSWERS = 4.0
"""Until when a client dies, in times of an answer, from when it has sent its request. A time in seconds would overload
a busy machine, which is another matter."""
TRIED = 5
"""Answers that are timed."""

ANSWERS = 40
RESET = b"\1\0\0\0\0\0\0\0"
"""Of `SO_LINGER`: the connection is reset, as when a process is killed."""


@pytest.fixture
def own_server(tmp_path: Path) -> Iterator[Settings]:
    settings = Settings.from_environment({"ROBOMAKER_HOME": str(tmp_path / "home")})
    provide_tables(server_folder(settings))
    ensure_server(settings, NOTHING)
    yield settings
    stop_server(settings)


def client_of(settings: Settings) -> httpx.Client:
    name = str(uuid.uuid4())
    secret = base64.b64encode(auth_string(settings).encode()).decode()
    headers = {"Authorization": f"Basic {secret}", "Prefect-Csrf-Client": name}
    url = server_status(settings, NOTHING).api_url
    client = httpx.Client(base_url=str(url), headers=headers, timeout=120, trust_env=False)
    client.headers["Prefect-Csrf-Token"] = client.get("/csrf-token", params={"client": name}).json()["token"]
    return client


@contextmanager
def dying_clients(client: httpx.Client, requests: list[tuple[str, bytes]], most_s: float) -> Iterator[None]:
    """Sends requests as a client does, from connections that are reset before or after the answer came.

    Args:
        client: Whose requests they are.
        requests: Paths and bodies.
        most_s: Until when a connection is reset.
    """
    target = urllib.parse.urlsplit(str(client.base_url))
    ended = threading.Event()

    def die_again_and_again(seed: int) -> None:
        chance = Random(seed)
        for path, body in cycle(requests):
            if ended.is_set():
                return
            request = client.build_request("POST", path, content=body)
            lines = [f"POST {request.url.raw_path.decode()} HTTP/1.1"]
            lines += [f"{name}: {value}" for name, value in request.headers.items()]
            with socket.create_connection((str(target.hostname), target.port or 80)) as connection:
                connection.sendall("\r\n".join(lines).encode() + b"\r\n\r\n" + body)
                time.sleep(chance.uniform(0, most_s))
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)

    threads = [threading.Thread(target=die_again_and_again, args=(seed,)) for seed in range(CLIENTS)]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        ended.set()
        for thread in threads:
            thread.join()


@pytest.mark.deep
def test_clients_that_die_in_their_requests_stop_no_server(own_server: Settings) -> None:
    with closing(client_of(own_server)) as client:
        flow = client.post("/flows/", json={"name": "of-many"}).json()["id"]
        run = json.dumps({"flow_id": flow, "state": {"type": "PENDING"}}).encode()
        state = json.dumps({"state": {"type": "RUNNING"}, "force": True}).encode()
        one = client.post("/flow_runs/", content=run).json()["id"]

        began_s = time.monotonic()
        for _ in range(TRIED):
            client.post("/flow_runs/", content=run).raise_for_status()
        most_s = MOST_ANSWERS * (time.monotonic() - began_s) / TRIED

        with dying_clients(client, [("/flow_runs/", run), (f"/flow_runs/{one}/set_state", state)], most_s):
            answers = [client.post("/flow_runs/", content=run).status_code for _ in range(ANSWERS)]

    assert answers == [201] * ANSWERS
    log = (own_server.home / "prefect" / "server.log").read_text(errors="replace")
    assert where_it_was_stuck(log) == ""
    assert tracebacks(log) == []
