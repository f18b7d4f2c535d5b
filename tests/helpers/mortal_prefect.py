"""A Prefect server that a test kills, and brings back at the address it had."""

import os
import signal
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from helpers.prefect_server import provide_tables
from prefect_robomaker.deployments.prefect_server.local_server import ensure_server, server_status, stop_server
from prefect_robomaker.deployments.prefect_server.secret import auth_string, server_folder
from prefect_robomaker.schemas.settings import Settings

_NO_PROFILE = {"PREFECT_PROFILES_PATH": "/nowhere"}


class MortalPrefectServer:
    """A Prefect server of a test's own.

    Args:
        home: Where it keeps its database.
    """

    def __init__(self, home: Path) -> None:
        self._settings = Settings.from_environment({"ROBOMAKER_HOME": str(home)})
        provide_tables(server_folder(self._settings))
        url = ensure_server(self._settings, _NO_PROFILE)
        self.variables = {"PREFECT_API_URL": url, "PREFECT_API_AUTH_STRING": auth_string(self._settings)}

    def die(self) -> None:
        """Kills it."""
        pid = server_status(self._settings, _NO_PROFILE).pid
        assert pid is not None
        with suppress(ProcessLookupError):
            os.killpg(pid, signal.SIGKILL)

    def kill(self) -> None:
        """Kills it and starts it again."""
        self.die()
        assert ensure_server(self._settings, _NO_PROFILE) == self.variables["PREFECT_API_URL"]

    def stop(self) -> None:
        """Ends it for good."""
        stop_server(self._settings)


@pytest.fixture
def mortal_prefect(tmp_path: Path) -> Iterator[MortalPrefectServer]:
    """A Prefect server that a test may kill."""
    server = MortalPrefectServer(tmp_path / "prefect")
    yield server
    server.stop()
