"""Messages between the robot agent and the server: polls, progress and results of orders; retries while it is away.

A server that is away for weeks is worth two lines in the log: one when it goes, one when it is back.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Callable, Protocol

from .deployment import Order
from .errors import TryLater
from .server import Poll, Refused
from .state_machine import BEFORE_SWITCH, STEPS, Cancelled, Delivered, End, Event, Ordered, Phase, State, Withdrawn

_MAX_MISSED_POLLS = 3
"""Number of polls without the open order after which it counts as withdrawn.

A server that has just started may not know the order yet.
"""


class Wire(Protocol):
    """Interface to the update server, as the agent uses it."""

    def poll(self) -> Poll:
        """Asks the update server whether there is an order for this robot."""
        ...

    def order(self, action_id: int) -> Order | None:
        """Reads an order for this robot from the update server."""

    def tell_end(self, end: End) -> bool:
        """Reports to the update server how an order ended."""
        ...

    def tell_step(self, action_id: int, step: str, percent: int | None) -> None:
        """Reports the current step and progress of an order to the update server."""

    def refuse_cancellation(self, action_id: int) -> None:
        """Reports to the update server that an order can no longer be cancelled."""

    def tell_attributes(self, attributes: Mapping[str, str]) -> bool:
        """Reports the robot's attributes; returns whether the server has taken them."""
        ...


class Polls:
    """Polls the update server, and decides when to do so again.

    Args:
        server: The server.
        monotonic: A clock that only goes forward, in seconds.
        chance: Random numbers from 0 to below 1, so that robots do not all poll at once.
        longest_wait_s: Longest pause between two polls while the server is away, in seconds.
        attributes: Returns the robot's attributes for a state.
        say: Logs a line.
    """

    def __init__(
        self,
        server: Wire,
        monotonic: Callable[[], float],
        chance: Callable[[], float],
        longest_wait_s: float,
        attributes: Callable[[State], Mapping[str, str]],
        say: Callable[[str], None],
    ) -> None:
        self._server = server
        self._monotonic = monotonic
        self._chance = chance
        self._longest_wait_s = longest_wait_s
        self._attributes = attributes
        self._say = say
        self._failures = 0
        self._retries = 0
        self._missed = 0
        self._told: tuple[int, str, int | None] | None = None
        self._told_attributes: Mapping[str, str] | None = None
        self._deliver_s = 0.0
        self.due_s = monotonic()
        """Time of the next poll of the update server, by the monotonic clock in seconds."""

    def poll(self, state: State, percent: int | None) -> list[Event]:
        """Polls the server once; returns new orders, cancellations and withdrawals as events.

        If the server is away or refuses, there are none and the next poll is put off.
        """
        try:
            self.tell_step(state, percent)
            found = self._server.poll()
            events = self._events(found, state)
        except (TryLater, Refused) as error:
            self._away(error)
            return []
        self.due_s = self._monotonic() + found.sleep_s
        try:
            self._tell_attributes(state, is_asked=found.wants_attributes)
            self._back()
        except TryLater as error:  # the events stay: the server may have been told of them
            self._away(error)
        return events

    def deliver(self, end: End) -> list[Event]:
        """Reports to the update server how an order ended, when that is due; returns that event, or nothing.

        If the server is away, it is tried again after a pause.
        """
        if self._monotonic() < self._deliver_s:
            return []
        order = end.order
        try:
            if end.execution == "closed" and (self._told is None or self._told[0] != order.action_id):
                self._server.tell_step(order.action_id, STEPS[Phase.WATCHING], None)
            if self._server.tell_end(end):
                self._back()
                return [Delivered(order)]
        except TryLater as error:
            self._away(error)
        self._deliver_s = self._monotonic() + self._pause_s(max(1, self._failures))
        return []

    def tell_step(self, state: State, percent: int | None = None) -> None:
        """Reports the current step of an order to the update server, if there is an order and the step is new.

        If the server is away, nothing is noted, so that the next call tries again.
        """
        if state.order is None:
            return
        step = STEPS[state.phase]
        percent = percent if state.phase is Phase.DOWNLOADING else None
        told = (state.order.action_id, step, percent)
        if told == self._told:
            return
        try:
            self._server.tell_step(*told)
        except TryLater:
            return
        self._told, self._retries = told, 0

    def later(self, reason: str) -> float:
        """Returns when to retry after the server could not be reached, by the monotonic clock in seconds."""
        self._retries += 1
        if self._retries == 1:
            self._say(f"the download has to wait: {reason}")
        return self._monotonic() + self._pause_s(self._retries)

    def _tell_attributes(self, state: State, *, is_asked: bool) -> None:
        """Reports the robot's attributes when the server asks, and changed ones until the server has accepted them.

        The server does not ask again. The result of a deployment stays whatever its application does later; the
        attributes say which version runs, and its problems.
        """
        attributes = self._attributes(state)
        if not (is_asked or (attributes and attributes != self._told_attributes)):
            return
        if self._server.tell_attributes(attributes):
            self._told_attributes = attributes

    def _events(self, found: Poll, state: State) -> list[Event]:
        open_id = state.order.action_id if state.order is not None else None
        self._missed = self._missed + 1 if open_id is not None and found.order is None and found.cancel is None else 0
        if found.cancel is not None:
            if found.cancel == open_id and state.phase not in BEFORE_SWITCH:
                self._server.refuse_cancellation(found.cancel)
                return []
            return [Cancelled(found.cancel)]
        if self._missed >= _MAX_MISSED_POLLS:
            return [Withdrawn()]
        if found.order is None or found.order == open_id:
            return []
        order = self._server.order(found.order)
        return [] if order is None else [Ordered(order)]

    def _away(self, error: Exception) -> None:
        self._failures += 1
        if self._failures == 1:
            self._say(f"the server is away: {error}")
        self.due_s = self._monotonic() + self._pause_s(self._failures)

    def _back(self) -> None:
        if self._failures:
            self._say("the server is back")
        self._failures = 0
        self._deliver_s = 0.0

    def _pause_s(self, failures: int) -> float:
        return min(self._longest_wait_s, 2.0 ** min(failures - 1, 20)) * (0.5 + self._chance() / 2)
