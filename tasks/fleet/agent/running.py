"""Builds and runs the robot agent on this machine, and reads the status of a running agent."""

from __future__ import annotations

import fcntl
import os
import random
import select
import signal
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Callable

from .disk import prepare
from .effects import Effects
from .errors import AgentError
from .journal import Journal
from .loop import Agent, Notifier
from .polls import Polls
from .programs.application import Application
from .programs.launching import find_sandbox, kill_leftovers
from .server import Server
from .settings import Home, Options, checked_options
from .state_machine import STEPS, State, wanted


def run(home: Home, options: Options) -> None:
    """Runs the robot's agent until SIGTERM or SIGINT.

    Raises:
        AgentError: The robot is not enrolled, its agent is already running, or an option is invalid.
    """
    connection = home.connection()
    prepare(home)
    with _only_one(home):
        options = checked_options(options)
        kill_leftovers(home.folder)
        sandbox = find_sandbox(home, options)
        application = Application(home, options, sandbox, time.monotonic)
        journal = Journal(home.folder)
        attributes = _attributes(options, application)
        polls = Polls(Server(connection), time.monotonic, random.random, options.longest_wait_s, attributes, _say)
        effects = Effects(home, options, sandbox, application, time.monotonic)
        wait = _waiter()
        agent = Agent(journal.load(), journal, polls, effects, application, time.monotonic, wait, Notifier(), _say)

        def stop(_number: int, _frame: Any) -> None:
            agent.is_stopping = True

        signal.signal(signal.SIGTERM, stop)
        signal.signal(signal.SIGINT, stop)
        _say(f"robot {connection.robot} at {connection.url}, sandbox {sandbox.kind}")
        agent.run()


def status_of(home: Home) -> dict[str, Any]:
    """Returns the agent's status as JSON: order, phase and application.

    Raises:
        AgentError: The robot is not enrolled.
    """
    connection, state = home.connection(), Journal(home.folder).load()
    end = state.end
    return {
        "robot": connection.robot,
        "url": connection.url,
        "is_running": _is_locked(home),
        "application": None if state.good is None else state.good.application,
        "version": None if state.good is None else state.good.version,
        "order": None if state.order is None else state.order.action_id,
        "step": STEPS.get(state.phase),
        "trouble": state.trouble or None,
        "last_order": None if end is None else end.order.action_id,
        "last_result": None if end is None else end.finished if end.execution == "closed" else end.execution,
        "last_reason": None if end is None or end.code is None else "; ".join(end.details[1:]),
        "is_reported": None if end is None else end.is_delivered,
    }


_MAX_ATTRIBUTE_CHARACTERS = 128
"""Limit of the characters of an attribute; update servers refuse longer ones."""


def _attributes(options: Options, application: Application) -> Callable[[State], Mapping[str, str]]:
    def attributes(state: State) -> Mapping[str, str]:
        version = wanted(state)
        runs = {} if version is None else {"application": version.application, "version": version.version}
        trouble = application.trouble or state.trouble
        told = {"updater": "robomaker-agent", "architecture": options.architecture or "", "trouble": trouble, **runs}
        return {name: value[:_MAX_ATTRIBUTE_CHARACTERS] for name, value in told.items()}

    return attributes


@contextmanager
def _only_one(home: Home) -> Iterator[None]:
    """Locks the agent's home inside the block, as two agents with one home would start everything twice.

    Raises AgentError if another agent runs with it.
    """
    with (home.folder / "lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise AgentError(f"another agent runs with {home.folder}") from None
        yield


def _is_locked(home: Home) -> bool:
    try:
        with (home.folder / "lock").open("r") as lock:
            fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except FileNotFoundError:
        return False
    return False


def _waiter() -> Callable[[float, list[int]], None]:
    """Returns a function that sleeps until a time, a readable pipe, or a signal (such as the end of a process).

    Sets this process's handler of SIGCHLD and its wake-up pipe.
    """
    reading, writing = os.pipe()
    for end in (reading, writing):
        os.set_blocking(end, False)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    signal.signal(signal.SIGCHLD, lambda _number, _frame: None)

    def wait(pause_s: float, pipes: list[int]) -> None:
        ready, _, _ = select.select([reading, *pipes], [], [], pause_s)
        if reading in ready:
            os.read(reading, 4096)

    return wait


def _say(text: str) -> None:
    sys.stderr.write(f"robomaker-agent: {text}\n")
    sys.stderr.flush()
