"""A real PostgreSQL on this machine, started when the first test asks for it, with a folder of its own."""

import os
import pwd
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

import pytest
from sqlalchemy import create_engine, text
from sqlalchemy.pool import NullPool

from helpers.required_programs import missing, needs

_CHANGES_WITHIN_S = 200.0
_STARTS = 3
_SETTINGS = (
    "listen_addresses=127.0.0.1",
    "unix_socket_directories=",  # none: its folder's path may be too long for one
    "max_connections=200",
    # What is committed outlives the server's processes (so `synchronous_commit` stays on), not a power failure.
    "fsync=off",
    "full_page_writes=off",
    "autovacuum=off",
)


def _newest_programs() -> Path | None:
    """The folder of PostgreSQL's programs: Debian keeps each version in one of its own, out of PATH."""
    versions = {
        int(path.parents[1].name): path.parent for path in Path("/usr/lib/postgresql").glob("[0-9]*/bin/initdb")
    }
    found = shutil.which("initdb")
    return versions[max(versions)] if versions else Path(found).resolve().parent if found else None


PROGRAMS = _newest_programs()
_NOT_INSTALLED = "PostgreSQL's server is not installed (Debian's postgresql)"
NEEDS_POSTGRESQL = needs("postgresql", PROGRAMS, _NOT_INSTALLED)
"""Marks tests that need it."""


class PostgresServer:
    """A server that a test may stop, kill and start again: its address and its data stay.

    Args:
        folder: Where its data and its log are; it has to be of `user`.
        programs: The folder of `initdb` and `postgres`.
        user: Name of the user that it runs as; absent: the one that runs the tests.
    """

    def __init__(self, folder: Path, programs: Path, user: str | None) -> None:
        self._folder = folder
        self._programs = programs
        self._user = user
        self._group = None if user is None else pwd.getpwnam(user).pw_gid
        self._process: subprocess.Popen[bytes] | None = None
        self._numbers = count()
        self.port = 0

    def url(self, database: str) -> str:
        """The SQLAlchemy URL of a database."""
        return f"postgresql+psycopg://robomaker@127.0.0.1:{self.port}/{database}"

    @contextmanager
    def new_database(self) -> Iterator[str]:
        """The URL of an empty database; it is removed at the end, also from under those who are still connected."""
        name = f"test_{next(self._numbers)}"
        self.start()
        self._execute(f"CREATE DATABASE {name} TEMPLATE template0")
        try:
            yield self.url(name)
        finally:
            self.start()  # a test may leave it stopped
            self._execute(f"DROP DATABASE {name} WITH (FORCE)")

    def create(self) -> None:
        """Makes the data of a server without databases. Everybody on this machine may connect as its one user."""
        command = [self._programs / "initdb", "--pgdata", self._data, "--username", "robomaker", "--auth", "trust"]
        command += ["--encoding", "UTF8", "--no-sync", "--no-instructions"]
        # Sorts text as people do and no byte order does, wherever tests run: what relies on the latter is found.
        command += ["--locale", "C", "--locale-provider", "icu", "--icu-locale", "en-US"]
        made = subprocess.run(
            command,
            cwd=self._folder,
            capture_output=True,
            text=True,
            user=self._user,
            group=self._group,
            extra_groups=None if self._user is None else [],
        )
        if made.returncode:
            raise RuntimeError(f"initdb fails: {made.stdout[-1000:]}\n{made.stderr[-2000:]}")

    def start(self) -> None:
        """Starts it unless it runs, and waits until it answers. The first start chooses its port."""
        if self._process is not None:
            return
        for _ in range(1 if self.port else _STARTS):
            port = self.port or _free_port()
            self._process = self._launched(port)
            if self._is_ready(self._process):
                self.port = port
                return
            self.kill()  # most likely somebody took the port
        raise RuntimeError(f"PostgreSQL does not start; its log is:\n{self._log.read_text()[-4000:]}")

    def stop(self) -> None:
        """Ends it in order: what is not committed is undone, connections are closed."""
        self._end(signal.SIGINT)

    def kill(self) -> None:
        """Ends it where it stands, as a crash would: connections break, the next start reads what was committed."""
        self._end(signal.SIGQUIT)

    def restart(self) -> None:
        """Stops it in order if it runs, and starts it."""
        self.stop()
        self.start()

    def _end(self, how: signal.Signals) -> None:
        if self._process is not None:
            self._process.send_signal(how)  # it ends its other processes, which have groups of their own
            self._process.wait(_CHANGES_WITHIN_S)
            self._process = None

    @property
    def _data(self) -> Path:
        return self._folder / "data"

    @property
    def _log(self) -> Path:
        return self._folder / "log"

    def _launched(self, port: int) -> subprocess.Popen[bytes]:
        settings = [word for setting in (*_SETTINGS, f"port={port}") for word in ("-c", setting)]
        command = [str(self._programs / "postgres"), "-D", str(self._data), *settings]
        with self._log.open("ab") as log:
            return subprocess.Popen(
                command,
                cwd=self._folder,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
                user=self._user,
                group=self._group,
                extra_groups=None if self._user is None else [],
            )

    def _is_ready(self, process: subprocess.Popen[bytes]) -> bool:
        """Waits for what the server itself notes when it takes connections: another's on this port does not count."""
        deadline = time.monotonic() + _CHANGES_WITHIN_S
        while process.poll() is None and time.monotonic() < deadline:
            with suppress(FileNotFoundError):
                noted = (self._data / "postmaster.pid").read_text().split()
                if noted[:1] == [str(process.pid)] and noted[-1] == "ready":
                    return True
            time.sleep(0.02)
        return False

    def _execute(self, statement: str) -> None:
        engine = create_engine(self.url("postgres"), isolation_level="AUTOCOMMIT", poolclass=NullPool)
        with engine.connect() as connection:
            connection.execute(text(statement))


@pytest.fixture(scope="session")
def postgres_server() -> Iterator[PostgresServer]:
    """A server for this test process; every xdist worker has its own. Tests make databases of their own."""
    if PROGRAMS is None:
        missing("postgresql", _NOT_INSTALLED)
    # Not below pytest's folders: those are root's, and PostgreSQL refuses to run as root.
    folder = Path(tempfile.mkdtemp(prefix="robomaker-postgresql-"))
    user = somebody() if os.geteuid() == 0 else None
    if user is not None:
        shutil.chown(folder, user)
    server = PostgresServer(folder, PROGRAMS, user)
    try:
        server.create()
        server.start()
        yield server
    finally:
        server.kill()
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture
def postgres_database(postgres_server: PostgresServer) -> Iterator[str]:
    """The URL of an empty database for one test."""
    with postgres_server.new_database() as url:
        yield url


def somebody() -> str:
    """A user that is not root: Debian's package brings `postgres`, every system has `nobody`."""
    there = {entry.pw_name for entry in pwd.getpwall()}
    return "postgres" if "postgres" in there else "nobody"


def _free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]
