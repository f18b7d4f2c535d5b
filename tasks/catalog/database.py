"""Opens the catalog's database: connections, transactions, migrations."""

import os
import re
import sqlite3
import weakref
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from sqlalchemy import URL, Connection, Engine, create_engine, event, func, insert, make_url, select, text
from sqlalchemy.exc import ArgumentError, DBAPIError, NoSuchModuleError, OperationalError

from ...schemas.wings import parts_of_wings
from ...schemas.wire.errors import CatalogAwayError, ConfigurationError
from .tables import metadata, schema_version

_BUSY_TIMEOUT_S = 30.0
_NOT_YET = ("starting up", "shutting down", "in recovery", "too many clients")
_NO_SUCH_HOST = "Name or service not known"
_MIGRATION_LOCK = 0x0B07  # any number, the same for all programs that use this catalog


FIRST_VERSION = 8
"""Schema version of new catalogs; lower versions belong to states of this program before its first release."""

MIGRATIONS: tuple[Callable[[Connection], None], ...] = ()
"""Migrations, each of which updates the tables by one version from `FIRST_VERSION` on.

Later ones are added at the end and never change. A new catalog has the latest tables already, so a migration must check
which parts exist.
"""


def open_engine(url: str) -> Engine:
    """Connects to a catalog's database, updates its tables to this release, and returns its engine.

    Raises:
        CatalogAwayError: The database's server is away, or has not started or ended yet.
        ConfigurationError: The URL leads nowhere, a driver is missing, or a newer program made the
            database.
    """
    engine = _connect(_checked(url))
    try:
        with writing(engine).begin() as connection:
            _migrate(connection)
    except DBAPIError as error:
        engine.dispose()
        kind = CatalogAwayError if _is_away(engine, error) else ConfigurationError
        raise kind(f"the catalog {engine.url!r} cannot be opened: {error.orig}") from error
    except ConfigurationError:
        engine.dispose()
        raise
    _reopen_after_fork(engine)
    return engine


def _is_away(engine: Engine, error: DBAPIError) -> bool:
    """Whether a database server did not answer, or is starting or shutting down; other errors are not retried."""
    said = str(error.orig)
    answered = "FATAL:" in said and not any(words in said for words in _NOT_YET)
    return isinstance(error, OperationalError) and engine.dialect.name != "sqlite" and not (
        answered or _NO_SUCH_HOST in said
    )  # fmt: skip


def writing(engine: Engine) -> Engine:
    """Returns the database engine with transactions that take SQLite's write lock when they begin.

    SQLite refuses, without waiting, to turn a transaction that has read into one that writes when
    another has written in between. Taking the lock first waits instead.
    """
    return engine.execution_options(catalog_writes=True)


def reading_once(engine: Engine) -> Engine:
    """Returns a view of the database engine without transactions, for single read statements: faster with SQLite."""
    return engine.execution_options(catalog_reads_once=True)


def _checked(url: str) -> URL:
    try:
        parsed = make_url(url)
    except ArgumentError as error:
        shown = re.sub("//[^/]*@", "//…@", url)  # without a password
        raise ConfigurationError(
            f"the catalog URL {shown!r} is no database URL; write sqlite:////path/to/catalog.db or postgresql://…"
        ) from error
    if parsed.get_backend_name() == "sqlite":
        if parsed.database in (None, "", ":memory:"):
            raise ConfigurationError(f"the catalog URL {url!r} names no file; write sqlite:////path/to/catalog.db")
        # SQLAlchemy 2.0 leaves the path as it is quoted in the URL.
        parsed = parsed.set(database=unquote(str(parsed.database)))
        _make_file(Path(str(parsed.database)))
    return parsed


def _make_file(path: Path) -> None:
    """Creates an empty database file that only its user may read, as SQLite's files beside it will be.

    An existing file is kept.
    """
    path.parent.mkdir(0o700, parents=True, exist_ok=True)
    # One that is there is not even opened: to close it would let go of the locks that this process's connections to it
    # hold, and the next one to close would take itself for the last, and remove what the others write to.
    with suppress(OSError):  # opening it says what is wrong
        os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_RDWR | os.O_CLOEXEC, 0o600))


def _connect(url: URL) -> Engine:
    is_sqlite = url.get_backend_name() == "sqlite"
    try:
        engine = (
            create_engine(url, connect_args={"timeout": _BUSY_TIMEOUT_S})
            if is_sqlite
            # Connections that are kept break when the server restarts: each is tried before it is used again.
            else create_engine(url, pool_pre_ping=True)
        )
    except (ModuleNotFoundError, NoSuchModuleError) as error:
        raise ConfigurationError(
            f"the catalog URL {url!r} needs a driver that is not installed ({error}); "
            "for PostgreSQL install psycopg[binary] and write postgresql+psycopg://…"
        ) from error
    if is_sqlite:
        event.listen(engine, "connect", _configure_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
    return engine


def _configure_sqlite(connection: sqlite3.Connection, _record: Any) -> None:
    connection.isolation_level = None  # the driver begins no transactions; `_begin_sqlite` does
    for pragma in (
        "journal_mode = WAL",  # readers and one writer do not wait for each other
        "synchronous = NORMAL",  # a crash of the machine may undo the last commits, never damage the file
        "foreign_keys = ON",
    ):
        connection.execute(f"PRAGMA {pragma}")


def _begin_sqlite(connection: Connection) -> None:
    options = connection.get_execution_options()
    if not options.get("catalog_reads_once", False):
        connection.exec_driver_sql("BEGIN IMMEDIATE" if options.get("catalog_writes", False) else "BEGIN")


def _migrate(connection: Connection) -> None:
    if connection.dialect.name == "postgresql":
        connection.execute(text("SELECT pg_advisory_xact_lock(:lock)"), {"lock": _MIGRATION_LOCK})
    schema_version.create(connection, checkfirst=True)
    version, newest = connection.scalar(select(func.max(schema_version.c.version))), FIRST_VERSION + len(MIGRATIONS)
    of_wings = [table for part in parts_of_wings("tasks", "tables") for table in part.TABLES]
    if version is None:
        metadata.create_all(connection)
        version = FIRST_VERSION
        connection.execute(insert(schema_version).values(version=version))
    if version > newest:
        raise ConfigurationError(
            f"the catalog {connection.engine.url!r} has version {version}, this program knows {newest}; "
            "update this program or use another catalog"
        )
    if version < FIRST_VERSION:
        raise ConfigurationError(
            f"the catalog {connection.engine.url!r} has version {version}, of a state before the first release; keep "
            "it for the program that made it, and use another catalog (ROBOMAKER_HOME or ROBOMAKER_CATALOG_URL)"
        )
    for number, migration in enumerate(MIGRATIONS[version - FIRST_VERSION :], version + 1):
        migration(connection)
        connection.execute(insert(schema_version).values(version=number))
    metadata.create_all(connection, of_wings)  # the catalog may have been made where a wing was missing


def _reopen_after_fork(engine: Engine) -> None:
    """Makes forked children open connections of their own: SQLite's must not be shared."""
    reference = weakref.ref(engine)

    def forget() -> None:
        if (inherited := reference()) is not None:
            inherited.dispose(close=False)

    os.register_at_fork(after_in_child=forget)
