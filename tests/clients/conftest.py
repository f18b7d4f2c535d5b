"""One served process tree for all clients of a test run, and what they ask it for."""

import fcntl
import itertools
import json
import os
import shutil
import signal
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import pytest
from helpers.client_environments import python_environment
from helpers.endpoint_process import COMMAND, Endpoint, Served
from helpers.made_once import locked, shared_folder
from helpers.paths import BUNDLES
from helpers.processes import alive, wait_for
from helpers.small_flat import BODY, ROLE

from prefect_robomaker.tasks.storage import pack_tar_gz

_numbers = itertools.count(1)
_started: list[subprocess.Popen[str]] = []
"""Processes that this worker started; others may use them for longer than this worker lives."""


@dataclass(frozen=True)
class Place:
    """A running `robomaker serve`, and the folder that is its object store."""

    served: Endpoint
    objects: Path

    @property
    def environ(self) -> dict[str, str]:
        """What it tells clients to set."""
        return dict(self.served.facts["environment"])


@pytest.fixture(scope="session")
def place(tmp_path_factory: pytest.TempPathFactory, prefect_server: str) -> Iterator[Place]:
    """The served process tree, with an application to run in its object store.

    The first worker that needs it starts it, which takes longer than most clients; the last one that leaves ends it.
    """
    shared = shared_folder(tmp_path_factory)
    folder, lock = shared / "clients", shared / "clients.lock"
    log, told = folder / "serve.log", folder / "told.json"
    with (shared / "clients.users").open("a") as users:
        with locked(lock):
            if not folder.exists():
                _start(folder, told, log, prefect_server)
            fcntl.flock(users, fcntl.LOCK_SH)
        yield Place(Endpoint(json.loads(told.read_text()), log), folder / "home" / "objects")
        with locked(lock):
            said = log.read_text()
            if _is_last(users):
                _end(int((folder / "pid").read_text()))
                said = log.read_text()
                shutil.rmtree(folder)
            for process in _started:
                process.returncode = process.returncode or 0  # whoever leaves last ends it; it is no child to wait for
    assert "Traceback" not in said


def _start(folder: Path, told: Path, log: Path, prefect_server: str) -> None:
    bundle, objects = folder / "bundle", folder / "home" / "objects"
    shutil.copytree(BUNDLES / "sleeper", bundle, ignore=shutil.ignore_patterns("__pycache__"))
    for bucket in ("applications", "results"):
        (objects / bucket).mkdir(parents=True)
    pack_tar_gz(bundle, objects / "applications" / "sleeper.tar.gz")
    environ = {"ROBOMAKER_HOME": str(folder / "home"), "PREFECT_HOME": str(folder / "prefect")}
    with told.open("w") as output, log.open("w") as errors:
        process = subprocess.Popen(
            [*COMMAND, "--max-jobs", "4"],
            env={**os.environ, **environ, "PREFECT_API_URL": prefect_server},
            stdout=output,
            stderr=errors,
            text=True,
            start_new_session=True,
        )
    _started.append(process)
    (folder / "pid").write_text(str(process.pid))
    try:
        wait_for(lambda: told.read_text().endswith("\n") or process.poll() is not None, "the endpoint", 240)
        assert process.poll() is None, log.read_text()
        served = Served(json.loads(told.read_text()), log, process)
        wait_for(lambda: served.worker()["state"] == "ready", f"a ready job worker; {log}", 240)
    except BaseException:
        os.killpg(process.pid, signal.SIGKILL)
        shutil.rmtree(folder, ignore_errors=True)  # another worker tries it again
        raise


def _is_last(users: IO[str]) -> bool:
    """Whether nobody else uses what one leaves."""
    try:
        fcntl.flock(users, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _end(pid: int) -> None:
    os.kill(pid, signal.SIGTERM)
    for process in _started:
        if process.pid == pid:
            assert process.wait(200) == 0
    wait_for(lambda: not alive({pid}), "the end of what was served")


@pytest.fixture
def wanted(worker_id: str) -> dict[str, Any]:
    """What a client asks for, under a name that nobody else uses."""
    return wanted_by(f"{worker_id}-{next(_numbers)}")


def wanted_by(name: str) -> dict[str, Any]:
    """Request of a client under a name."""
    return {
        "name": name,
        "role": ROLE,
        "bucket": "results",
        "body": json.dumps(BODY),
        "sources": [{"s3Bucket": "applications", "s3Key": "sleeper.tar.gz", "architecture": "X86_64"}],
        "package": "sleeper",
    }


@pytest.fixture(scope="session")
def old_programs(pytestconfig: pytest.Config) -> Path:
    """Programs of the environment with the last boto3 and AWS CLI that have the service."""
    return python_environment(pytestconfig)
