"""Telling of a run that has ended: finds the run before it, what failed and the pictures, and sends the message."""

import logging
import re
from collections.abc import Callable, Iterable

from pydantic import ValidationError

from ...schemas.documents.simulation_jobs import SimulationJobDocument
from ...schemas.documents.worlds import StoredPlace, WorldDocument
from ...schemas.reports.progress import Note, ProgressListener
from ...schemas.reports.run_record import JobRecord, RunRecord
from ...schemas.runs.plan import RunResult
from ...schemas.wire.errors import RobomakerError
from ..service.service import Service
from .messages import WORST, Failure, failed_jobs, is_due, message_of, worst_first
from .sending import send

_POSTER, _PREVIEW = "poster.png", "preview.png"
_MOST_READ = 200
"""Failures whose results are read; the worst of these are told."""

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
        before = run_before(record, service)
        if is_due(service.settings.notify_when, record, before):
            failures = worst_first([_failure(job, service) for job in failed_jobs(record)[:_MOST_READ]])
            message = message_of(record, failures, before)
            problems = send(service.settings.notify, message, _pictures(failures[:WORST], service))
        else:
            problems = []
    except Exception as error:
        _logger.exception("no message could be sent about %s", record.run_id)
        problems = [f"{type(error).__name__}: {error}"]
    for problem in problems:
        listener(Note(f"not notified: {problem}"))


def run_before(record: RunRecord, service: Service) -> RunRecord | None:
    """The last run of the same specification that ended before a run began, and was not cancelled."""
    earlier: list[RunRecord] = []
    for path in (service.settings.home / "runs").glob(f"{record.name}-*/run.json"):
        # Runs of `night-two` begin with `night-` too.
        if re.fullmatch(r"\d{8}T\d{9}", path.parent.name.removeprefix(f"{record.name}-")):
            earlier += _read(path.read_bytes)
    earlier = [each for each in earlier if each.ended_at <= record.started_at and each.state != "canceled"]
    return max(earlier, key=lambda each: each.ended_at, default=None)


def _read(content: Callable[[], bytes]) -> Iterable[RunRecord]:
    try:
        return [RunRecord.model_validate_json(content())]
    except (OSError, ValidationError):
        return []


def _failure(job: JobRecord, service: Service) -> Failure:
    if (place := _place(job, service)) is None:
        return Failure(job)
    try:
        result = RunResult.model_validate_json(service.store.get_bytes(place.bucket, f"{place.prefix}/result.json"))
    except (RobomakerError, ValidationError):
        return Failure(job)
    return Failure(job, tuple(each for each in result.requirements if each.counts and not each.satisfied))


def _pictures(failures: Iterable[Failure], service: Service) -> dict[str, bytes]:
    """A picture of each failure: of its video, else of its world."""
    pictures: dict[str, bytes] = {}
    for number, failure in enumerate(failures, start=1):
        places = [(_place(failure.job, service), _POSTER), (_bundle(failure.job, service), _PREVIEW)]
        for place, name in places:
            if place is not None and (picture := _fetched(place, name, service)):
                pictures[f"{number}-{re.sub('[^A-Za-z0-9-]+', '-', failure.job.label)}.png"] = picture
                break
    return pictures


def _fetched(place: StoredPlace, name: str, service: Service) -> bytes:
    try:
        return service.store.get_bytes(place.bucket, f"{place.prefix}/{name}")
    except RobomakerError:
        return b""


def _place(job: JobRecord, service: Service) -> StoredPlace | None:
    stored = service.catalog.get_many([job.arn]) if job.arn else {}
    return SimulationJobDocument.of(stored[job.arn]).outputs if job.arn in stored else None


def _bundle(job: JobRecord, service: Service) -> StoredPlace | None:
    """Where the bundle of the world is that a job drove in."""
    stored = service.catalog.get_many([job.arn]) if job.arn else {}
    if job.arn not in stored:
        return None
    applications = SimulationJobDocument.of(stored[job.arn]).request.get("simulationApplications") or [{}]
    worlds = applications[0].get("worldConfigs") or [{}]
    arn = worlds[0].get("world")
    world = service.catalog.get_many([arn]).get(arn) if arn else None
    return WorldDocument.of(world).bundle if world is not None else None
