"""A server whose SQLite connections wait for one another goes on."""

import json
import subprocess
import sys

import pytest

pytestmark = pytest.mark.deep

CASES = """
import asyncio, gc, json, sqlite3, sys
from prefect.server.database.configurations import AioSqliteConfiguration
from prefect_robomaker.deployments.prefect_server import server_process
from sqlalchemy import text

server_process.wait_in_the_event_loop()


class Database:
    def __init__(self, name):
        self.configuration = AioSqliteConfiguration(f"sqlite+aiosqlite:///{sys.argv[1]}/{name}.db")

    async def holder_and_writer(self):
        engine = await self.configuration.engine()
        self.pooled = [await engine.raw_connection() for _ in range(2)]
        holder, writer = [each.driver_connection for each in self.pooled]
        await holder.execute("CREATE TABLE runs (name)")
        await holder.execute("BEGIN IMMEDIATE")
        await holder.execute("INSERT INTO runs VALUES ('one')")
        return holder, writer

    async def add(self, name):
        async with await self.configuration.session(await self.configuration.engine()) as session:
            async with self.configuration.begin_transaction(session):
                count = (await session.execute(text("SELECT count(*) FROM runs"))).scalar()
                await asyncio.sleep(0.2)
                await session.execute(text(f"INSERT INTO runs VALUES ('{name} after {count}')"))


async def names(connection):
    return [row[0] for row in await (await connection.execute("SELECT name FROM runs ORDER BY name")).fetchall()]


async def refusal(writing):
    try:
        await writing
    except sqlite3.OperationalError as error:
        return error.sqlite_errorname


async def dropped(database):
    holder, writer = await database.holder_and_writer()
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
    return await names(holder)


async def many(database):
    holder, writer = await database.holder_and_writer()
    waiting = asyncio.create_task(writer.executemany("INSERT INTO runs VALUES (?)", [("two",), ("three",)]))
    await asyncio.sleep(0.2)
    await holder.commit()
    await waiting
    return await names(holder)


async def stale(database):
    holder, writer = await database.holder_and_writer()
    await holder.commit()
    await writer.execute("BEGIN")
    await names(writer)
    await holder.execute("INSERT INTO runs VALUES ('two')")
    return await refusal(writer.execute("INSERT INTO runs VALUES ('three')"))


async def impatient(database):
    server_process._PATIENCE_S, patience_s = 0.3, server_process._PATIENCE_S
    holder, writer = await database.holder_and_writer()
    refused = await refusal(writer.execute("INSERT INTO runs VALUES ('two')"))
    server_process._PATIENCE_S = patience_s
    await holder.commit()
    await writer.execute("INSERT INTO runs VALUES ('three')")
    return [refused, *await names(holder)]


async def both_read(database):
    holder, _ = await database.holder_and_writer()
    await holder.commit()
    await asyncio.gather(database.add("one"), database.add("one"), return_exceptions=True)
    return await names(holder)


async def main():
    results = {}
    for case in (dropped, many, stale, impatient, both_read):
        try:
            results[case.__name__] = await case(Database(case.__name__))
        except Exception as error:
            results[case.__name__] = repr(error)
    print(json.dumps(results))


asyncio.run(main())
"""


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, object]:
    """What each case ends with; in a process of its own, since it changes libraries."""
    command = [sys.executable, "-c", CASES, str(tmp_path_factory.mktemp("databases"))]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=240)
    assert ended.returncode == 0, ended.stderr
    return json.loads(ended.stdout)


def test_a_cursor_that_is_dropped_while_its_connection_waits_stops_nothing(results: dict[str, object]) -> None:
    assert results["dropped"] == ["one", "two"]


def test_many_rows_that_waited_are_written_once(results: dict[str, object]) -> None:
    assert results["many"] == ["one", "three", "two"]


def test_what_no_waiting_helps_is_said_at_once(results: dict[str, object]) -> None:
    assert results["stale"] == "SQLITE_BUSY_SNAPSHOT"


def test_one_that_waited_too_long_is_refused_and_may_be_tried_again(results: dict[str, object]) -> None:
    assert results["impatient"] == ["SQLITE_BUSY", "one", "three"]


def test_transactions_that_read_before_they_write_are_not_refused(results: dict[str, object]) -> None:
    assert results["both_read"] == ["one", "one after 1", "one after 2"]
