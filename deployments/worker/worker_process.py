"""Starts, wakes, watches, restarts and stops the job worker's process, from the endpoint's process."""

import logging
import os
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from typing import Any

from ...schemas.settings import Settings
from ...schemas.wire.errors import RobomakerError
from .channel import STOP, WAKE, Channel

_PROGRAM = "prefect_robomaker.deployments.worker"
_STOP_S = 8.0
_FIRST_PAUSE_S = 0.5
_LONGEST_PAUSE_S = 30.0
_LONG_LIFE_S = 60.0
"""Lifetime after which a job worker counts as healthy, in seconds; the next restart then has the shortest delay."""

_logger = logging.getLogger(__name__)


class WorkerProcess:
    """Job worker in a child process, which always ends with this one.

    Args:
        settings: Settings of the job worker.
        variables: Environment variables in addition to those of this process.
    """

    def __init__(self, settings: Settings, variables: Mapping[str, str] | None = None) -> None:
        self._settings = settings
        self._environment = {**os.environ, **(variables or {})}
        self._lock = threading.Lock()
        self._status: dict[str, Any] = {"state": "starting"}
        self._stopping = threading.Event()
        self._restarts = 0
        self._process: subprocess.Popen[bytes] | None = None
        self._channel: Channel | None = None
        self._watcher = threading.Thread(target=self._watch, name="job worker", daemon=True)

    def start(self) -> None:
        """Starts the worker process, and restarts it whenever it dies."""
        self._watcher.start()

    def wake(self, arn: str = "") -> None:
        """Wakes the worker for a new job; fast, from any thread."""
        del arn  # it finds the job in the catalog
        if (channel := self._channel) is not None:
            channel.send(WAKE)

    def status(self) -> Mapping[str, Any]:
        """Returns the worker's status as plain JSON values."""
        with self._lock:
            pid = self._process.pid if self._process else None
            return {**self._status, "pid": pid, "restarts": self._restarts}

    def stop(self) -> Mapping[str, int]:
        """Stops the worker process.

        Returns:
            Number of jobs of each kind that it left unfinished.
        """
        self._stopping.set()
        if (channel := self._channel) is not None:
            channel.send(STOP)
        self._watcher.join(_STOP_S)
        if self._watcher.is_alive():
            self.kill()
        return self.status().get("interrupted", {})

    def kill(self) -> None:
        """Kills the job worker's process, and waits a moment; its jobs stay claimed until their leases expire."""
        self._stopping.set()
        if (process := self._process) is not None:
            process.kill()
            self._watcher.join(_STOP_S)

    def _watch(self) -> None:
        pause_s = _FIRST_PAUSE_S
        while not self._stopping.is_set():
            began = time.monotonic()
            code = self._live()
            if self._stopping.is_set():
                return
            pause_s = _FIRST_PAUSE_S if time.monotonic() - began > _LONG_LIFE_S else pause_s
            self._clear_up(code, pause_s)
            self._stopping.wait(pause_s)
            pause_s = min(2 * pause_s, _LONGEST_PAUSE_S)

    def _live(self) -> int:
        """Starts a job worker's process and notes the states that it sends until it ends; returns its exit code."""
        ours, theirs = Channel.pair()
        with self._lock:
            self._status = {**self._status, "state": "starting"}
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", _PROGRAM, str(theirs.fileno())],
            pass_fds=[theirs.fileno()],
            env=self._environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C in a terminal is for the endpoint's process to pass on
        )
        theirs.close()
        self._process, self._channel = process, ours
        if self._stopping.is_set():  # it was asked to stop before the worker existed
            ours.send(STOP)
        while (message := ours.receive()) is not None:
            with self._lock:
                self._status = message
        self._channel = None
        ours.close()
        return process.wait()

    def _clear_up(self, code: int, pause_s: float) -> None:
        """Releases the leases of a dead job worker's process, counts and logs its death, and notes a restart."""
        how = f"was killed by signal {-code}" if code < 0 else f"ended with exit code {code}"
        held = self._expire_leases()
        error = self.status().get("error", "")
        with self._lock:
            self._restarts += 1
            self._status = {"state": "restarting", **({"error": error} if error else {})}
        _logger.warning(
            "the job worker %s; it is started again in %g s and goes on with %d jobs and batches%s",
            how,
            pause_s,
            held,
            f" ({error})" if error else "",
        )

    def _expire_leases(self) -> int:
        """Releases the leases of a dead job worker's process, so that its jobs can go on; returns how many it held.

        If the catalog cannot be opened, it logs that and returns 0: the leases run out by themselves.
        """
        # Imported late, so that the worker is started before this process has imported anything large.
        from ...tasks.execution.leases.held_leases import owners_of
        from ...tasks.service.service import Service

        assert self._process is not None
        try:
            catalog = Service.open(self._settings).catalog
            try:
                return catalog.expire_leases(owners_of(self._process.pid))
            finally:
                catalog.close()
        except RobomakerError as error:
            _logger.warning("the leases of the job worker that died run out by themselves: %s", error)
            return 0


def in_words(counts: Mapping[str, int]) -> str:
    """Formats counts of jobs: `2 simulation jobs, 1 world export job`."""
    return ", ".join(
        f"{count} {kind.replace('-', ' ')}{_plural(kind) if count > 1 else ''}" for kind, count in counts.items()
    )


def _plural(kind: str) -> str:
    return "es" if kind.endswith("h") else "s"
