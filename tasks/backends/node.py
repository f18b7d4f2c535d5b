"""Runs a job worker as a child process on the machine where it is called.

It is a process and not a call, as Dask's workers may have no children of `multiprocessing`, and a job worker that dies
must not take the cluster's worker with it. It ends when this process does.
"""

import os
import re
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import NamedTuple

from ...schemas.exit_codes import BAD_USAGE

_COMMAND = ("-P", "-m", "prefect_robomaker", "work")
_LAST_WORDS = 2_000  # characters of its messages: enough for the reason, little to send
_LOOK_S = 0.5
_MISSING = re.compile(r"No module named '?prefect_robomaker\b")
_END_S = 30.0  # for a job worker that is told to end by an exception here; then it is killed


class Ended(NamedTuple):
    """Report of how a job worker ended, as plain values, which other versions of this program can read."""

    host: str
    exit_code: int
    last_words: str
    """Last lines that the job worker wrote to standard error."""

    @property
    def reason(self) -> str:
        """Reason for the job worker's end in one line: its host, and its last written line or else its exit code."""
        said = self.last_words.strip().splitlines()
        return f"{self.host}: {said[-1] if said else f'exit code {self.exit_code}'}"


def run_job_worker(
    batch: str, environment: Mapping[str, str] | None = None, should_stop: Callable[[], bool] = lambda: False
) -> Ended:
    """Runs a job worker on this machine: takes jobs of a batch until none is left.

    Args:
        batch: ARN of the batch.
        environment: Variables besides those of this process.
        should_stop: Called twice a second; once true, the worker releases its jobs and ends.

    Returns:
        Report of how the job worker ended.
    """
    with tempfile.TemporaryFile() as messages:
        process = subprocess.Popen(
            [sys.executable, *_COMMAND, batch, "--end-with-input"],
            stdin=subprocess.PIPE,  # its other end closes when this process ends, in whatever way
            stdout=subprocess.DEVNULL,
            stderr=messages,
            env={**os.environ, **(environment or {})},
            start_new_session=True,
        )
        assert process.stdin is not None
        try:
            while process.poll() is None:
                if should_stop():
                    process.stdin.close()
                with suppress(subprocess.TimeoutExpired):
                    process.wait(_LOOK_S)
        finally:
            process.stdin.close()
            _see_out(process)
        messages.seek(max(0, messages.seek(0, os.SEEK_END) - _LAST_WORDS))
        last_words = messages.read().decode("utf-8", "replace")
    # Python itself ends with 1 where a module is missing, which waiting does not mend.
    is_missing = process.returncode == 1 and _MISSING.search(last_words) is not None
    return Ended(socket.gethostname(), BAD_USAGE if is_missing else process.returncode, last_words)


def _see_out(process: "subprocess.Popen[bytes]") -> None:
    """Waits for the end of a job worker that was asked to stop, and kills it if it takes too long."""
    try:
        process.wait(_END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
