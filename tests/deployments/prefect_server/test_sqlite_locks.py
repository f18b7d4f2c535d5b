"""A server whose SQLite connections wait for one another goes on."""

import subprocess
import sys
from pathlib import Path

PRELUDE = """
import asyncio, gc, sqlite3, sys
from prefect.server.database.configurations import AioSqliteConfiguration
from prefect_robomaker.deployments.prefect_server import sqlite_locks

sqlite_locks.wait_in_the_event_loop()
configuration = AioSqliteConfiguration("sqlite+aiosqlite:///" + sys.argv[1])
kept = []

async def holder_and_writer():
    engine = await configuration.engine()
    kept.extend([await engine.raw_connection() for _ in range(2)])
    holder, writer = [each.driver_connection for each in kept]
    await holder.execute("CREATE TABLE runs (name)")
    await holder.execute("BEGIN IMMEDIATE")
    await holder.execute("INSERT INTO runs VALUES ('one')")
    return holder, writer

async def names(connection):
    return [row[0] for row in await (await connection.execute("SELECT name FROM runs ORDER BY name")).fetchall()]
"""
DROPPED = """
async def main():
    holder, writer = await holder_and_writer()
    old = await writer.execute("SELECT 1 UNION SELECT 2")
    await names(writer)  # its thread remembers the last result
    waiting = asyncio.create_task(writer.execute("INSERT INTO runs VALUES ('two')"))
    await asyncio.sleep(0.2)
    circle = [old._cursor]
    circle.append(circle)
    del old, circle
    gc.collect()
    await holder.commit()
    await waiting
    print(await names(holder))
"""
MANY = """
async def main():
    holder, writer = await holder_and_writer()
    waiting = asyncio.create_task(writer.executemany("INSERT INTO runs VALUES (?)", [("two",), ("three",)]))
    await asyncio.sleep(0.2)
    await holder.commit()
    await waiting
    print(await names(holder))
"""
STALE = """
async def main():
    holder, writer = await holder_and_writer()
    await holder.commit()
    await writer.execute("BEGIN")
    await names(writer)
    await holder.execute("INSERT INTO runs VALUES ('two')")
    try:
        await writer.execute("INSERT INTO runs VALUES ('three')")
    except sqlite3.OperationalError as error:
        print(error.sqlite_errorname)
"""
IMPATIENT = """
sqlite_locks._PATIENCE_S = 0.3

async def main():
    holder, writer = await holder_and_writer()
    try:
        await writer.execute("INSERT INTO runs VALUES ('two')")
    except sqlite3.OperationalError as error:
        print(error.sqlite_errorname)
    await holder.commit()
    await writer.execute("INSERT INTO runs VALUES ('three')")
    print(await names(holder))
"""


def printed(code: str, tmp_path: Path) -> str:
    """What code prints in a process of its own: it changes libraries."""
    command = [sys.executable, "-c", f"{PRELUDE}{code}\nasyncio.run(main())", str(tmp_path / "prefect.db")]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


def test_a_cursor_that_is_dropped_while_its_connection_waits_stops_nothing(tmp_path: Path) -> None:
    assert printed(DROPPED, tmp_path) == "['one', 'two']\n"


def test_many_rows_that_waited_are_written_once(tmp_path: Path) -> None:
    assert printed(MANY, tmp_path) == "['one', 'three', 'two']\n"


def test_what_no_waiting_helps_is_said_at_once(tmp_path: Path) -> None:
    assert printed(STALE, tmp_path) == "SQLITE_BUSY_SNAPSHOT\n"


def test_one_that_waited_too_long_is_refused_and_may_be_tried_again(tmp_path: Path) -> None:
    assert printed(IMPATIENT, tmp_path) == "SQLITE_BUSY\n['one', 'three']\n"
