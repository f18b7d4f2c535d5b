"""Child process of the robot agent, made by fork: it has all imported modules, but no files that the agent has open.

The agent has one thread, so a fork of it is safe. Starting an interpreter and importing took longer than the work.
"""

from __future__ import annotations

import fcntl
import gc
import json
import multiprocessing
import os
import select
import signal
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Callable

from ..deployment import deployment_of
from ..errors import AgentError
from ..state_machine import Checked, Event, Failed, Passed, Phase, Trusted


def line(**content: Any) -> str:
    """Formats one message line from the agent's child process."""
    return json.dumps(content) + "\n"


def events_of(content: Mapping[str, Any], phase: Phase) -> list[Event]:
    """Parses a message line of the agent's child process into events; a progress line gives none.

    Raises:
        AgentError: The line is not a message of a child process.
    """
    try:
        events: list[Event] = [Trusted(**content["trusted"])] if "trusted" in content else []
        if "deployment" in content:
            return [*events, Checked(deployment_of(content["deployment"]))]
        if "failed" in content:
            code, reason = content["failed"]
            return [Failed(phase, code, reason)]
        return [*events, Passed(phase)] if "passed" in content else events
    except (TypeError, KeyError, ValueError) as error:
        raise AgentError(f"a line of the child is not right: {error}") from error


_READ_BYTES = 1 << 16
_KILLED_WITHIN_S = 10.0
_PROCESSES = multiprocessing.get_context("fork")


class Child:
    """Child process of the robot's agent, which sends messages as lines.

    Args:
        do: Function of the child; it gets the function that sends answers.
    """

    def __init__(self, do: Callable[[Callable[..., None]], None]) -> None:
        self.pipe, writing = os.pipe()
        """File descriptor from which the child's answers are read."""

        os.set_blocking(self.pipe, False)
        self._process = _PROCESSES.Process(target=_run, args=(do, writing), daemon=True)
        try:
            self._process.start()
        except OSError:
            os.close(self.pipe)
            raise
        finally:
            os.close(writing)

    def read(self) -> bytes | None:
        """Returns new messages of the child: empty bytes at the end, `None` if there are none now."""
        try:
            return os.read(self.pipe, _READ_BYTES)
        except BlockingIOError:
            return None

    def end(self) -> int | None:
        """Waits some seconds for the end of the agent's child process; returns its exit code, `None` if it runs on."""
        self._process.join(_KILLED_WITHIN_S)
        return self._process.exitcode

    def kill(self) -> None:
        """Kills the agent's child process."""
        self._process.kill()
        self.end()

    def close(self) -> None:
        """Stops listening to the child process."""
        os.close(self.pipe)


def _run(do: Callable[[Callable[..., None]], None], answers: int) -> None:
    gc.freeze()  # what is the agent's is neither copied, nor closed under a number that is another's by now
    _forget_signals()
    os.setsid()
    _end_with_agent(answers)
    with open(answers, "w", encoding="utf-8") as lines:

        def say(**content: Any) -> None:
            lines.write(line(**content))
            lines.flush()

        do(say)


def _forget_signals() -> None:
    """Removes the agent's signal handlers in its child process, in which they would wake the agent."""
    signal.set_wakeup_fd(-1)
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGCHLD):
        signal.signal(number, signal.SIG_DFL)


def _end_with_agent(answers: int) -> None:
    """Closes the agent's open files in the child process, such as its lock.

    The kernel kills the child with the agent.
    """
    agent = multiprocessing.parent_process()
    assert agent is not None
    life = agent.sentinel  # a pipe that only the agent could write to
    opened = [int(path.name) for path in Path("/proc/self/fd").iterdir()]
    for each in opened:
        if each > 2 and each not in (life, answers):
            with suppress(OSError):  # that of the list is closed
                os.close(each)
    fcntl.fcntl(life, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(life, fcntl.F_SETSIG, signal.SIGKILL)
    fcntl.fcntl(life, fcntl.F_SETFL, fcntl.fcntl(life, fcntl.F_GETFL) | os.O_ASYNC)
    if select.select([life], [], [], 0)[0]:
        os._exit(1)  # it has ended before that
