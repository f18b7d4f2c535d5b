"""Monitor of one run: stops it at its duration limit or on request, and passes its events on until it has ended."""

import json
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from ....schemas.runs.programs import RunStop
from ....schemas.runs.trials import TrialRecordings
from .run_outcomes import Exit

OnTrials = Callable[[int, TrialRecordings | None], None]
"""Function that gets the number of finished trials, and how far recording some again is; `None`: not begun."""

DURATION_GRACE_S = 3.0
"""Seconds that a run gets to finish its outputs when its duration limit is reached."""
CANCEL_GRACE_S = 1.0
"""Seconds that a cancelled run gets to finish; all its processes are gone within two seconds."""
_POLL_S = 0.2
"""Seconds between two checks for a stop request in the catalog: with sixteen jobs, twice as often took a third of the
coordinator's CPU.
"""

_KILL_TIMEOUT_S = 10.0


class StopMonitor:
    """Watches one run until it ends, and stops it on request or at its time limit.

    Args:
        channel: Connection to the run's supervisor.
        max_duration_s: Duration limit of the run.
        stop: Function called about every 0.2 s; returns a reason to stop the run, or None.
        on_crash: Called when a program crashed and the run continues.
        on_trials: Called from time to time with the number of finished trials, and how far recording some again is.
        on_answering: Called once applications listen on forwarded ports, or after a time limit.
        clock: Monotonic clock, in seconds.
    """

    def __init__(
        self,
        channel: Connection,
        max_duration_s: float,
        stop: Callable[[], RunStop | None],
        on_crash: Callable[[Exit], None],
        on_trials: OnTrials,
        on_answering: Callable[[], None],
        clock: Callable[[], float],
    ) -> None:
        self._channel = channel
        self._stop = stop
        self._on_crash = on_crash
        self._on_trials = on_trials
        self._on_answering = on_answering
        self._clock = clock
        self._deadline = clock() + max_duration_s
        self._stopped_for: RunStop | None = None
        self._due: list[tuple[float, dict[str, Any]]] = []
        """Messages still to be sent, each with the earliest time to send it."""

    def until_end(self) -> tuple[Exit | None, RunStop | None]:
        """Waits until the run has ended, stops it when a reason comes up, and passes its events on.

        Returns:
            The run's end (`None` if it is not known), and the reason why it was stopped (`None` if it was not).
        """
        while True:
            patience = _KILL_TIMEOUT_S if self._was_killed else self._patience()
            if self._channel.poll(patience):
                message = self._receive()
                if message is None or message["event"] == "exited":
                    return Exit.from_message(message["exit"]) if message else None, self._stopped_for
                if message["event"] == "trials":
                    told = message["recordings"]
                    self._on_trials(message["finished"], TrialRecordings.model_validate(told) if told else None)
                elif message["event"] == "answering":
                    self._on_answering()
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
