"""Telling of a run that cannot go on until somebody makes room on the disk."""

import logging
import time
from collections.abc import Callable

from ...schemas.reports.progress import Note, ProgressEvent, ProgressListener, StepProgress
from ...schemas.settings import Settings
from .messages import Message
from .sending import send, unknown_channels

_logger = logging.getLogger(__name__)

AFTER_S = 540.0
"""How long a run waits for disk before it is told of; notes of waits, on which that is looked at, come every 10 min."""


class LongWaits:
    """A listener of a run's progress that tells once of a long wait for disk, and passes everything on.

    At first it says which channels there are not: when the run has ended, it is too late for that. Other waits end by
    themselves, when jobs do; of the end of the run is told as always.

    Args:
        name: of the specification.
        settings: who is told, and when.
        listener: is given every event, and what channel did not take the message.
        clock: seconds.
    """

    def __init__(
        self, name: str, settings: Settings, listener: ProgressListener, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._name, self._settings, self._listener, self._clock = name, settings, listener, clock
        self._since_s: float | None = None
        self._is_told = not (settings.notify and settings.notify_when - {"recovery"})
        if settings.notify:
            for problem in unknown_channels(settings.notify):
                listener(Note(f"no message can be sent: {problem}"))

    def __call__(self, event: ProgressEvent) -> None:
        """Takes an event."""
        self._listener(event)
        if isinstance(event, StepProgress):
            self._since_s = (self._since_s or self._clock()) if event.waits_for == "disk" else None
        elif isinstance(event, Note) and not self._is_told and self._waited_s() >= AFTER_S:
            self._is_told = True
            self._tell(event.text)

    def _waited_s(self) -> float:
        """For how long it has waited for disk; less than nothing: it does not."""
        return -1.0 if self._since_s is None else self._clock() - self._since_s

    def _tell(self, why: str) -> None:
        """Sends the message; it never raises: a message is not worth a run."""
        body = f"{why}\n\nIt goes on by itself when there is room; robomaker gc removes old runs."
        message = Message(f"{self._name}: waits for disk", body, good=False)
        try:
            problems = send(self._settings.notify, message, {})
        except Exception as error:
            _logger.exception("no message could be sent about a wait of %s", self._name)
            problems = [f"{type(error).__name__}: {error}"]
        for problem in problems:
            self._listener(Note(f"not notified: {problem}"))
