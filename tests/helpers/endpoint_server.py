"""A real endpoint in a process of its own, and a client as plain as can be."""

import asyncio
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from helpers.paths import TESTS
from helpers.processes import started
from prefect_robomaker.schemas.settings import Settings

KEYS = "ENDPOINT_ACCESS_KEYS"
BARE = "ENDPOINT_BARE"


@contextmanager
def endpoint(
    settings: Settings, log: Path, *, keys: Mapping[str, str] | None = None, bare: bool = False
) -> Iterator[int]:
    """The port of an endpoint that serves the settings' catalog; `bare`: of a handler that always says the same."""
    environ = {
        "ROBOMAKER_HOME": str(settings.home),
        "ROBOMAKER_CATALOG_URL": settings.catalog_url,
        "ROBOMAKER_OBJECT_STORE": settings.object_store,
        KEYS: json.dumps(keys),
        BARE: "1" if bare else "",
        "PYTHONPATH": os.pathsep.join([str(TESTS), *filter(None, [os.environ.get("PYTHONPATH")])]),
    }
    command = [sys.executable, "-m", "helpers.endpoint_server"]
    with (
        log.open("w") as errors,
        started(command, environ, stdout=subprocess.PIPE, stderr=errors) as server,
    ):
        assert server.stdout is not None
        first = server.stdout.readline()
        assert first, log.read_text()
        yield int(first)
        server.terminate()
        assert server.wait(200) == 0, log.read_text()


def http_request(path: str, body: Any, method: str = "POST") -> bytes:
    """A request as it goes over the wire."""
    content = json.dumps(body).encode()
    head = f"{method} {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    return f"{head}Content-Length: {len(content)}\r\n\r\n".encode() + content


async def exchange(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, request: bytes) -> tuple[int, bytes]:
    """Sends a request and reads status and body of its answer."""
    writer.write(request)
    head = (await reader.readuntil(b"\r\n\r\n")).lower()
    length = int(head.split(b"content-length:", 1)[1].split(b"\r\n", 1)[0])
    return int(head[9:12]), await reader.readexactly(length)


def load(
    port: int, requests: list[bytes], *, connections: int, duration_s: float, per_second: float | None = None
) -> tuple[list[float], float]:
    """Sends requests one after the other on several connections.

    Args:
        port: Where to.
        requests: What; taken in turn.
        connections: How many at once.
        duration_s: For how long.
        per_second: How many in a second, all connections together; `None`: as many as there are answers.

    Returns:
        The time each took, in order of size, and requests per second.
    """
    times: list[float] = []

    async def client(number: int, end: float) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        index = number
        start = time.perf_counter() + (number / per_second if per_second else 0.0)
        while (began := time.perf_counter()) < end:
            if per_second and (early := start + (index - number) / per_second - began) > 0:
                await asyncio.sleep(early)
                began = time.perf_counter()
            status, body = await exchange(reader, writer, requests[index % len(requests)])
            times.append(time.perf_counter() - began)
            assert status == 200, body
            index += connections
        writer.close()
        await writer.wait_closed()

    async def clients() -> float:
        began = time.perf_counter()
        await asyncio.gather(*(client(number, began + duration_s) for number in range(connections)))
        return time.perf_counter() - began

    elapsed = asyncio.run(clients())
    return sorted(times), len(times) / elapsed


def main() -> None:
    """Serves until it is told to stop; prints the port."""
    from prefect_robomaker.deployments.endpoint.application import Endpoint
    from prefect_robomaker.deployments.endpoint.calling.access_keys import AccessKey
    from prefect_robomaker.deployments.endpoint.server import run_server
    from prefect_robomaker.tasks.service.service import Service

    if os.environ[BARE]:
        from starlette.applications import Starlette
        from starlette.responses import JSONResponse
        from starlette.routing import Route

        async def constant(_: object) -> JSONResponse:
            return JSONResponse({"arn": "constant"})

        application: Any = Starlette(routes=[Route("/{path:path}", constant, methods=["POST"])])
    else:
        service = Service.open(Settings.from_environment(os.environ))
        given = json.loads(os.environ[KEYS])
        keys = given and {key: AccessKey(key, secret) for key, secret in given.items()}
        application = Endpoint(service, access_keys=keys)
    run_server(application, "127.0.0.1", 0, ready=lambda port: print(port, flush=True))


if __name__ == "__main__":
    main()
