"""Cleanup after probes and challenges, runs with reduced or changed requests: deletes what only they created.

What they create is noted in a file that is locked while their process lives. The next run finds the files of processes
that were killed, and does what these could not: else a night would take over applications that no one made for it.
"""

import fcntl
import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import TextIO
from uuid import uuid4

from ...schemas.reports.progress import ProgressEvent, ProgressListener, StepEnded, StepStarted
from ...schemas.wire.errors import ResourceNotFoundException, RobomakerError
from ..operations.registry import call
from ..service.service import Service

_logger = logging.getLogger(__name__)

_FOLDER = "cut-runs"
_DELETED_AFTERWARDS = {
    "CreateRobotApplication": ("DeleteRobotApplication", "application"),
    "CreateSimulationApplication": ("DeleteSimulationApplication", "application"),
    "CreateWorldTemplate": ("DeleteWorldTemplate", "template"),
}


@contextmanager
def removing_made(service: Service, listener: ProgressListener) -> Iterator[ProgressListener]:
    """Deletes at the end of the `with` block the applications and templates that a run in it has created.

    Args:
        service: The service, with its catalog and object store.
        listener: Listener of the run's progress.

    Yields:
        The listener that the run has to be given.
    """
    began = service.clock()
    folder = service.settings.home / _FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{uuid4().hex}.jsonl"
    part = path.with_suffix(".part")
    with part.open("x+") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        part.rename(path)  # only now do others find it: it is locked
        try:
            yield _Notes(file, began, listener)
        finally:
            _remove(path, file, service)


def remove_left(service: Service) -> None:
    """Deletes what probes and challenges have created whose processes were killed.

    Args:
        service: The service, with its catalog and object store.
    """
    for path in sorted((service.settings.home / _FOLDER).glob("*.jsonl")):
        try:
            with path.open("r+") as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                _remove(path, file, service)
        except (FileNotFoundError, BlockingIOError):  # another process was quicker, or its own still lives
            continue
        except (OSError, RobomakerError) as error:  # no reason to keep the run that cleans up from beginning
            _logger.warning("what a killed probe or challenge has created is still there: %s: %s", path, error)


class _Notes:
    """Listener that notes what a run creates, and passes its events on."""

    def __init__(self, file: TextIO, began: datetime, listener: ProgressListener) -> None:
        self._file, self._began, self._listener = file, began, listener
        self._operations: dict[str, str] = {}

    def __call__(self, event: ProgressEvent, /) -> None:
        if isinstance(event, StepStarted):
            self._operations[event.step] = event.operation
        elif isinstance(event, StepEnded) and event.detail.startswith("arn:"):
            operation = self._operations.get(event.step, "")
            if operation in _DELETED_AFTERWARDS:
                note = {"operation": operation, "arn": event.detail, "began": self._began.isoformat()}
                self._file.write(json.dumps(note) + "\n")
                self._file.flush()
        self._listener(event)


def _remove(path: Path, file: TextIO, service: Service) -> None:
    """Deletes the resources of which a file has notes, the latest first, and then the file.

    Resources that were there before the note, or are gone, are left alone; so are lines that cannot be read.
    """
    file.seek(0)
    for line in reversed(file.read().splitlines()):
        try:
            note = json.loads(line)
            delete, member = _DELETED_AFTERWARDS[note["operation"]]
            arn, began = str(note["arn"]), datetime.fromisoformat(note["began"])
        except (ValueError, KeyError, TypeError):  # its process was killed while it wrote the line
            continue
        with suppress(ResourceNotFoundException):
            if service.catalog.get(arn).created_at >= began:  # else the run took over what was there
                call(delete, {member: arn}, service)
    path.unlink(missing_ok=True)
