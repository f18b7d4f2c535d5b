"""One Prefect server for the whole test run, started when the first test asks for it."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from helpers.server_log import tracebacks, where_it_was_stuck
from prefect_robomaker.deployments.prefect_server.local_server import ensure_server, stop_server
from prefect_robomaker.deployments.prefect_server.secret import auth_string
from prefect_robomaker.schemas.settings import Settings

_HOME = "ROBOMAKER_TEST_SERVER_HOME"


def server_settings() -> Settings:
    """Settings whose local server is the one of this test run, whichever worker asks."""
    return Settings.from_environment({"ROBOMAKER_HOME": os.environ[_HOME]})


def pytest_configure(config: pytest.Config) -> None:
    """Chooses the server's folder before workers are started, so that all inherit it."""
    if not hasattr(config, "workerinput"):
        os.environ[_HOME] = tempfile.mkdtemp(prefix="robomaker-test-")


def pytest_unconfigure(config: pytest.Config) -> None:
    """Stops the server when the last worker is done."""
    if not hasattr(config, "workerinput"):
        stop_server(server_settings())
        log = server_settings().home / "prefect" / "server.log"
        if log.exists() and (stuck := where_it_was_stuck(log.read_text(errors="replace"))):
            print(f"The tests' Prefect server was stuck for a while:\n{stuck}")
        shutil.rmtree(Path(os.environ.pop(_HOME)), ignore_errors=True)


@pytest.fixture(scope="session")
def prefect_server() -> Iterator[str]:
    """API URL of the test run's own Prefect server; Prefect in this process uses it meanwhile."""
    from prefect.settings import (
        PREFECT_API_AUTH_STRING,
        PREFECT_API_URL,
        PREFECT_FLOWS_HEARTBEAT_FREQUENCY,
        PREFECT_LOGGING_TO_API_ENABLED,
        temporary_settings,
    )

    url = ensure_server(server_settings(), {})
    # Logs are sent in the background, and would still be on their way when the server stops.
    secret = auth_string(server_settings())
    chosen: dict[Any, Any] = {
        PREFECT_API_URL: url,
        PREFECT_API_AUTH_STRING: secret,
        PREFECT_FLOWS_HEARTBEAT_FREQUENCY: None,
        PREFECT_LOGGING_TO_API_ENABLED: False,
    }
    with temporary_settings(chosen), pytest.MonkeyPatch.context() as patch:
        # Processes of tests get the server by PREFECT_API_URL, and its secret by inheritance.
        patch.setenv("PREFECT_API_AUTH_STRING", secret)
        yield url
    assert not tracebacks((server_settings().home / "prefect" / "server.log").read_text(errors="replace"))
