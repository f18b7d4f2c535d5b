"""A Prefect server as it comes, without login, and the same behind our guard: what attacks are tried on first.

Run as a program, it prints both ports and serves until it is killed.
"""

import asyncio
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from subprocess import PIPE

from helpers.processes import started


@contextmanager
def bare_prefect_server(folder: Path) -> Iterator[tuple[str, str]]:
    """Starts the two.

    Args:
        folder: Where the server keeps its database and its log.

    Yields:
        The addresses of the bare one and of the guarded one.
    """
    from helpers.prefect_server import provide_tables  # which the program below does not need

    provide_tables(folder)
    environ = {"PREFECT_HOME": str(folder), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    inherited = ("PREFECT_API_URL", "PREFECT_API_AUTH_STRING")
    command = ["env", *(word for name in inherited for word in ("-u", name)), sys.executable, "-m", __name__]
    with (folder / "server.log").open("w") as log, started(command, environ, stdout=PIPE, stderr=log) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line, (folder / "server.log").read_text()
        bare, guarded = line.split()
        yield f"http://127.0.0.1:{bare}", f"http://127.0.0.1:{guarded}"


async def _serve() -> None:
    import uvicorn
    from prefect.server.api.server import create_app

    from prefect_robomaker.deployments.foreign_pages import Guard

    application = create_app(final=True)
    servers = [
        uvicorn.Server(uvicorn.Config(application, port=0, log_level="warning", lifespan="on")),
        uvicorn.Server(uvicorn.Config(Guard(application), port=0, log_level="warning", lifespan="off")),
    ]
    serving = []
    for server in servers:  # the second shares what the first one starts
        serving.append(asyncio.create_task(server.serve()))
        while not server.started:
            await asyncio.sleep(0.05)
    print(*(server.servers[0].sockets[0].getsockname()[1] for server in servers), flush=True)
    await asyncio.gather(*serving)


if __name__ == "__main__":
    asyncio.run(_serve())
