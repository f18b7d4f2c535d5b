"""`robomaker serve` as a process of its own, and calls over HTTP without an SDK."""

import json
import subprocess
import sys
import urllib.request
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from helpers.processes import started, wait_for
from prefect_robomaker.tasks.service.service import Service

COMMAND = [sys.executable, "-m", "prefect_robomaker.deployments.cli.main", "serve", "--port", "0", "-o", "json"]


@dataclass(frozen=True)
class Endpoint:
    """An endpoint that answers: what it said of itself, and the file with its log."""

    facts: Mapping[str, Any]
    log: Path

    @property
    def url(self) -> str:
        """Where it answers."""
        return self.facts["url"]

    def call(self, operation: str, request: Mapping[str, Any]) -> dict[str, Any]:
        """Calls an operation as SDKs do."""
        path = operation[0].lower() + operation[1:]
        headers = {"Content-Type": "application/json"}
        message = urllib.request.Request(f"{self.url}/{path}", json.dumps(request).encode(), headers)
        with urllib.request.urlopen(message, timeout=200) as answer:
            return json.load(answer)

    def worker(self) -> dict[str, Any]:
        """What the health page says of the job worker."""
        with urllib.request.urlopen(f"{self.url}/health", timeout=200) as answer:
            return json.load(answer)["performer"]


@dataclass(frozen=True)
class Served(Endpoint):
    """A running `robomaker serve`."""

    process: subprocess.Popen[str]

    def wait_until_ready(self) -> int:
        """Waits until jobs are performed; returns the job worker's process id."""
        wait_for(lambda: self.worker()["state"] == "ready", f"a ready job worker; {self.log.read_text()}")
        return self.worker()["pid"]


Serve = Callable[..., AbstractContextManager[Served]]


@contextmanager
def serving(home: Path, folder: Path, *words: str, **variables: str) -> Iterator[Served]:
    """Starts `robomaker serve` on a data home; its log and Prefect's files go to a folder.

    Args:
        home: The data home.
        folder: Where the log and Prefect's files go.
        *words: Further words of the command line.
        **variables: Environment variables.
    """
    environ = {"ROBOMAKER_HOME": str(home), "PREFECT_HOME": str(folder / "prefect"), **variables}
    log = folder / f"serve-{len(list(folder.glob('serve-*')))}.log"
    with (
        log.open("w") as errors,
        started([*COMMAND, *words], environ, stdout=subprocess.PIPE, stderr=errors) as process,
    ):
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line, log.read_text()
        yield Served(json.loads(line), log, process)


@pytest.fixture
def serve(service: Service, tmp_path: Path) -> Serve:
    """Starts `robomaker serve` on the test's service; keyword arguments are environment variables."""
    return partial(serving, service.settings.home, tmp_path)
