"""Helper programs that process the outputs of a run that has ended, as child processes with a time limit."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

MAX_REASON_CHARACTERS = 300
_POLL_S = 0.1


def run_helper(
    command: Sequence[str],
    *,
    stop: Callable[[], str | None],
    environment: Mapping[str, str],
    limit_s: float,
    request: str = "",
) -> tuple[dict[str, Any], str | None]:
    """Runs a helper module as a child process; returns the JSON object that it prints, and its error.

    The program is killed at the time limit, or when it is to stop. The object is empty after a failure; else the error
    is `None`.

    Args:
        command: Python module and its arguments.
        stop: Function called about every 0.1 s; a result other than None ends the program.
        environment: Environment variables of the program.
        limit_s: Wall-clock time limit.
        request: Text for its standard input.
    """
    try:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", *command],
            env=dict(environment),
            cwd="/",
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
    except OSError as error:
        return {}, str(error)
    deadline_s = time.monotonic() + limit_s
    unsent: str | None = request
    while True:
        try:
            given, unsent = unsent, None  # `communicate` takes it once, and goes on with it
            output, errors = process.communicate(given, timeout=_POLL_S)
        except subprocess.TimeoutExpired:
            reason = stop()
            if reason is None and time.monotonic() < deadline_s:
                continue
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            return (
                {},
                f"the job was stopped ({reason})" if reason is not None else f"it took longer than {limit_s:.0f} s",
            )
        break
    if process.returncode == 0:
        try:
            return json.loads(output), None
        except ValueError as error:  # a library that it imports wrote there, too
            return {}, f"it printed something else than its result: {error}"
    lines = errors.strip().splitlines()
    return {}, lines[-1][:MAX_REASON_CHARACTERS] if lines else f"it ended with exit code {process.returncode}"
