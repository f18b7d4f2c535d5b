"""The database of the local server: what removed runs took is given back, while a server goes on and at its start."""

import sqlite3
import threading
from contextlib import closing
from pathlib import Path

import pytest

from prefect_robomaker.deployments.prefect_database import (
    database_file,
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


def test_a_server_with_another_database_gets_no_file(settings: Settings) -> None:
    path = database_file(settings)
    path.parent.mkdir(parents=True)
    url = "postgresql+asyncpg://somebody@127.0.0.1/prefect"

    prepare_servers_database(settings, {"PREFECT_SERVER_DATABASE_CONNECTION_URL": url})
    assert not path.exists()
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
