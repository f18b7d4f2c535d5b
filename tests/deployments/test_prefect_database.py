"""The database of the local server: what removed runs took is given back, while a server goes on and at its start."""

import asyncio
import sqlite3
import threading
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.deployments import prefect_database
from prefect_robomaker.deployments.prefect_database import (
    database_file,
    make_database,
    measure_database,
    prepare_database,
    prepare_servers_database,
    shrink_database,
)
from prefect_robomaker.schemas.settings import Settings

ROWS = 3000


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "prefect.db"


def fill(path: Path, rows: int = ROWS) -> None:
    with closing(sqlite3.connect(path, timeout=60)) as database, database:
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("CREATE TABLE IF NOT EXISTS log (text)")
        database.executemany("INSERT INTO log VALUES (?)", [("x" * 4000,) for _ in range(rows)])


def empty(path: Path) -> None:
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("DELETE FROM log WHERE rowid > 10")


def rows(path: Path) -> int:
    with closing(sqlite3.connect(path)) as database:
        return database.execute("SELECT count(*) FROM log").fetchone()[0]


def test_a_new_database_gives_back_what_was_removed(path: Path) -> None:
    prepare_database(path)
    fill(path)
    empty(path)
    free = measure_database(path).free_bytes
    assert free > 10_000_000

    shrink_database(path)

    assert measure_database(path).free_bytes == 0
    assert path.stat().st_size == measure_database(path).size_bytes < 1_000_000
    assert not path.with_name("prefect.db-wal").exists()  # nobody has it open
    assert rows(path) == 10


def test_one_of_an_earlier_version_is_written_anew_once(path: Path) -> None:
    fill(path)
    empty(path)
    shrink_database(path)
    assert path.stat().st_size > 10_000_000  # a server may have it open

    prepare_database(path)
    assert path.stat().st_size < 1_000_000
    fill(path)
    empty(path)
    shrink_database(path)

    assert path.stat().st_size < 1_000_000
    assert rows(path) == 10


def test_a_server_that_reads_and_writes_goes_on(path: Path) -> None:
    prepare_database(path)
    fill(path)
    empty(path)
    told: list[BaseException] = []
    stop = threading.Event()

    def serve() -> None:
        try:
            with closing(sqlite3.connect(path, timeout=60)) as database:
                while not stop.is_set():
                    with database:
                        database.execute("INSERT INTO log VALUES ('served')")
                    database.execute("SELECT count(*) FROM log").fetchone()
        except BaseException as error:
            told.append(error)

    server = threading.Thread(target=serve)
    server.start()
    try:
        shrink_database(path)
    finally:
        stop.set()
        server.join()

    assert told == []
    assert path.stat().st_size < 2_000_000


def tables(path: Path) -> dict[str, Any]:
    """Columns, keys and indexes of each table, each in an order that does not depend on the order of the steps."""
    with closing(sqlite3.connect(path)) as database:

        def told(pragma: str, name: str) -> list[Any]:
            return sorted((row[1:] for row in database.execute(f"PRAGMA {pragma}('{name}')")), key=repr)

        found: dict[str, Any] = {
            f"{kind} {name}": sql
            for kind, name, sql in database.execute("SELECT type, name, sql FROM sqlite_master WHERE type != 'table'")
        }
        for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall():
            keys = sorted(row[2:] for row in told("foreign_key_list", name))
            found[name] = (database.execute(f"PRAGMA table_info('{name}')").fetchall(), keys, told("index_list", name))
        found["release"] = database.execute("SELECT version_num FROM alembic_version").fetchall()
        return found


@pytest.mark.deep
def test_a_new_database_is_the_one_that_prefects_server_makes(path: Path, tmp_path: Path) -> None:
    from prefect.server.database.dependencies import provide_database_interface
    from prefect.settings import PREFECT_API_DATABASE_CONNECTION_URL, temporary_settings

    prefects = tmp_path / "prefects.db"
    with temporary_settings({PREFECT_API_DATABASE_CONNECTION_URL: f"sqlite+aiosqlite:///{prefects}"}):
        make_database(path)
        assert path.exists()
        assert not list(tmp_path.glob("*.part*"))
        asyncio.run(provide_database_interface().create_db())
    assert tables(path) == tables(prefects)
    assert prepare_database(path) is None  # which would write a database anew that cannot shrink
    assert [file.name for file in tmp_path.glob("prefect.db*")] == ["prefect.db"]


def test_a_database_that_cannot_be_made_is_left_to_the_server(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(unfinished: Path) -> None:
        assert unfinished.exists()
        raise AttributeError("_upgrade_revs")

    monkeypatch.setattr(prefect_database, "_apply_steps", fail)
    make_database(path)
    assert list(path.parent.iterdir()) == []


def test_a_new_database_takes_nothing_from_the_log_of_one_that_was_removed(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = path.with_name("old.db")
    with closing(sqlite3.connect(old)) as database:
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("CREATE TABLE old (text)")
        log = old.with_name("old.db-wal").read_bytes()
    path.with_name(f"{path.name}-wal").write_bytes(log)

    def make(unfinished: Path) -> None:
        with closing(sqlite3.connect(unfinished)) as database, database:
            database.execute("CREATE TABLE new (text)")

    monkeypatch.setattr(prefect_database, "_apply_steps", make)
    make_database(path)
    with closing(sqlite3.connect(path)) as database:
        assert database.execute("SELECT name FROM sqlite_master").fetchall() == [("new",)]


def test_a_database_that_is_there_stays_as_it_is(path: Path) -> None:
    path.write_text("somebody's")
    make_database(path)
    assert path.read_text() == "somebody's"


def test_a_server_with_another_database_gets_no_file(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    path = database_file(settings)
    path.parent.mkdir(parents=True)
    url = "postgresql+asyncpg://somebody@127.0.0.1/prefect"

    prepare_servers_database(settings, {"PREFECT_SERVER_DATABASE_CONNECTION_URL": url})
    assert not path.exists()
    monkeypatch.setattr(prefect_database, "_apply_steps", lambda _: None)
    prepare_servers_database(settings, {})
    assert path.exists()


def test_a_file_that_is_no_database_is_left_to_the_server(settings: Settings) -> None:
    path = database_file(settings)
    path.parent.mkdir(parents=True)
    path.write_bytes(b"no database at all" * 100)

    prepare_servers_database(settings, {})

    assert path.read_bytes() == b"no database at all" * 100


def test_what_is_no_database_is_an_error(path: Path) -> None:
    path.write_bytes(b"no database at all" * 100)

    with pytest.raises(sqlite3.DatabaseError):
        prepare_database(path)
