"""The supervisor of one run: a small process between the launcher and the run.

It runs no application code, so nothing an application does (a crash, a C call that never returns, an
ignored signal) keeps it from doing its work:

- it kills the run and everything the run started when it is told to, when the run's process ends, and
  when the launcher's process disappears, however that happens (the channel between them closes);
- it adopts processes whose parents died, so that grandchildren which left the process group are found;
- it reports how the run ended and in which phase.
"""

import ctypes
import json
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from pathlib import Path

from .progress import Progress

_PR_SET_PDEATHSIG = 1
_PR_SET_CHILD_SUBREAPER = 36
_POLL_S = 0.002

RunChild = Callable[[bytes, Progress], int]
"""Carries out the run described by a request; returns the exit code."""


def supervise(channel: Connection, run_child: RunChild) -> None:
    """Starts one run, watches it, leaves none of its processes behind.

    Messages to the launcher are JSON objects: `{"event": "started"}`, then `{"event": "exited",
    "exit_code": int | null, "signal": int | null, "phase": int, "report": object}`. Messages from the
    launcher: `{"stop": reason}` asks the run to finish (SIGTERM), `{"kill": true}` ends it.

    Args:
        channel: Connection to the launcher; the first message is the request for `run_child`.
        run_child: What the run's process does.
    """
    os.setsid()
    _prctl(_PR_SET_CHILD_SUBREAPER, 1)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    try:
        request = channel.recv_bytes()
    except EOFError:
        return
    progress = Progress()
    supervisor = os.getpid()
    pid = os.fork()
    if pid == 0:
        channel.close()
        _become_run(supervisor, request, run_child, progress)
    channel.send_bytes(json.dumps({"event": "started"}).encode())
    _wait_for_end(channel, pid, progress)
    status = _kill_everything(pid)
    exited = {
        "event": "exited",
        "exit_code": os.WEXITSTATUS(status) if os.WIFEXITED(status) else None,
        "signal": os.WTERMSIG(status) if os.WIFSIGNALED(status) else None,
        "phase": progress.phase,
        "report": progress.read_report(),
    }
    with suppress(OSError):  # nobody may be left to be told
        channel.send_bytes(json.dumps(exited).encode())


def _become_run(supervisor: int, request: bytes, run_child: RunChild, progress: Progress) -> None:
    """Turns a fork into the run's process; never returns."""
    code = 70  # EX_SOFTWARE: the runtime itself failed
    try:
        os.setsid()
        # The supervisor itself may be killed too, for want of memory for example.
        _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() == supervisor:
            code = run_child(request, progress)
    finally:
        # Not sys.exit: this fork must not run the clean-up of the process it was copied from.
        os._exit(code)


def _wait_for_end(channel: Connection, pid: int, progress: Progress) -> None:
    """Passes stop requests on until the run ends, is to be killed, or the launcher is gone."""
    ended = os.pidfd_open(pid)
    try:
        while ended not in wait([channel, ended]):
            try:
                message = json.loads(channel.recv_bytes())
            except (EOFError, OSError):
                return
            if "stop" not in message:
                return
            progress.request_stop(message["stop"])
            os.kill(pid, signal.SIGTERM)
    finally:
        os.close(ended)


def _kill_everything(pid: int) -> int:
    """Kills the run and all its descendants, waits until they are gone, returns the run's status."""
    _kill(pid)
    _, status = os.waitpid(pid, 0)
    while True:
        try:
            reaped, _ = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return status
        if reaped == 0:
            # The children of killed processes become children of this one, so all are found in the end.
            for child in _children():
                _kill(child)
            time.sleep(_POLL_S)


def _kill(pid: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


def _children() -> Iterator[int]:
    own = os.getpid()
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            # "pid (name) state parent …"; the name may itself contain parentheses and blanks.
            parent = (entry / "stat").read_text(errors="replace").rpartition(")")[2].split()[1]
        except (OSError, IndexError):
            continue
        if int(parent) == own:
            yield int(entry.name)


def _prctl(option: int, value: int) -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(option, value, 0, 0, 0) != 0:
        error = ctypes.get_errno()
        raise OSError(error, f"prctl({option}) failed: {os.strerror(error)}")
