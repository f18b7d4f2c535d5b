"""Work that runs while the agent polls the server: child process, script, or health check of a new version."""

from __future__ import annotations

import json
import os
import signal
import subprocess
from contextlib import suppress
from pathlib import Path
from typing import Any, Callable

from ..child.forking import Child, events_of
from ..state_machine import Event, Failed, Passed, Phase

_SHOWN_BYTES = 300


class ChildWork:
    """A phase of a deployment that is carried out by a child process.

    Args:
        child: The child.
        phase: Phase of the installation that it carries out.
    """

    due_s = None  # it says itself when it is done

    def __init__(self, child: Child, phase: Phase) -> None:
        self._child = child
        self._phase = phase
        self._rest = b""
        self._has_answered = False
        self._is_over = False
        self.percent: int | None = None
        """Percentage of the installation phase that is done; `None`: unknown."""

        self.later: str | None = None
        """Reason why the installation phase must be tried again later; `None`: there is none."""

    @property
    def pipe(self) -> int | None:
        """Returns the pipe with the child's messages; `None` once the child has ended."""
        return None if self._is_over else self._child.pipe

    def poll(self) -> list[Event]:
        """Returns new events from the child process."""
        events: list[Event] = []
        while not self._is_over and (chunk := self._child.read()) is not None:
            if not chunk:
                return [*events, *self._end()]
            *lines, self._rest = (self._rest + chunk).split(b"\n")
            for line in lines:
                events += self._heard(json.loads(line))
        return events

    def stop(self) -> None:
        """Kills the child process if it still runs."""
        if not self._is_over:
            self._child.kill()
            self._close()

    def _heard(self, content: dict[str, Any]) -> list[Event]:
        self.percent = content.get("progress", self.percent)
        self.later = content.get("later", self.later)
        self._has_answered |= bool({"passed", "failed", "later", "deployment"} & set(content))
        return events_of(content, self._phase)

    def _end(self) -> list[Event]:
        code = self._child.end()
        self._close()
        if self._has_answered:
            return []
        return [Failed(self._phase, "EnvironmentSetupError", f"the agent's child ended with code {code}; see its log")]

    def _close(self) -> None:
        self._is_over = True
        self._child.close()


class ScriptWork:
    """A phase of a deployment that is decided by a script's exit code.

    Args:
        process: Started, with its output in a file.
        phase: Phase of the installation that it carries out.
        name: Name of the script in failure reasons.
        code: Failure code.
        log: File with the script's output.
        due_s: Time by which the script must have ended, by the monotonic clock.
        monotonic: The monotonic clock, in seconds.
    """

    percent = None
    later = None
    pipe = None

    def __init__(
        self,
        process: Any,
        phase: Phase,
        name: str,
        code: str,
        log: Path,
        due_s: float,
        monotonic: Callable[[], float],
    ) -> None:
        self._process = process
        self._phase = phase
        self._name = name
        self._code = code
        self._log = log
        self._monotonic = monotonic
        self._is_over = False
        self.due_s: float | None = due_s
        """Time at which the script times out, by the monotonic clock; `None`: it is over."""

    def poll(self) -> list[Event]:
        """Checks, without waiting, whether the script has ended or timed out, and ends one that has timed out.

        Returns:
            One event, that the script passed or failed, from the first call after its end; otherwise an empty list.
        """
        if self._is_over:
            return []
        code = self._process.poll()
        if code is None and (self.due_s is None or self._monotonic() < self.due_s):
            return []
        self._is_over, self.due_s = True, None
        if code == 0:
            return [Passed(self._phase)]
        if code is None:
            self.stop()
            return [Failed(self._phase, self._code, f"{self._name} took too long")]
        how = f"signal {-code}" if code < 0 else f"exit code {code}"
        return [Failed(self._phase, self._code, f"{self._name} ended with {how}{self._said()}")]

    def stop(self) -> None:
        """Ends the running pre- or post-launch script."""
        _kill(self._process)

    def _said(self) -> str:
        with suppress(OSError):
            lines = self._log.read_bytes()[-_SHOWN_BYTES:].decode(errors="replace").strip().splitlines()
            return f": {lines[-1]}" if lines else ""
        return ""


class Watch:
    """Watches whether a new version keeps running, then runs the health command.

    Args:
        due_s: End of the watch, by the monotonic clock in seconds.
        monotonic: The monotonic clock, in seconds.
        check: Starts the health command; `None`: there is none.
    """

    percent = None
    later = None
    pipe = None

    def __init__(self, due_s: float, monotonic: Callable[[], float], check: Callable[[], ScriptWork] | None) -> None:
        self._until_s = due_s
        self._monotonic = monotonic
        self._check = check
        self._checking: ScriptWork | None = None
        self._is_over = False

    @property
    def due_s(self) -> float | None:
        """Time of the next look at a new version's health, by the monotonic clock (s); `None` if the check is over."""
        if self._checking is not None:
            return self._checking.due_s
        return None if self._is_over else self._until_s

    def poll(self) -> list[Event]:
        """Returns the result of a new version's health check once, as soon as it is known; nothing before and after.

        Without a check the version passes when it has stayed up for its time.
        """
        if self._checking is not None:
            return self._checking.poll()
        if self._is_over or self._monotonic() < self._until_s:
            return []
        self._is_over = True
        if self._check is None:
            return [Passed(Phase.WATCHING)]
        self._checking = self._check()
        return self._checking.poll()

    def stop(self) -> None:
        """Ends the health command of a new version."""
        if self._checking is not None:
            self._checking.stop()


def _kill(process: Any) -> None:
    if process.poll() is not None:
        return  # what a script has left running is meant, and the number may be another's by now
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    with suppress(subprocess.TimeoutExpired):
        process.wait(10)
