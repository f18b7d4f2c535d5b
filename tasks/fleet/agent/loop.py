"""Main loop of the robot agent: polls the server, carries out the current phase, keeps the application running.

It has one thread, which sleeps until the next poll, or until a child process ends or writes a message.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping
from contextlib import suppress
from functools import reduce
from typing import Callable, Protocol

from .deployment import Order
from .effects import Effects, Work
from .errors import StepFailed
from .polls import Polls
from .programs.application import Application
from .state_machine import TRIED, Ended, Event, Failed, Phase, Restarted, State, Steady, advance, wanted


class Notifier:
    """Notifies systemd of the agent's state, if it is a systemd service.

    Args:
        environ: The variables that systemd sets.
    """

    def __init__(self, environ: Mapping[str, str] = os.environ) -> None:
        self._address = environ.get("NOTIFY_SOCKET", "").replace("@", "\0", 1)
        watchdog_us = environ.get("WATCHDOG_USEC", "")
        self.interval_s: float | None = int(watchdog_us) / 2e6 if watchdog_us.isdigit() else None
        """Interval within which `alive` must be called again, in seconds.

        `None`: systemd has no watchdog for the agent.
        """

    def ready(self) -> None:
        """Notifies systemd that the agent is running."""
        self._send(b"READY=1")

    def alive(self) -> None:
        """Notifies systemd's watchdog that the agent is not stuck."""
        self._send(b"WATCHDOG=1")

    def _send(self, message: bytes) -> None:
        if self._address:
            with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
                sender.sendto(message, self._address)


_SAVE_RETRY_S = 5.0
"""Pause between two attempts to write the journal on a full disk, in seconds."""


class Keeper(Protocol):
    """Interface of the storage for the agent's state: the journal."""

    def save(self, state: State) -> None:
        """Stores the agent's state so that it survives a power loss."""


class Agent:
    """Main loop of the agent, the program on a robot that installs deployments.

    Args:
        state: State from the journal.
        journal: Keeps the state.
        polls: Talks with the server.
        effects: Does what phases stand for.
        application: The running application.
        monotonic: A clock that only goes forward, in seconds.
        wait: Sleeps for seconds at most, or until one of some pipes can be read or a process ends.
        notifier: Tells systemd.
        say: Logs a line.
    """

    def __init__(
        self,
        state: State,
        journal: Keeper,
        polls: Polls,
        effects: Effects,
        application: Application,
        monotonic: Callable[[], float],
        wait: Callable[[float, list[int]], None],
        notifier: Notifier,
        say: Callable[[str], None],
    ) -> None:
        self.state = state
        self._journal = journal
        self._polls = polls
        self._effects = effects
        self._application = application
        self._monotonic = monotonic
        self._wait = wait
        self._notifier = notifier
        self._say = say
        self._events: list[Event] = []
        self._held_until_s = 0.0
        self._is_held = False
        self._work: Work | None = None
        self._begun: tuple[Phase, Order | None] | None = None
        self._again_s: float | None = None
        self.is_stopping = False
        """Whether the agent's main loop should end; signal handlers set it."""

    def run(self) -> None:
        """Runs the agent's main loop until it is told to stop; then ends the application and all work."""
        self.start()
        self._notifier.ready()
        while not self.is_stopping:
            self.step()
            self._notifier.alive()
            self._wait(self._pause_s(), self._pipes())
        self.stop()

    def start(self) -> None:
        """Continues from the journal after a start of the agent: starts the application, then the interrupted phase."""
        self._events.append(Restarted())
        self._settle(begin=False)
        version = wanted(self.state)
        if version is not None and self.state.phase not in (Phase.LAUNCHING, Phase.RETURNING):
            self._start_application()

    def step(self) -> None:
        """Does one pass of the agent's main loop: looks at application and work, and polls or reports what is due."""
        self._look_at_application()
        self._look_at_work()
        self._settle()
        if self._polls.due_s <= self._monotonic():
            self._events += self._polls.poll(self.state, self._work.percent if self._work else None)
            self._settle()
        if self.state.end is not None and not self.state.end.is_delivered:
            self._events += self._polls.deliver(self.state.end)
            self._settle()

    def stop(self) -> None:
        """Ends the application and all work; the journal says what to start again."""
        if self._work is not None:
            self._work.stop()
        self._application.stop()

    def _settle(self, *, begin: bool = True) -> None:
        """Applies all events to the agent's state; each new state is saved to disk before it has any effect."""
        while True:
            if self._events and self._monotonic() >= self._held_until_s:
                self._take()
            if not begin or self._events or self._begun == (self.state.phase, self.state.order):
                return
            self._begin()

    def _take(self) -> None:
        """Applies the events that have arrived, with one save for all; they remain queued if the save fails."""
        state = reduce(advance, self._events, self.state)
        if state != self.state and not self._is_saved(state):
            return
        self._events.clear()
        if state.phase is not self.state.phase or state.trouble not in ("", self.state.trouble):
            self._say(_told(state))
        self.state = state

    def _is_saved(self, state: State) -> bool:
        try:
            self._journal.save(state)
        except OSError as error:
            if not self._is_held:
                self._say(f"the journal cannot be written, nothing is done until it can: {error}")
            self._is_held, self._held_until_s = True, self._monotonic() + _SAVE_RETRY_S
            return False
        self._is_held = False
        return True

    def _begin(self) -> None:
        if self._work is not None:
            self._work.stop()
        self._work, self._again_s = None, None
        self._begun = (self.state.phase, self.state.order)
        if self.state.order is not None:
            self._polls.tell_step(self.state)
        begun = self._effects.begin(self.state)
        if isinstance(begun, (list, tuple)):
            self._events += begun
        else:
            self._work = begun  # type: ignore[assignment]

    def _look_at_work(self) -> None:
        if self._work is not None:
            self._events += self._work.poll()
            if self._work.later is not None and self._work.pipe is None:
                self._again_s = self._polls.later(self._work.later)
                self._work = None
        elif self._again_s is not None and self._monotonic() >= self._again_s:
            self._again_s, self._begun = None, None

    def _look_at_application(self) -> None:
        how = self._application.ended()
        if how is not None:
            self._say(how)
            if self.state.phase in TRIED:
                self._fail(f"the new version is unhealthy: {how}")
            elif not self._application.was_steady:
                self._events.append(Ended(how))
        elif (steady_s := self._steady_s()) is not None and self._monotonic() >= steady_s:
            self._events.append(Steady())
        due_s = self._application.due_s
        if due_s is not None and self._monotonic() >= due_s and self.state.phase not in TRIED:
            self._start_application()

    def _start_application(self) -> None:
        version = wanted(self.state)
        try:
            self._effects.restart(version)
        except StepFailed as error:
            self._say(f"version {version.version if version else 'none'} cannot be started: {error.reason}")
            self._application.delay_next_start()
            if self.state.phase in TRIED:
                self._fail(f"the new version cannot be started: {error.reason}")

    def _steady_s(self) -> float | None:
        """Returns when a version on probation counts as steady, by the monotonic clock in seconds.

        Returns `None` if none is on probation.
        """
        return self._application.steady_s() if self.state.probation is not None else None

    def _fail(self, reason: str) -> None:
        self._events.append(Failed(self.state.phase, "RobotDeploymentAborted", reason))

    def _pause_s(self) -> float:
        due = [self._polls.due_s, self._again_s, self._application.due_s, self._steady_s()]
        due += [self._work.due_s] if self._work is not None else []
        due += [self._held_until_s] if self._events else []
        pause_s = min(due_s for due_s in due if due_s is not None) - self._monotonic()
        longest_s = self._notifier.interval_s
        return max(0.0, pause_s if longest_s is None else min(pause_s, longest_s))

    def _pipes(self) -> list[int]:
        pipe = None if self._work is None else self._work.pipe
        return [] if pipe is None else [pipe]


def _told(state: State) -> str:
    """Returns the agent's log line for a new phase of a deployment."""
    if state.order is not None:
        return f"order {state.order.action_id}: {state.phase.value}" + (
            f", {state.failure[1]}" if state.failure else ""
        )
    if state.end is None:
        return "the order is gone"
    end = state.end
    return f"order {end.order.action_id} ended: {end.execution}, {end.finished}" + "".join(
        f"; {x}" for x in end.details
    )
