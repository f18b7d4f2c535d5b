"""One Prefect server for the whole test run, started when the first test asks for it.

An empty database takes a server 10 s of CPU, so that one that was just made is kept in pytest's cache folder.
"""

import fcntl
import os
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import certifi
import pytest

from helpers.server_log import tracebacks, where_it_was_stuck
from prefect_robomaker.deployments.prefect_server.local_server import ensure_server, stop_server
from prefect_robomaker.deployments.prefect_server.secret import auth_string, server_folder
from prefect_robomaker.schemas.settings import Settings

_HOME = "ROBOMAKER_TEST_SERVER_HOME"
_MADE = "ROBOMAKER_TEST_SERVER_MADE"
_DATABASE = "prefect.db"
_KNOWN_BLOCKS = "memo_store.toml"
"""Registrations that a server of the same release need not repeat."""


def server_settings() -> Settings:
    """Settings whose local server is the one of this test run, whichever worker asks."""
    return Settings.from_environment({"ROBOMAKER_HOME": os.environ[_HOME]})


def pytest_configure(config: pytest.Config) -> None:
    """Chooses the server's folder before workers are started, so that all inherit it."""
    if not hasattr(config, "workerinput"):
        os.environ[_HOME] = tempfile.mkdtemp(prefix="robomaker-test-")
        cache: pytest.Cache | None = getattr(config, "cache", None)  # none with `-p no:cacheprovider`
        place = Path(os.environ[_HOME]) if cache is None else cache.mkdir("robomaker-prefect")
        os.environ[_MADE] = str(place / f"made-{version('prefect')}")


def pytest_unconfigure(config: pytest.Config) -> None:
    """Stops the server when the last worker is done."""
    if not hasattr(config, "workerinput"):
        stop_server(server_settings())
        log = server_settings().home / "prefect" / "server.log"
        if log.exists() and (stuck := where_it_was_stuck(log.read_text(errors="replace"))):
            print(f"The tests' Prefect server was stuck for a while:\n{stuck}")
        shutil.rmtree(Path(os.environ.pop(_HOME)), ignore_errors=True)


def provide_tables(folder: Path) -> None:
    """Puts an empty database where a Prefect server is to be started, if there is none and one was made before.

    Args:
        folder: The server's `PREFECT_HOME`.
    """
    made = Path(os.environ[_MADE])
    if made.is_dir() and not (folder / _DATABASE).exists():
        shutil.copytree(made, folder, dirs_exist_ok=True)


def _keep_tables(folder: Path) -> None:
    """Keeps the database of a server that nobody has used yet."""
    made = Path(os.environ[_MADE])
    if made.is_dir():
        return
    kept = Path(tempfile.mkdtemp(dir=made.parent))
    with (
        closing(sqlite3.connect(folder / _DATABASE, timeout=60)) as database,
        closing(sqlite3.connect(kept / _DATABASE)) as copy,
    ):
        database.backup(copy)
    if (folder / _KNOWN_BLOCKS).exists():
        shutil.copy(folder / _KNOWN_BLOCKS, kept)
    try:
        kept.rename(made)
    except OSError:  # another run of tests has kept one meanwhile
        shutil.rmtree(kept)


@contextmanager
def _one_at_a_time() -> Iterator[None]:
    """Keeps other workers from using the server before its database is kept."""
    with Path(os.environ[_HOME], "starts").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _one_certificate() -> Path:
    """A file with one certificate: each client of Prefect reads all of them, 20 ms, also to speak plain HTTP."""
    path = server_settings().home / "certificate.pem"
    if not path.exists():
        first = Path(certifi.where()).read_text().partition("-----END CERTIFICATE-----")
        path.write_text("".join(first[:2]) + "\n")
    return path


@pytest.fixture(scope="session")
def prefect_server() -> Iterator[str]:
    """API URL of the test run's own Prefect server; Prefect in this process uses it meanwhile."""
    from prefect.settings import (
        PREFECT_API_AUTH_STRING,
        PREFECT_API_SSL_CERT_FILE,
        PREFECT_API_URL,
        PREFECT_FLOWS_HEARTBEAT_FREQUENCY,
        PREFECT_LOGGING_TO_API_ENABLED,
        temporary_settings,
    )

    with _one_at_a_time():
        provide_tables(server_folder(server_settings()))
        url = ensure_server(server_settings(), {})
        _keep_tables(server_folder(server_settings()))
    # Logs are sent in the background, and would still be on their way when the server stops.
    secret = auth_string(server_settings())
    chosen: dict[Any, Any] = {
        PREFECT_API_URL: url,
        PREFECT_API_AUTH_STRING: secret,
        PREFECT_FLOWS_HEARTBEAT_FREQUENCY: None,
        PREFECT_LOGGING_TO_API_ENABLED: False,
        PREFECT_API_SSL_CERT_FILE: str(_one_certificate()),
    }
    with temporary_settings(chosen), pytest.MonkeyPatch.context() as patch:
        # Processes of tests get the server by PREFECT_API_URL, its secret and the certificate by inheritance.
        patch.setenv("PREFECT_API_AUTH_STRING", secret)
        patch.setenv("PREFECT_API_SSL_CERT_FILE", str(_one_certificate()))
        yield url
    assert not tracebacks((server_settings().home / "prefect" / "server.log").read_text(errors="replace"))
