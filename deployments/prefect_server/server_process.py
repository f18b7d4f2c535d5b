"""Runs Prefect's server application in this process, with access protection, login pages and background jobs.

Prefect's settings must be set before this module is imported.
"""

import asyncio
import json
import logging
import queue
import socket
import sqlite3
from collections.abc import Awaitable, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from datetime import timedelta
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any

import aiosqlite
import uvicorn
from burner_redis.pubsub import PubSub
from docket import Worker
from prefect.server.api import background_workers
from prefect.server.api.server import create_app
from prefect.server.database.configurations import AioSqliteConfiguration
from prefect.settings import get_current_settings
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ..foreign_pages import Guard
from .login_page import LoginPage
from .stuck_loop import tell_when_stuck

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from prefect.client.orchestration import PrefectClient

    Job = Callable[[PrefectClient], Awaitable[None]]

_logger = logging.getLogger(__name__)


@asynccontextmanager
async def beside(jobs: "Sequence[Job]", api_url: str, auth_string: str) -> "AsyncIterator[None]":
    """Runs background jobs beside the Prefect server, until the block ends.

    Args:
        jobs: The functions to run.
        api_url: API of the server, which answers.
        auth_string: `user:secret`, as the server wants it.
    """
    tasks = [asyncio.create_task(_run(job, api_url, auth_string)) for job in jobs]
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _run(job: "Job", api_url: str, auth_string: str) -> None:
    from prefect.client.orchestration import PrefectClient

    try:
        async with PrefectClient(api_url, auth_string=auth_string) as client:
            await job(client)
    except Exception:
        _logger.exception("%s beside the Prefect server failed", getattr(job, "__qualname__", job))


_PATH = "/events/in"


class RepeatedLogins:
    """ASGI application that removes repeated logins on Prefect's event sockets."""

    def __init__(self, application: ASGIApp) -> None:
        self._application = application

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers a request, or serves a socket, without a repeated login (ASGI)."""
        is_of_events = scope["type"] == "websocket" and scope["path"].endswith(_PATH)
        await self._application(scope, _first_login(receive) if is_of_events else receive, send)


def _first_login(receive: Receive) -> Receive:
    is_logged_in = False

    async def receive_next() -> Message:
        nonlocal is_logged_in
        while True:
            message = await receive()
            if not _is_login(message):
                return message
            if not is_logged_in:
                is_logged_in = True
                return message

    return receive_next


def _is_login(message: Message) -> bool:
    text = message.get("text")
    # An event starts with its own members; only what may be a login is read twice.
    if message["type"] != "websocket.receive" or not text or '"auth"' not in text[:40]:
        return False
    try:
        content = json.loads(text)
    except ValueError:
        return False
    return isinstance(content, dict) and content.get("type") == "auth"


_SQLITE_WAITS_MS = 50
"""Time that SQLite itself may wait for a lock, in milliseconds; its own pauses, up to 100 ms, block the main thread."""

_PATIENCE_S = 60.0
"""Time that Prefect lets a connection wait for a lock, in seconds."""

_PAUSE_S = 0.005
_LONGEST_PAUSE_S = 0.1

_CALLS = frozenset({"execute", "executemany", "commit"})
"""Database calls that are repeated while the database is locked; `executemany` only if it has changed nothing."""


def wait_in_the_event_loop() -> None:
    """Changes how Prefect uses SQLite in this process: waiting for locks happens in the event loop and not in threads.

    A statement that still finds the database locked after some time raises SQLite's error, as before.
    """
    set_up, begin = AioSqliteConfiguration.setup_sqlite, AioSqliteConfiguration.begin_transaction
    execute = aiosqlite.Connection._execute  # pyright: ignore[reportPrivateUsage]

    def setup_sqlite(self: AioSqliteConfiguration, conn: Any, record: Any) -> None:
        set_up(self, conn, record)
        cursor = conn.cursor()
        cursor.execute(f"PRAGMA busy_timeout = {_SQLITE_WAITS_MS}")
        cursor.close()

    def begin_transaction(self: AioSqliteConfiguration, session: Any, with_for_update: bool = False) -> Any:
        del with_for_update  # who begins a transaction means to write
        return begin(self, session, with_for_update=True)

    async def patient(self: aiosqlite.Connection, fn: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
        deadline = asyncio.get_running_loop().time() + _PATIENCE_S
        pause_s = _PAUSE_S
        while True:
            changes = self.total_changes
            try:
                return await execute(self, fn, *args, **kwargs)
            except sqlite3.OperationalError as error:
                late = asyncio.get_running_loop().time() > deadline
                if late or not _refused(error, fn) or self.total_changes != changes:
                    raise
            await asyncio.sleep(pause_s)
            pause_s = min(2 * pause_s, _LONGEST_PAUSE_S)

    AioSqliteConfiguration.setup_sqlite = setup_sqlite
    AioSqliteConfiguration.begin_transaction = begin_transaction
    aiosqlite.Connection._execute = patient  # pyright: ignore[reportPrivateUsage]


def _refused(error: sqlite3.OperationalError, call: Callable[..., Any]) -> bool:
    """Whether a call failed because another connection has the lock.

    With `SQLITE_BUSY_SNAPSHOT` waiting does not help.
    """
    return getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_BUSY and getattr(call, "__name__", "") in _CALLS


_LOOK_FOR_WORK = timedelta(seconds=2)
"""Time that Prefect's background worker waits for work, which wakes it; by default 0.25 s."""

_LOOK_FOR_SLOTS = timedelta(seconds=0.25)
"""Time that Prefect's background worker sleeps while its slots are taken, as by default.

Ten tasks of a bulk, such as removing logs of 5,000 flow runs, begin after each sleep. More slots instead would be more
writers of SQLite than it has connections.
"""

_LOOK_FOR_DUE = timedelta(seconds=0.5)
"""Interval between checks which of Prefect's services are due; by default 0.25 s.

It is less than the second by which Prefect's polls for new deployments overlap: later ones would miss some.
"""

_LOOK_FOR_MESSAGES_S = 0.5
"""Interval between two checks whether a background task is cancelled, in seconds; Prefect never does that."""


class _SeldomLooking(Worker):
    """Background worker that waits long for work, but not for its own slots; docket has one setting for both."""

    @property
    def minimum_check_interval(self) -> timedelta:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Time between checks of Prefect's background worker."""
        is_full = len(self._tasks_by_key) >= self.concurrency
        return _LOOK_FOR_SLOTS if is_full else _LOOK_FOR_WORK

    @minimum_check_interval.setter
    def minimum_check_interval(self, value: timedelta) -> None:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Ignores Docket's default check interval."""


def look_seldom() -> None:
    """Makes Prefect's background worker check less often, to save CPU."""
    background_workers.Worker = partial(  # pyright: ignore[reportPrivateImportUsage]
        _SeldomLooking, scheduling_resolution=_LOOK_FOR_DUE
    )  # fmt: skip
    PubSub._queue_get = _wait_for_message  # pyright: ignore[reportPrivateUsage]


async def _wait_for_message(self: Any, timeout: float | None) -> Any:
    """Waits for a message in the event loop.

    burner-redis uses a thread that wakes ten times a second, which costs more.
    """
    clock = asyncio.get_running_loop().time
    deadline = None if timeout is None else clock() + timeout
    while True:
        try:
            return self._queue.get_nowait()
        except queue.Empty:
            if deadline is not None and clock() >= deadline:
                return None
        await asyncio.sleep(_LOOK_FOR_MESSAGES_S)


_HOST = "127.0.0.1"


def make_application(port: int, auth_string: str) -> ASGIApp:
    """Makes the Prefect server's ASGI application for a local port.

    Args:
        port: The port.
        auth_string: Credentials that every request to Prefect's API needs, `user:secret`.
    """
    return Guard(LoginPage(RepeatedLogins(create_app(final=True)), f"http://{_HOST}:{port}", auth_string))


def run(listener: socket.socket, auth_string: str) -> None:
    """Runs the Prefect server until SIGTERM or SIGINT.

    Args:
        listener: A socket that listens at a port of 127.0.0.1.
        auth_string: Credentials that every request to Prefect's API needs, `user:secret`.
    """
    wait_in_the_event_loop()
    look_seldom()
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
    """uvicorn server with background jobs that run while it answers."""

    def __init__(self, config: uvicorn.Config, api_url: str, auth_string: str) -> None:
        super().__init__(config)
        self._api_url = api_url
        self._auth_string = auth_string
        self._beside = AsyncExitStack()

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Starts to answer requests, then starts the background jobs."""
        await super().startup(sockets)
        if self.started:
            # Its modules take a second to import, which who waits for the server need not wait for.
            sweeper = await asyncio.to_thread(import_module, "prefect_robomaker.deployments.dead_run_sweeper")
            jobs = (sweeper.close_dead_runs_beside, tell_when_stuck)
            await self._beside.enter_async_context(beside(jobs, self._api_url, self._auth_string))

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Ends the background jobs, then the Prefect server."""
        await self._beside.aclose()
        await super().shutdown(sockets)
