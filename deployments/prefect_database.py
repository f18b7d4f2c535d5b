"""The file of the local Prefect server's database, which gives back to the system what removed runs took.

SQLite keeps the pages that are free, and uses them again. A file that is made with `auto_vacuum` can give them back in
small steps while the server works; one of an earlier version is written anew, once, when no server runs.
"""

import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from ..schemas.settings import Settings

_ELSEWHERE = {"PREFECT_SERVER_DATABASE_CONNECTION_URL", "PREFECT_API_DATABASE_CONNECTION_URL"}
_INCREMENTAL = 2
_STEP_PAGES = 500
"""How many pages are given back at once; the server waits for the lock meanwhile, some milliseconds."""
_PATIENCE_S = 30.0
WORTH_BYTES = 1_000_000
"""Less than this is left free: the next run needs it."""


@dataclass(frozen=True)
class DatabaseSize:
    """How large the file is."""

    size_bytes: int
    free_bytes: int
    """Size of the unused pages, in bytes."""


def database_file(settings: Settings) -> Path:
    """Path of the Prefect server's database in a data home, unless the server's environment names another."""
    return settings.home / "prefect" / "prefect.db"


def prepare_servers_database(settings: Settings, environ: Mapping[str, str]) -> None:
    """Prepares the database of the server that is about to start, unless its environment names another.

    Args:
        settings: the data home's.
        environ: the server's environment variables.
    """
    if not _ELSEWHERE & environ.keys():
        with suppress(sqlite3.Error):  # the server itself tells what is wrong with it
            prepare_database(database_file(settings))


def prepare_database(path: Path) -> None:
    """Has a database able to shrink: makes a new file so, and writes an older one anew; no server may have it open.

    Raises:
        sqlite3.Error: the file cannot be written, or is no database; the server says what is wrong with it.
    """
    with _opened(path) as database:
        if _number(database, "auto_vacuum") != _INCREMENTAL:
            database.execute(f"PRAGMA auto_vacuum = {_INCREMENTAL}")
            if _number(database, "page_count"):
                database.execute("VACUUM")
            database.execute("PRAGMA journal_mode = WAL")  # as the server has it; a new file keeps both


def measure_database(path: Path) -> DatabaseSize:
    """How large a database is, and how much of it is free.

    Raises:
        sqlite3.Error: it cannot be read.
    """
    with _opened(path) as database:
        size = _number(database, "page_size")
        return DatabaseSize(_number(database, "page_count") * size, _number(database, "freelist_count") * size)


def shrink_database(path: Path) -> None:
    """Gives back the pages that nothing uses, step by step; a server may go on meanwhile.

    A database of an earlier version stays as it is until it is prepared.

    Raises:
        sqlite3.Error: it cannot be written, or others write all the time.
    """
    with _opened(path) as database:
        if _number(database, "auto_vacuum") != _INCREMENTAL:
            return
        left = _number(database, "freelist_count")
        while left:
            database.executescript(f"PRAGMA incremental_vacuum({_STEP_PAGES})")
            before, left = left, _number(database, "freelist_count")
            if left >= before:  # others remove more
                break
        database.execute("PRAGMA wal_checkpoint(TRUNCATE)")


@contextmanager
def _opened(path: Path) -> Iterator[sqlite3.Connection]:
    with closing(sqlite3.connect(path, timeout=_PATIENCE_S, isolation_level=None)) as database:
        yield database


def _number(database: sqlite3.Connection, pragma: str) -> int:
    return int(database.execute(f"PRAGMA {pragma}").fetchone()[0])
