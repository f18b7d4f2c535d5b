"""The command `robomaker` in this process, with a data home of its own: a tenth of what a process costs.

Signals, streams and what a process leaves behind are seen with processes of the command.
"""

import logging
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from prefect_robomaker.deployments.cli import prefect_server as cli_prefect_server
from prefect_robomaker.deployments.cli.main import main
from prefect_robomaker.deployments.prefect_server.local_server import stop_server
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.execution.run_watch import WATCH


@dataclass(frozen=True)
class Outcome:
    """Output and exit code of a command."""

    code: int
    out: str
    err: str


Command = Callable[..., Outcome]


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """The data home."""
    return tmp_path / "home"


@pytest.fixture
def robomaker(home: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Iterator[Command]:
    """Runs `robomaker` with the given words."""
    before = dict(os.environ)
    for name in ("ROBOMAKER_DEBUG", "GITHUB_ACTIONS", "PREFECT_API_URL", "ROBOMAKER_CATALOG_URL"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("ROBOMAKER_HOME", str(home))
    monkeypatch.setenv("CI", "true")

    def run(*words: object) -> Outcome:
        try:
            code = main([str(word) for word in words])
        except SystemExit as end:
            code = int(end.code or 0)
        out, err = capsys.readouterr()
        return Outcome(code, out, err)

    yield run
    if (home / "prefect").exists():
        was_running = stop_server(Settings.from_environment({"ROBOMAKER_HOME": str(home)}))
        assert not was_running, "a command started a server that stays; give it that of `prefect_server`"
    # Commands tell Prefect by variables where its server is.
    os.environ.clear()
    os.environ.update(before)


@pytest.fixture
def robomaker_at_server(robomaker: Command, prefect_server: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[Command]:
    """Runs `robomaker` with the given words at the test run's Prefect server: what a command changes ends with it."""
    monkeypatch.setenv("PREFECT_API_URL", prefect_server)
    logger = logging.getLogger("prefect_robomaker")
    monkeypatch.setattr(logger, "handlers", logger.handlers)
    monkeypatch.setattr(logger, "propagate", logger.propagate)
    monkeypatch.setattr(WATCH, "tells_of_silence", WATCH.tells_of_silence)
    patiences: list[Any] = []
    monkeypatch.setattr(cli_prefect_server, "_FOR_EVER", patiences)
    level = logger.level
    yield robomaker
    for patience in reversed(patiences):
        patience.__exit__(None, None, None)
    logger.setLevel(level)
