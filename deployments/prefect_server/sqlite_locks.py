"""Lets the server's SQLite connections wait for one another in the event loop, in an order that always ends.

Prefect's connections wait for a lock inside SQLite, for up to a minute, each in a thread of its own, and SQLite keeps
such a connection to that thread meanwhile. When Python's garbage collector then drops an old cursor of the connection
in the main thread, the main thread waits as well. If the transaction that has the lock goes on in the main thread, as
Prefect's do, nothing moves until the minute is over: the server answers nothing, and then fails requests with
`database is locked`. A client that dies in the middle of its request leaves such cursors. So SQLite gives up soon
here, and what it refused is asked again after a pause in which the event loop goes on.

Prefect's transactions also begin without the lock. One that has read, and wants to write after another has written, is
refused at once, since what it read is out of date; clients see status 503. So they take the lock when they begin here.
"""

import asyncio
import sqlite3
from collections.abc import Callable
from typing import Any

import aiosqlite
from prefect.server.database.configurations import AioSqliteConfiguration

_SQLITE_WAITS_MS = 50
"""How long the main thread can be kept waiting; SQLite's own pauses are up to 100 ms."""

_PATIENCE_S = 60.0
"""How long Prefect lets a connection wait."""

_PAUSE_S = 0.005
_LONGEST_PAUSE_S = 0.1

_CALLS = frozenset({"execute", "executemany", "commit"})
"""Calls that are tried again while the database is locked; `executemany` only if it has changed nothing."""


def wait_in_the_event_loop() -> None:
    """Changes how Prefect uses SQLite in this process; called before Prefect's application is made."""
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
    """Whether another connection has the lock; where no waiting helps, the code is `SQLITE_BUSY_SNAPSHOT`."""
    return getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_BUSY and getattr(call, "__name__", "") in _CALLS
