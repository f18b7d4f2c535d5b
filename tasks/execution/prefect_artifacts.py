"""Prefect artifacts of a run: progress, tables, a summary, pictures.

Artifacts only inform: when one cannot be made, a warning is logged and the run goes on.
"""

import base64
import logging
import re
import threading
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any
from uuid import UUID

import httpx
from prefect.artifacts import (
    create_image_artifact,
    create_markdown_artifact,
    create_progress_artifact,
    create_table_artifact,
    update_progress_artifact,
)
from prefect.context import FlowRunContext
from prefect.exceptions import PrefectException

from ...schemas.reports.progress import FINISHED
from ..service.service import Progress, Service

_UPDATE_S = 1.0  # an update costs the server several milliseconds
_MAX_PICTURE_BYTES = 2_000_000

_logger = logging.getLogger(__name__)


@contextmanager
def shown_progress(service: Service, description: str) -> Generator[Service]:
    """Yields the service with its progress shown as a Prefect progress artifact of the running flow."""
    bar = _Bar(description, service.report_progress)
    try:
        yield service.watched_by(bar)
    finally:
        bar.flush()


def artifact_key(*words: str) -> str:
    """Returns a key for a Prefect artifact made of some words: small letters and digits, joined by single hyphens."""
    return re.sub("[^a-z0-9]+", "-", "-".join(words).lower()).strip("-")


def show_table(key: str, rows: Sequence[Mapping[str, Any]], description: str) -> None:
    """Shows rows as a table artifact of the current task or flow run in Prefect.

    Does nothing without rows or outside a flow run. Errors of the Prefect server are logged and not raised.
    """
    if rows and FlowRunContext.get():
        with _logged(description):
            create_table_artifact(key=key, table=[dict(row) for row in rows], description=description)


def show_text(key: str, markdown: str, description: str) -> None:
    """Shows a text as a Markdown artifact in Prefect; does nothing outside a flow run.

    Errors of the Prefect server are logged and not raised.
    """
    if FlowRunContext.get():
        with _logged("text"):
            create_markdown_artifact(key=key, markdown=markdown, description=description)


def show_picture(key: str, png: bytes, description: str) -> None:
    """Shows a PNG of at most 2 MB as an image artifact in Prefect; a larger one is left out.

    Does nothing outside a flow run. Errors of the Prefect server are logged and not raised.
    """
    if png and len(png) <= _MAX_PICTURE_BYTES and FlowRunContext.get():
        url = "data:image/png;base64," + base64.b64encode(png).decode()
        with _logged("picture"):
            create_image_artifact(key=key, image_url=url, description=description)


@contextmanager
def _logged(what: str) -> Generator[None]:
    """Catches and logs errors of the Prefect server about artifacts inside the `with` block."""
    try:
        yield
    except (httpx.HTTPError, PrefectException) as error:
        _logger.warning("the %s cannot be shown in Prefect: %s", what, error)


class _Bar:
    """Listener that passes progress on, and shows it in a Prefect progress artifact, once a second at most."""

    def __init__(self, description: str, listener: Callable[[Progress], None]) -> None:
        self._description = description
        self._listener = listener
        self._lock = threading.Lock()
        self._artifact: UUID | None = None
        self._latest: Progress | None = None
        self._shown_at = 0.0

    def __call__(self, progress: Progress) -> None:
        self._listener(progress)
        self._latest = progress
        if self._lock.acquire(blocking=False):
            try:
                if time.monotonic() - self._shown_at >= _UPDATE_S:
                    self._show(progress)
            finally:
                self._lock.release()

    def flush(self) -> None:
        """Writes the latest progress to the Prefect artifact at once; does nothing if there is none yet."""
        if self._latest is not None:
            with self._lock:
                self._show(self._latest)

    def _show(self, progress: Progress) -> None:
        if FlowRunContext.get() is None:
            return
        done = sum(count for state, count in progress.counts.items() if state.lower() in FINISHED)
        if progress.trials is not None:  # they say more exactly how far it is
            done, total = progress.trials.work
        else:
            total = progress.total
        percent = 100.0 * done / max(total, 1)
        self._shown_at = time.monotonic()
        with _logged("progress"):
            if self._artifact is None:
                made = create_progress_artifact(progress=percent, description=self._description)
                self._artifact = made if isinstance(made, UUID) else None
            else:
                update_progress_artifact(artifact_id=self._artifact, progress=percent)
