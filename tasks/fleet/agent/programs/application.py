"""Starts, watches and stops the robot's application; restarts it with growing pauses if it keeps failing."""

from __future__ import annotations

import os
import signal
import subprocess
from contextlib import suppress
from typing import Any, Callable

from ..deployment import Version
from ..errors import disk_failure
from ..settings import Home, Options
from ..state_machine import MAX_ENDS
from .launching import Sandbox, environment, kill_leftovers, launch_command

_LONGEST_PAUSE_S = 60.0
_STEADY_S = 60.0
"""Run time after which an application that ends is restarted without pause, in seconds."""


class Application:
    """Starts, watches and stops the application on the robot; at most one is running.

    Args:
        home: The agent's.
        options: The agent's options, which have the time limit for stopping.
        sandbox: Rights of the application.
        monotonic: A clock that only goes forward, in seconds.
        start: Starts a process; `subprocess.Popen`.
    """

    def __init__(
        self,
        home: Home,
        options: Options,
        sandbox: Sandbox,
        monotonic: Callable[[], float],
        start: Callable[..., Any] = subprocess.Popen,
    ) -> None:
        self._home = home
        self._options = options
        self._sandbox = sandbox
        self._monotonic = monotonic
        self._start = start
        self._process: Any = None
        self._version: Version | None = None
        self._since_s = 0.0
        self._failures = 0
        self._how = ""
        self.was_steady = False
        """Whether the application had run for a long time (`_STEADY_S`) when it last ended."""

        self.due_s: float | None = None
        """Time of the application's next start, by the monotonic clock in seconds; `None`: no start is due."""

    @property
    def is_running(self) -> bool:
        """Whether the application was started and is not known to have ended."""
        return self._process is not None

    def start(self, version: Version) -> None:
        """Starts a version of the application.

        Raises:
            StepFailed: The application cannot be started.
        """
        self.due_s = None
        folder = self._home.folder / version.folder
        command = launch_command(folder, version.launch)
        try:
            data = self._sandbox.data_folder(version.application)
            self._process = self._start(
                self._sandbox.wrap(command, data),
                cwd=folder,
                env=environment(self._home, version, data),
                stdin=subprocess.DEVNULL,
                start_new_session=True,
                **self._sandbox.rights,
            )
        except OSError as error:
            raise disk_failure(error, f"starting {command[0]}") from error
        self._version, self._since_s = version, self._monotonic()

    def ended(self) -> str | None:
        """Returns how the application ended by itself (once for each end); `None` if it is running or was reported.

        Processes that it left are killed, and the next start is put off.
        """
        if self._process is None or (code := self._process.poll()) is None:
            return None
        up_s = self._monotonic() - self._since_s
        self._kill_rest()
        self.was_steady = up_s >= _STEADY_S
        self.delay_next_start(was_steady=self.was_steady)
        how = self._how = f"signal {-code}" if code < 0 else f"exit code {code}"
        return f"the application ended with {how} after {up_s:.1f} s"

    def steady_s(self) -> float | None:
        """Returns when the application will count as steady, by the monotonic clock in seconds.

        Returns `None` if it is not running.
        """
        return None if self._process is None else self._since_s + _STEADY_S

    @property
    def trouble(self) -> str:
        """Error text if the application repeatedly ends soon after its start; empty if not."""
        is_steady = self._process is not None and self._monotonic() - self._since_s >= _STEADY_S
        if self._failures < MAX_ENDS or is_steady or self._version is None:
            return ""
        return f"version {self._version.version} keeps restarting: {self._how or 'it cannot be started'}"

    def delay_next_start(self, *, was_steady: bool = False) -> None:
        """Delays the next start of the robot's application, longer after each failure; not after a steady run."""
        self._failures = 0 if was_steady else self._failures + 1
        pause_s = 0.0 if was_steady else min(_LONGEST_PAUSE_S, 2.0 ** min(self._failures, 10) / 2)
        self.due_s = self._monotonic() + pause_s

    def stop(self) -> None:
        """Stops the robot's application and its processes: asks it to end, waits some seconds, then kills it."""
        self.due_s, self._failures, self._how = None, 0, ""
        if self._process is None:
            return
        self._signal(signal.SIGTERM)
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(self._options.stop_s)
        self._kill_rest()

    def _signal(self, number: int) -> None:
        if self._process.poll() is None:  # else the number may be another's by now
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, number)

    def _kill_rest(self) -> None:
        self._signal(signal.SIGKILL)
        self._process.wait()
        assert self._version is not None
        kill_leftovers(self._home.folder, self._version.folder)
        self._process = None
