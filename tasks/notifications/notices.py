"""Telling of a run that has ended: finds the run before it, what failed and the pictures, and sends the message."""

import logging
import re
from collections.abc import Sequence

from ...schemas.documents.simulation_jobs import SimulationJobDocument
from ...schemas.documents.worlds import StoredPlace
from ...schemas.reports.progress import Note, ProgressListener
from ...schemas.reports.run_record import JobRecord, RunRecord
from ...schemas.wire.errors import RobomakerError
from ..inspection.run_records import is_night, run_before, since_last_good
from ..service.service import Service
from ..simulations.planning.run_plans import world_arn
from ..worlds.previews import preview_of
from .messages import WORST, failed_jobs, is_due, message_of
from .sending import send

_logger = logging.getLogger(__name__)


def notify_of(record: RunRecord, service: Service, listener: ProgressListener) -> None:
    """Tells of a run that has ended, if the settings ask for it. It never raises: a message is not worth a run.

    Args:
        record: the run, whose record and report are written.
        service: where it is stored; its settings say who is told, and when.
        listener: told of every channel that did not take the message.
    """
    if not service.settings.notify:
        return
    try:
        before = run_before(record)
        since = since_last_good(record) if is_night(record) else None
        if is_due(service.settings.notify_when, record, before, since):
            pictures = _pictures(failed_jobs(record)[:WORST], service)
            problems = send(service.settings.notify, message_of(record, before, since), pictures)
        else:
            problems = []
    except Exception as error:
        _logger.exception("no message could be sent about %s", record.run_id)
        problems = [f"{type(error).__name__}: {error}"]
    for problem in problems:
        listener(Note(f"not notified: {problem}"))


def _pictures(failures: Sequence[JobRecord], service: Service) -> dict[str, bytes]:
    """A picture of each failure: of its video, else of its world."""
    stored = service.catalog.get_many(job.arn for job in failures if job.arn)
    pictures: dict[str, bytes] = {}
    for number, job in enumerate(failures, start=1):
        if job.arn in stored and (picture := _picture(SimulationJobDocument.of(stored[job.arn]), service)):
            pictures[f"{number}-{re.sub('[^A-Za-z0-9-]+', '-', job.label)}.png"] = picture
    return pictures


def _picture(job: SimulationJobDocument, service: Service) -> bytes:
    """A picture of a job; empty if there is none."""
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
