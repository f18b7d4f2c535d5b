"""Waiting process that is forked before its run is known.

Forking a process that has imported MuJoCo takes milliseconds, which jobs need not wait for this way.
"""

import os
import select
import signal
import socket
from collections.abc import Callable
from contextlib import suppress
from typing import BinaryIO, NoReturn, cast

from ..episode.progress import Progress
from ..limits.limits import apply_limits
from ..sandbox.box import Box, enter_network_of_keeper, fork_beside
from ..sandbox.kernel import confine
from .run_request import RunRequest, rules_of_run

RunChild = Callable[[RunRequest, Progress], int]
"""Function that runs the simulation of a request; returns the process's exit code."""

Rehearse = Callable[[Callable[[float], bool]], None]
"""Function that warms up the process until a run arrives; see `rehearsal.rehearse`."""

_BEGIN = b"!"
_INTERNAL_ERROR = 70  # EX_SOFTWARE: the runtime itself failed


class WaitingRun:
    """A forked child process that waits for a run's request and then runs the simulation.

    Args:
        run_child: Function that runs the simulation.
        progress: Memory that the child shares with this process.
        close_in_child: File descriptors of this process that the child must close.
        rehearse: Function that warms up the child until there is a run.
        box: Sandbox of the child, if it has one.
    """

    def __init__(
        self,
        run_child: RunChild,
        progress: Progress,
        close_in_child: Callable[[], None],
        rehearse: Rehearse,
        box: Box | None = None,
    ) -> None:
        self._pipe, theirs = socket.socketpair()
        self.box = box

        def become() -> NoReturn:
            self._pipe.close()
            close_in_child()
            if box is not None:
                box.close_in_child()
            _become_run(theirs, run_child, progress, rehearse)

        self.pid = box.fork(become) if box else fork_beside(become)
        theirs.close()

    def tell(self, request: bytes) -> bool:
        """Sends a run's request to the waiting process.

        Args:
            request: A `RunRequest` as JSON in one line.

        Returns:
            Whether the process is still running; it may have been killed while it waited.
        """
        try:
            self._pipe.sendall(request + b"\n")
        except OSError:
            return False
        return True

    def begin(self) -> int:
        """Starts the assigned run in the waiting process, and returns the process id."""
        with suppress(OSError):  # it has been killed, which its supervisor notices
            self._pipe.sendall(_BEGIN)
        self._pipe.close()
        return self.pid

    def dismiss(self, *, keep_box: bool = False) -> None:
        """Kills the waiting process before its run begins, and ends its sandbox unless that is kept."""
        self._pipe.close()
        with suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGKILL)
        os.waitpid(self.pid, 0)
        if self.box is not None and not keep_box:
            self.box.close()


def _become_run(pipe: socket.socket, run_child: RunChild, progress: Progress, rehearse: Rehearse) -> NoReturn:
    """Waits in the forked child for a request, then confines the process, runs the simulation, and ends the process.

    The exit code is that of `run_child`, or 0 if the pipe is closed without a request.

    Args:
        pipe: Socket on which the request comes.
        run_child: Runs the simulation, and returns the exit code.
        progress: Phase that the run has reached.
        rehearse: Warms the process up; its argument waits, in seconds, and returns whether the request has come.
    """
    code = _INTERNAL_ERROR
    try:
        rehearse(lambda wait_s: bool(select.select([pipe], [], [], wait_s)[0]))
        with pipe, cast(BinaryIO, pipe.makefile("rb")) as stream:
            request = _awaited_request(stream)
        if request is None:
            code = 0
        else:
            apply_limits(request.plan.compute, request.cores)
            if request.box.level == "box":
                enter_network_of_keeper(request.box.network)
            confine(request.box.level, rules_of_run(request))
            code = run_child(request, progress)
    finally:
        # Not sys.exit: this fork must not run the clean-up of the process it was copied from.
        os._exit(code)


def _awaited_request(stream: BinaryIO) -> RunRequest | None:
    """Waits for the run request and the order to begin; None if this process gets no run."""
    line = stream.readline()
    if not line:
        return None
    request = RunRequest.model_validate_json(line).for_run_process()
    return request if stream.read(1) == _BEGIN else None
