"""Backend for a Ray cluster: starts and reads the child process (`ray_driver.py`) that is connected to the cluster.

Ray ends the process that is connected to a cluster when the cluster has been away for a minute, may start a cluster
where it finds none, and writes to standard error. None of this may happen to a process that runs batches, which may
also be connected to another cluster.
"""

import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager, suppress
from typing import IO

from .backend import Backend, BackendError, JobWorkers, check_answer, check_place

_DRIVER = ("-P", "-m", "prefect_robomaker.tasks.backends.ray_driver")
_CLOSE_S = 30.0
_LONGEST_PAUSE_S = 60.0


def backend_at(place: str) -> Backend:
    """Creates the backend for a Ray cluster; it does not connect yet.

    Args:
        place: Address of its head, `10.0.0.7:6379`, or of its Ray Client server, `ray://10.0.0.7:10001`.

    Raises:
        ConfigurationError: The address is not valid, or Ray is not installed.
    """
    wanted = "the address of a cluster, such as 10.0.0.7:6379 or ray://10.0.0.7:10001"
    check_place("ray", place, library="ray", wanted=wanted)
    return _RayBackend(place)


class _RayBackend:
    def __init__(self, address: str) -> None:
        self._address = address

    def check(self) -> None:
        """Raises `BackendError` if the head of the Ray cluster does not answer."""
        check_answer(f"the Ray cluster {self._address}", self._address, "ray start --head")

    @contextmanager
    def job_workers(self, batch: str, wanted: int) -> Generator[JobWorkers]:
        """Starts job workers for a batch on the Ray cluster inside the `with` block, and ends them after it.

        Raises `BackendError` if the cluster does not answer.
        """
        self.check()
        driver = RayDriver(self._address, batch, wanted)
        try:
            yield driver
        finally:
            driver.close()


class RayDriver:
    """Child process that is connected to a Ray cluster and starts job workers there; it is restarted if it dies.

    Args:
        address: Address of the cluster.
        batch: ARN of the batch.
        wanted: Number of job workers that can be of use.
    """

    def __init__(self, address: str, batch: str, wanted: int) -> None:
        self._address = address
        self._arguments = (address, batch, str(wanted))
        self._words = f"connecting to the Ray cluster {address}"
        self._error = ""
        self._was_connected = False
        self._deaths = 0
        self._not_before = 0.0
        self._start()

    def look(self) -> str:
        """Starts the child process that runs job workers, also after it died, and returns their state as text.

        Raises:
            BackendError: No machine can run jobs.
        """
        if self._error:
            raise BackendError(self._error)
        if self._process is None:
            if time.monotonic() >= self._not_before:
                self._start()
        elif self._process.poll() is not None:
            self._note_death()
        return self._words

    def close(self) -> None:
        """Ends the job workers on the Ray cluster, then the child process that is connected to it, if there is one."""
        if self._process is not None:
            self._end(self._process)

    def _start(self) -> None:
        self._messages = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the process
        self._process = subprocess.Popen(
            [sys.executable, *_DRIVER, *self._arguments],
            stdin=subprocess.PIPE,  # its other end closes when this process ends, in whatever way
            stdout=subprocess.PIPE,
            stderr=self._messages,
            start_new_session=True,
        )
        assert self._process.stdout is not None
        self._reader = threading.Thread(target=self._read, args=(self._process.stdout,), daemon=True)
        self._reader.start()

    def _read(self, output: IO[bytes]) -> None:
        for line in output:
            said = json.loads(line)
            self._was_connected = True
            self._words = said.get("words", self._words)
            self._error = said.get("error", "")

    def _note_death(self) -> None:
        """Notes that the child process died, so that it is restarted.

        Ray ends it when the cluster has been away for a minute.
        """
        assert self._process is not None
        self._reader.join()
        if not self._error:
            self._messages.seek(0)
            lines = self._messages.read().decode("utf-8", "replace").strip().splitlines()
            why = lines[-1] if lines else f"exit code {self._process.returncode}"
            self._words = f"the Ray cluster {self._address} does not answer: {why}"
            self._error = "" if self._was_connected else self._words
        self._deaths += 1
        self._not_before = time.monotonic() + min(2.0**self._deaths, _LONGEST_PAUSE_S)
        self._end(self._process)

    def _end(self, process: "subprocess.Popen[bytes]") -> None:
        assert process.stdin is not None
        assert process.stdout is not None
        with suppress(BrokenPipeError):
            process.stdin.close()
        try:
            process.wait(_CLOSE_S)
        except subprocess.TimeoutExpired:
            process.kill()  # then Ray ends what it has started
            process.wait()
        self._reader.join()
        process.stdout.close()
        self._messages.close()
        self._process = None
