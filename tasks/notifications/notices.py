"""Sends notifications about runs: one that has ended, if it is worth a message, and one that waits for disk space."""

import logging
import platform
import re
import time
from collections.abc import Callable, Sequence

from ...schemas.documents.simulation_jobs import SimulationJobDocument
from ...schemas.documents.worlds import StoredPlace
from ...schemas.reports.changes import Losses
from ...schemas.reports.progress import Note, ProgressEvent, ProgressListener, StepProgress
from ...schemas.reports.run_record import JobRecord, RunRecord
from ...schemas.settings import NotifyWhen, Settings
from ...schemas.wire.errors import RobomakerError
from ..inspection.run_records import is_night, run_before, since_last_good
from ..reporting.console_pages import pages_elsewhere
from ..service.service import Service
from ..simulations.planning.run_plans import world_arn
from ..worlds.previews import preview_of
from .notification_texts import WORST, Message, failed_jobs, message_of
from .sending import send, unknown_channels

_logger = logging.getLogger(__name__)


def notify_of(record: RunRecord, settings: Settings, service: Service | None, listener: ProgressListener) -> None:
    """Sends a notification about a finished run if the settings ask for it; it never raises an error.

    Args:
        record: The run, whose record and report are written.
        settings: Settings that say who is notified, and when.
        service: The service, which has the pictures; `None`: it cannot be opened, and the message has none.
        listener: Called for every channel that did not accept the message.
    """
    if not settings.notify:
        return
    try:
        before = run_before(record)
        # Losses of earlier runs were told with them: one that ended before its jobs says nothing about these.
        since = since_last_good(record) if is_night(record) and not record.ended_before_jobs else None
        if is_due(settings.notify_when, record, before, since):
            pictures = _pictures(failed_jobs(record)[:WORST], service) if service is not None else {}
            message = message_of(record, before, since, pages_elsewhere(settings), platform.node())
            problems = send(settings.notify, message, pictures)
        else:
            problems = []
    except Exception as error:
        _logger.exception("no message could be sent about %s", record.run_id)
        problems = [f"{type(error).__name__}: {error}"]
    for problem in problems:
        listener(Note(f"not notified: {problem}"))


def is_due(
    when: frozenset[NotifyWhen], record: RunRecord, before: RunRecord | None, since: Losses | None = None
) -> bool:
    """Whether a notification about a run is to be sent, by the setting (failure, change, recovery, always).

    A run that succeeds although it judges less than earlier runs is no recovery: it is notified like a failure or a
    change. A cancelled run says nothing about the robot, and is notified only with `always`.

    Args:
        when: The setting: kinds of results that are notified.
        record: The run.
        before: The last run of the specification before it that was not cancelled; None: there is none.
        since: What it judges less than earlier runs, since the last good one; None: it is not one of the nights.
    """
    if "always" in when:
        return True
    if record.state == "canceled":
        return False
    good, was_good = record.state == "succeeded", before is None or before.state == "succeeded"
    if good and since is not None and since.has_losses:
        return bool(when & {"failure", "change"})
    if good:
        return not was_good and bool(when & {"recovery", "change"})
    return "failure" in when or ("change" in when and was_good)


def _pictures(failures: Sequence[JobRecord], service: Service) -> dict[str, bytes]:
    """Returns a picture (PNG) of each failed job: of its video, else of its world."""
    stored = service.catalog.get_many(job.arn for job in failures if job.arn)
    pictures: dict[str, bytes] = {}
    for number, job in enumerate(failures, start=1):
        if job.arn in stored and (picture := _picture(SimulationJobDocument.of(stored[job.arn]), service)):
            pictures[f"{number}-{re.sub('[^A-Za-z0-9-]+', '-', job.label)}.png"] = picture
    return pictures


def _picture(job: SimulationJobDocument, service: Service) -> bytes:
    """Returns a picture of a job (PNG): its poster, else its world from above; empty if there is neither."""
    if poster := _fetched(job.outputs, "poster.png", service):
        return poster
    arn = world_arn(job.request)
    world = service.catalog.get_many([arn]).get(arn) if arn else None
    try:
        return preview_of(world, service) if world else b""
    except RobomakerError:
        return b""


def _fetched(place: StoredPlace | None, name: str, service: Service) -> bytes:
    try:
        return service.store.get_bytes(place.bucket, f"{place.prefix}/{name}") if place else b""
    except RobomakerError:
        return b""


AFTER_S = 540.0
"""Time that a run waits for disk space before a notification is sent, in seconds; the disk is checked every 10 min."""


class LongWaits:
    """Progress listener that notifies once of a long wait for disk space, and forwards all other events.

    At first it says which channels there are not: when the run has ended, it is too late for that. Other waits end by
    themselves, when jobs do; of the end of the run is told as always.

    Args:
        name: Name of the specification.
        settings: Settings that say who is notified, and when.
        listener: Is given every event, and what channel did not take the message.
        clock: Seconds.
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
        """Handles a progress event of a run: notices long waits for disk space, and forwards the event."""
        self._listener(event)
        if isinstance(event, StepProgress):
            self._since_s = (self._since_s or self._clock()) if event.waits_for == "disk" else None
        elif isinstance(event, Note) and not self._is_told and self._waited_s() >= AFTER_S:
            self._is_told = True
            self._tell(event.text)

    def _waited_s(self) -> float:
        """Returns how long the run has waited for disk space, in seconds; negative if it is not waiting."""
        return -1.0 if self._since_s is None else self._clock() - self._since_s

    def _tell(self, why: str) -> None:
        """Sends a notification that a run waits for disk space; tells the listener of channels that failed.

        It never raises an error, as a message is not worth a run.
        """
        body = f"{why}\n\nIt goes on by itself when there is room; robomaker gc removes old runs."
        message = Message(f"{self._name}: waits for disk", body, good=False)
        try:
            problems = send(self._settings.notify, message, {})
        except Exception as error:
            _logger.exception("no message could be sent about a wait of %s", self._name)
            problems = [f"{type(error).__name__}: {error}"]
        for problem in problems:
            self._listener(Note(f"not notified: {problem}"))
