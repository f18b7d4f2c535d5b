"""Watches one run from the process that requested it: its end, its duration limit, requests to stop it."""

import json
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from ....schemas.runs.stops import RunStop
from .outcomes import Exit

DURATION_GRACE_S = 3.0
"""Time a run gets to finish its outputs when its duration limit is reached."""
CANCEL_GRACE_S = 1.0
"""Time a canceled run gets; all of it is gone within two seconds."""
_POLL_S = 0.2
"""Each time the catalog is asked: of sixteen jobs at once, twice as often took a third of their coordinator's CPU."""

_KILL_TIMEOUT_S = 10.0


class StopMonitor:
    """Watches one run until it ends.

    Args:
        channel: Connection to the run's supervisor.
        max_duration_s: The run's duration limit.
        stop: Asked about every 0.2 s whether to stop it.
        on_crash: Told when something crashed and the run goes on.
        on_trials: Told now and then how many trials have finished.
        clock: Seconds.
    """

    def __init__(
        self,
        channel: Connection,
        max_duration_s: float,
        stop: Callable[[], RunStop | None],
        on_crash: Callable[[Exit], None],
        on_trials: Callable[[int], None],
        clock: Callable[[], float],
    ) -> None:
        self._channel = channel
        self._stop = stop
        self._on_crash = on_crash
        self._on_trials = on_trials
        self._clock = clock
        self._deadline = clock() + max_duration_s
        self._stopped_for: RunStop | None = None
        self._due: list[tuple[float, dict[str, Any]]] = []
        """Messages still to be sent, each with the earliest time to send it."""

    def until_end(self) -> tuple[Exit | None, RunStop | None]:
        """Returns how the run ended (None: unknown) and why it was stopped (None: it was not)."""
        while True:
            patience = _KILL_TIMEOUT_S if self._was_killed else self._patience()
            if self._channel.poll(patience):
                message = self._receive()
                if message is None or message["event"] == "exited":
                    return Exit.from_message(message["exit"]) if message else None, self._stopped_for
                if message["event"] == "trials":
                    self._on_trials(message["finished"])
                else:
                    self._on_crash(Exit.from_message(message["exit"]))
            elif self._was_killed:
                return None, self._stopped_for
            if self._stopped_for is None:
                self._look_for_reason_to_stop()
            self._send_what_is_due()

    @property
    def _was_killed(self) -> bool:
        return self._stopped_for is not None and not self._due

    def _receive(self) -> dict[str, Any] | None:
        try:
            return json.loads(self._channel.recv_bytes())
        except (EOFError, OSError):
            return None

    def _patience(self) -> float:
        next_s = self._due[0][0] if self._due else self._deadline
        return min(_POLL_S, max(0.0, next_s - self._clock()))

    def _look_for_reason_to_stop(self) -> None:
        if self._clock() >= self._deadline:
            self._begin_stop(RunStop.DURATION_LIMIT, DURATION_GRACE_S)
        elif (reason := self._stop()) is not None:
            self._begin_stop(reason, CANCEL_GRACE_S)

    def _begin_stop(self, reason: RunStop, grace_s: float) -> None:
        self._stopped_for = reason
        now = self._clock()
        # Asked twice: the second time interrupts application code that does not return.
        self._due = [(now, {"stop": reason}), (now + grace_s / 2, {"stop": reason}), (now + grace_s, {"kill": True})]

    def _send_what_is_due(self) -> None:
        while self._due and self._clock() >= self._due[0][0]:
            _, message = self._due.pop(0)
            try:
                self._channel.send_bytes(json.dumps(message).encode())
            except OSError:
                return  # it has just ended; the loop sees that next
