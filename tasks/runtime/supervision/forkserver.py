"""Fork server: the warm process from which runs are forked.

It has imported everything that runs need, and then only forks, so that a run starts in milliseconds. The next run's
supervisor and process are forked in advance when there is time. Python's `multiprocessing` fork server is not used: all
code in a process shares it, it imports the caller's `__main__` in each child, and it inherits the caller's standard
output. This program inherits only a cleaned environment.

It is started as `python -P -m prefect_robomaker.tasks.runtime.supervision.forkserver FD`. On the socket FD it sends one
message to the launcher (`ready` and how runs are confined here, or why not), then receives one message per run, with
the run's own connection attached. It exits when the launcher closes the socket.

If a supervisor is killed, this process adopts the processes of its run, and kills them before the launcher can see that
the run has ended.
"""

import gc
import importlib
import json
import os
import signal
import socket
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from multiprocessing.connection import wait
from typing import NamedTuple

from ....schemas.runs.programs import BoxLevel
from ..limits.processes import adopt_orphans, kill_children
from ..sandbox.levels import Confinement, strongest_level

READY = b"ready "
"""Prefix of the first message; a `Confinement` (how runs are sandboxed here) as JSON follows."""
SANDBOX_VARIABLE = "ROBOMAKER_SANDBOX"
FORK_AHEAD_AFTER_S = 0.1
"""Seconds without events before a process is forked in advance; by then the last started run has built its world."""
_MODULES = (
    "PIL.PpmImagePlugin",  # maps
    "asyncio",
    "numpy",
    "mujoco",
    "dm_control.mujoco",
    "dm_control.rl.control",
    "zstandard",
    "prefect_robomaker.tasks.runtime.process.child",
    "prefect_robomaker.tasks.runtime.applications.indoor_navigation",
    "prefect_robomaker.tasks.runtime.applications.scout",
    "prefect_robomaker.tasks.runtime.process.rehearsal",
)


def main() -> None:
    """Entry point of the fork server: imports modules, then forks a supervisor for each requested run.

    Runs until the launcher closes the socket whose descriptor is the first argument. If a module cannot be imported,
    the error is sent there. An interrupt (Ctrl-C) is ignored.
    """
    control = socket.socket(fileno=int(sys.argv[1]))
    gc.disable()  # until all is imported, which stays
    try:
        for name in _MODULES:
            importlib.import_module(name)
    except Exception:
        control.send(traceback.format_exc().encode()[-4000:])
        return
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    adopt_orphans()
    is_off = os.environ.pop(SANDBOX_VARIABLE, "") == "off"
    confinement = Confinement("none", f"{SANDBOX_VARIABLE} is off") if is_off else strongest_level()
    gc.collect()
    gc.freeze()  # keeps the collector from touching, and so copying, the shared pages in each run
    gc.enable()
    from ..process.rehearsal import rehearsal_room, rehearse

    with rehearsal_room() as room:
        control.send(READY + json.dumps(confinement).encode())
        _Supervisors(control, partial(rehearse, room), level=confinement.level).serve()


class _StandBy(NamedTuple):
    """A supervisor process that was forked ahead and waits for a run, with the socket by which it gets one."""

    pid: int
    pidfd: int
    control: socket.socket
    """Socket on which the supervisor receives the run's connection to its launcher."""


class _Supervisors:
    """The running supervisor processes that the fork server has forked.

    Args:
        control: Socket with a message for each run.
        rehearse: Function that warms up waiting processes.
        fork_ahead_after_s: Seconds without events before a process is forked in advance.
        level: Sandbox level of runs that do not request a lower one.
    """

    def __init__(
        self,
        control: socket.socket,
        rehearse: Callable[[Callable[[float], bool]], None],
        fork_ahead_after_s: float = FORK_AHEAD_AFTER_S,
        level: BoxLevel = "none",
    ) -> None:
        self._level: BoxLevel = level
        self._control = control
        self._rehearse = rehearse
        self._fork_ahead_after_s = fork_ahead_after_s
        self._alive: dict[int, tuple[int, int]] = {}
        """Living supervisors by pidfd: process id, and a copy of the supervisor's end of the connection to the
        launcher, which keeps the connection open until the run's last process has ended.
        """
        self._standing_by: _StandBy | None = None

    def serve(self) -> None:
        """Forks a supervisor for each requested run, and reaps those that ended, until the launcher closes the socket.

        A supervisor is forked ahead while nothing else is to be done. A run that cannot begin has its connection
        closed.
        """
        while True:
            ready = wait([self._control, *self._alive], self._quiet_time_s())
            if not ready:
                try:
                    self._standing_by = self._fork()
                except OSError:  # no more processes for now
                    time.sleep(self._fork_ahead_after_s)
            for pidfd in self._alive.keys() & set(ready):
                self._bury(pidfd)
            if self._control in ready:
                message, descriptors, _, _ = socket.recv_fds(self._control, 1, 1)
                if not message:
                    break
                try:
                    self._supervise(descriptors[0])
                except OSError:
                    os.close(descriptors[0])  # which tells the launcher that the run did not begin
        if self._standing_by:
            self._dismiss(self._standing_by)

    def _quiet_time_s(self) -> float | None:
        """Returns the seconds without events before a process is to be forked in advance; None: none is needed."""
        if self._standing_by:
            return None
        return self._fork_ahead_after_s if self._alive else 0.0

    def _supervise(self, descriptor: int) -> None:
        """Passes a run's connection to the supervisor that waits, or to a new one if it is gone.

        Raises `OSError` if no process can be forked.
        """
        supervisor, self._standing_by = self._standing_by, None
        while True:
            supervisor = supervisor or self._fork(descriptor)
            try:
                with supervisor.control as control:
                    socket.send_fds(control, [b"r"], [descriptor])
            except OSError:  # another process has killed it
                self._dismiss(supervisor)
                supervisor = None
            else:
                break
        self._alive[supervisor.pidfd] = supervisor.pid, descriptor

    def _dismiss(self, supervisor: "_StandBy") -> None:
        """Ends a supervisor process that has no run, and waits for its end."""
        supervisor.control.close()
        os.waitpid(supervisor.pid, 0)
        os.close(supervisor.pidfd)

    def _fork(self, of_run: int | None = None) -> "_StandBy":
        """Forks a supervisor process, which waits for a run to supervise, and returns the access to it.

        Args:
            of_run: File descriptor of the run's connection, which the child closes because it gets the connection by
                message.

        Raises:
            OSError: The machine has no room for another process.
        """
        ours, theirs = socket.socketpair()
        try:
            with theirs:
                pid = os.fork()
                if pid == 0:
                    try:
                        ours.close()
                        if of_run is not None:
                            os.close(of_run)
                        self._become_supervisor(theirs)
                    finally:
                        os._exit(0)
            return _StandBy(pid, os.pidfd_open(pid), ours)
        except OSError:
            ours.close()  # a supervisor that cannot be watched ends with it
            raise

    def _become_supervisor(self, control: socket.socket) -> None:
        from ..process.child import run_child
        from .supervisor import stand_by

        self._control.close()
        for pidfd, (_, other) in self._alive.items():
            os.close(pidfd)
            os.close(other)
        stand_by(control, run_child, self._rehearse, self._level)

    def _bury(self, pidfd: int) -> None:
        pid, descriptor = self._alive.pop(pidfd)
        with suppress(ChildProcessError):  # reaped with another one
            os.waitpid(pid, 0)
        waiting = {self._standing_by.pid} if self._standing_by else set[int]()
        kill_children(spared={pid for pid, _ in self._alive.values()} | waiting)
        os.close(pidfd)
        os.close(descriptor)


if __name__ == "__main__":
    main()
