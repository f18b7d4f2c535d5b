"""Database file of the local Prefect server: creates it quickly, and returns the space of deleted runs to the disk.

SQLite keeps the pages that are free, and uses them again. A file that is made with `auto_vacuum` can give them back in
small steps while the server works; another one is written anew, once, when no server runs.

Prefect's server changes an empty database in a hundred steps into that of its release. Each of the 34,000 statements
goes through an event loop and two threads there, which costs 5.5 s of CPU in all; over a connection of one thread the
same steps cost 2.4 s. The server looks at the tables whenever it starts, and makes those that are missing.
"""

import json
import logging
import sqlite3
import warnings
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..schemas.settings import Settings

_ELSEWHERE = {"PREFECT_SERVER_DATABASE_CONNECTION_URL", "PREFECT_API_DATABASE_CONNECTION_URL"}
_INCREMENTAL = 2
_logger = logging.getLogger(__name__)
_STEP_PAGES = 500
"""Number of database pages freed at once; the server waits for the lock meanwhile, some milliseconds."""
_PATIENCE_S = 30.0
WORTH_BYTES = 1_000_000
"""Unused bytes below which a database file is not shrunk, as the next run needs them."""


@dataclass(frozen=True)
class DatabaseSize:
    """Size of the Prefect server's database file, and its unused part, in bytes."""

    size_bytes: int
    free_bytes: int
    """Size of a database's unused pages, in bytes."""


def database_file(settings: Settings) -> Path:
    """Returns the path of the Prefect server's database in a data home."""
    return settings.home / "prefect" / "prefect.db"


def prepare_servers_database(settings: Settings, environ: Mapping[str, str]) -> None:
    """Prepares the Prefect server's database before the server starts.

    Imports Prefect, whose settings have to be there.

    Args:
        settings: The data home's.
        environ: The server's environment variables.
    """
    if not _ELSEWHERE & environ.keys():
        path = database_file(settings)
        make_database(path)
        with suppress(sqlite3.Error):  # the server itself tells what is wrong with it
            prepare_database(path)


def make_database(path: Path) -> None:
    """Creates the Prefect database quickly, with the tables of the installed release.

    Where Prefect's steps cannot be applied this way, as with a release that arranges them otherwise, no file is left,
    and the server makes it.
    """
    if path.exists():
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f"{path.name}.part")
    for ending in ("", "-wal", "-shm", "-journal"):  # SQLite would apply what a removed database left to the new one
        unfinished.with_name(unfinished.name + ending).unlink(missing_ok=True)
        path.with_name(path.name + ending).unlink(missing_ok=True)
    try:
        prepare_database(unfinished)
        _apply_steps(unfinished)
        unfinished.rename(path)
    except Exception:  # the server tells what is wrong, if it finds the same
        _logger.warning("the Prefect server makes its database itself, which takes longer", exc_info=True)
        for name in path.parent.glob(f"{unfinished.name}*"):
            name.unlink(missing_ok=True)


def prepare_database(path: Path) -> None:
    """Makes a SQLite database able to shrink (incremental vacuum).

    Raises:
        sqlite3.Error: The file cannot be written, or is no database; the server says what is wrong with it.
    """
    with _opened(path) as database:
        if _number(database, "auto_vacuum") != _INCREMENTAL:
            database.execute(f"PRAGMA auto_vacuum = {_INCREMENTAL}")
            if _number(database, "page_count"):
                database.execute("VACUUM")
            database.execute("PRAGMA journal_mode = WAL")  # as the server has it; a new file keeps both


def measure_database(path: Path) -> DatabaseSize:
    """Measures the size of a SQLite database and its unused part.

    Raises:
        sqlite3.Error: It cannot be read.
    """
    with _opened(path) as database:
        size = _number(database, "page_size")
        return DatabaseSize(_number(database, "page_count") * size, _number(database, "freelist_count") * size)


def read_deployments(path: Path) -> list[tuple[str, str, list[dict[str, Any]]]]:
    """Reads the deployments in the Prefect server's database, whether the server runs or not.

    Args:
        path: Path of the database.

    Returns:
        Of each its flow's name, its own name, and its parameters: first its own, then those of each schedule.

    Raises:
        sqlite3.Error: It cannot be read, or its release arranges deployments otherwise.
    """
    with _opened(path) as database:
        found = database.execute(
            "SELECT flow.name, deployment.name, deployment.parameters, deployment.id FROM deployment "
            "JOIN flow ON flow.id = deployment.flow_id ORDER BY flow.name, deployment.name"
        ).fetchall()
        scheduled: dict[str, list[dict[str, Any]]] = {}
        for deployment, parameters in database.execute("SELECT deployment_id, parameters FROM deployment_schedule"):
            scheduled.setdefault(deployment, []).append(json.loads(parameters or "{}"))
    return [
        (flow, name, [json.loads(parameters or "{}"), *scheduled.get(deployment, ())])
        for flow, name, parameters, deployment in found
    ]


def shrink_database(path: Path) -> None:
    """Returns unused pages of a SQLite database to the disk, in steps, while a server uses it.

    A database of an earlier version stays as it is until it is prepared.

    Raises:
        sqlite3.Error: It cannot be written, or others write all the time.
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


def _apply_steps(path: Path) -> None:
    """Applies Prefect's migrations to its SQLite database as its `_migrations/env.py` does, and leaves one file."""
    import sqlalchemy
    from alembic.runtime.environment import EnvironmentContext
    from alembic.script import ScriptDirectory
    from prefect.server.database.alembic_commands import alembic_config
    from prefect.server.database.dependencies import provide_database_interface

    interface, config = provide_database_interface(), alembic_config()
    script = ScriptDirectory.from_config(config)
    script.version_locations = [str(interface.orm.versions_dir)]

    def to_newest(revision: Any, _: Any) -> Any:
        return script._upgrade_revs("head", revision)  # pyright: ignore[reportPrivateUsage]

    engine = sqlalchemy.create_engine(f"sqlite:///{path}")
    try:
        with engine.connect() as connection, EnvironmentContext(config, script, fn=to_newest) as environment:
            environment.configure(
                connection=connection,
                target_metadata=interface.Base.metadata,
                include_schemas=True,
                render_as_batch=True,
                transaction_per_migration=True,
                template_args={"dialect": "sqlite"},
            )
            with warnings.catch_warnings(), environment.begin_transaction():
                warnings.simplefilter("ignore")  # that indexes by an expression are not looked at
                environment.run_migrations()
    finally:
        engine.dispose()  # the last connection to close puts what is in SQLite's log into the file


@contextmanager
def _opened(path: Path) -> Iterator[sqlite3.Connection]:
    with closing(sqlite3.connect(path, timeout=_PATIENCE_S, isolation_level=None)) as database:
        yield database


def _number(database: sqlite3.Connection, pragma: str) -> int:
    return int(database.execute(f"PRAGMA {pragma}").fetchone()[0])
