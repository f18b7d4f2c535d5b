"""The fork server: the warm process that runs are forked from.

It has imported what every run needs and then only forks, so a run starts in milliseconds. The next run's
supervisor and process are forked as soon as there is time, and wait. It is a
program of its own rather than Python's `multiprocessing` fork server, which is shared by everything in
a process, imports the caller's `__main__` again in each child and hands down the caller's standard
output. Here nothing is inherited but a cleaned environment.

Started as `python -P -m prefect_robomaker.tasks.runtime.supervision.forkserver FD`. The socket FD carries one
message to the launcher (`ready` and how runs are confined here, or why not), then one message per run from the
launcher, with the run's own connection attached. When the launcher's end closes, the process ends.

A supervisor that is killed leaves the processes of its run to this process, which kills them before the
launcher can see that the run has ended.
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
"""Followed by how runs are confined here, as JSON of a `Confinement`."""
SANDBOX_VARIABLE = "ROBOMAKER_SANDBOX"
FORK_AHEAD_AFTER_S = 0.1
"""Quiet time before a process is forked ahead, in seconds; by then the run begun last has made its world."""
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
    """Entry point of the warm process: imports modules, then forks a supervisor for each run requested."""
    control = socket.socket(fileno=int(sys.argv[1]))
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
    from ..process.rehearsal import rehearsal_room, rehearse

    with rehearsal_room() as room:
        control.send(READY + json.dumps(confinement).encode())
        _Supervisors(control, partial(rehearse, room), level=confinement.level).serve()


class _StandBy(NamedTuple):
    """A supervisor that waits for a run."""

    pid: int
    pidfd: int
    control: socket.socket
    """Takes the run's connection to its launcher."""


class _Supervisors:
    """The supervisors that were forked and have not ended.

    Args:
        control: The socket that carries a message for each run.
        rehearse: What processes do until there is a run for them.
        fork_ahead_after_s: How long nothing has to happen before there is time to fork ahead.
        level: How runs are confined, if they do not ask for less.
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
        """Living processes by pidfd: pid, and a copy of its end of the connection to the launcher, which stays open for
        the launcher until the run's last process is gone."""
        self._standing_by: _StandBy | None = None

    def serve(self) -> None:
        """Forks supervisors for runs, and reaps them, until the launcher is gone."""
        while True:
            ready = wait([self._control, *self._alive], self._patience_s())
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

    def _patience_s(self) -> float | None:
        """For how long nothing has to happen before there is time to fork ahead."""
        if self._standing_by:
            return None
        return self._fork_ahead_after_s if self._alive else 0.0

    def _supervise(self, descriptor: int) -> None:
        """Gives a run to the supervisor that waits for one, or to a new one."""
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
        """Ends a supervisor that has no run."""
        supervisor.control.close()
        os.waitpid(supervisor.pid, 0)
        os.close(supervisor.pidfd)

    def _fork(self, of_run: int | None = None) -> "_StandBy":
        """Forks a supervisor that waits.

        Args:
            of_run: The connection of the run that it is for, which it gets by message and must not have twice.

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
