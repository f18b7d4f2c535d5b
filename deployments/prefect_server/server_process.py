"""Runs Prefect's server application in this process, guarded and with our pages; Prefect's settings must be set."""

import asyncio
import socket
from contextlib import AsyncExitStack
from importlib import import_module

import uvicorn
from prefect.server.api.server import create_app
from prefect.settings import get_current_settings
from starlette.types import ASGIApp

from ..web_guard.guard import Guard
from .beside import beside
from .login_page import LoginPage
from .repeated_logins import RepeatedLogins
from .sqlite_locks import wait_in_the_event_loop
from .stuck_loop import tell_when_stuck

_HOST = "127.0.0.1"


def make_application(port: int, auth_string: str) -> ASGIApp:
    """Makes the application that answers at a port of 127.0.0.1.

    Args:
        port: the port.
        auth_string: what every request to Prefect's API has to carry.
    """
    return Guard(LoginPage(RepeatedLogins(create_app(final=True)), f"http://{_HOST}:{port}", auth_string))


def run(listener: socket.socket, auth_string: str) -> None:
    """Serves until SIGTERM or SIGINT.

    Args:
        listener: a socket that listens at a port of 127.0.0.1.
        auth_string: what every request to Prefect's API has to carry.
    """
    wait_in_the_event_loop()
    prefect = get_current_settings().server.api
    port: int = listener.getsockname()[1]
    config = uvicorn.Config(
        make_application(port, auth_string),
        log_level="warning",
        access_log=False,
        server_header=False,
        proxy_headers=False,
        timeout_keep_alive=prefect.keepalive_timeout,
        ws_ping_interval=prefect.websocket_ping_interval,
        ws_ping_timeout=prefect.websocket_ping_timeout,
    )
    _Server(config, f"http://{_HOST}:{port}/api", auth_string).run(sockets=[listener])


class _Server(uvicorn.Server):
    """uvicorn's server, with our jobs beside it while it answers."""

    def __init__(self, config: uvicorn.Config, api_url: str, auth_string: str) -> None:
        super().__init__(config)
        self._api_url = api_url
        self._auth_string = auth_string
        self._beside = AsyncExitStack()

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Starts to answer, then starts the jobs."""
        await super().startup(sockets)
        if self.started:
            # Its modules take a second to import, which who waits for the server need not wait for.
            sweeper = await asyncio.to_thread(import_module, "prefect_robomaker.deployments.dead_run_sweeper")
            jobs = (sweeper.close_dead_runs_beside, tell_when_stuck)
            await self._beside.enter_async_context(beside(jobs, self._api_url, self._auth_string))

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Ends the jobs, then the server."""
        await self._beside.aclose()
        await super().shutdown(sockets)
