"""Cancellation of an upload: a job that was cancelled, or whose batch was, stores no more outputs."""

import logging
import threading
import time
from collections.abc import Callable

from ....schemas.documents.simulation_jobs import SimulationJobDocument
from ....schemas.runs.programs import StopReason
from ....schemas.wire.errors import (
    ServiceUnavailableException,
)
from ...catalog import Catalog

_logger = logging.getLogger(__name__)

_ASK_EVERY_S = 0.2
"""Seconds between two checks in the catalog for a cancellation, as often as during a run; the threads of an upload ask
thousands of times a second.
"""


class UploadEnd:
    """Checks whether a job or its batch was cancelled since its upload began, so that the upload has to stop.

    A timeout of the batch lets uploads finish.

    Args:
        job: ARN of the job.
        batch: ARN of its batch; `None`: it has none.
        catalog: The catalog.
        why_stop: Function that returns the reason why the job has to end, or `None`.
    """

    def __init__(
        self,
        job: str,
        batch: str | None,
        catalog: Catalog,
        why_stop: Callable[[], StopReason | None],
    ) -> None:
        self._job = job
        self._batch = batch
        self._catalog = catalog
        self._why_stop = why_stop
        self._ended_by = why_stop()
        self._lock = threading.Lock()
        self._next_s = time.monotonic() + _ASK_EVERY_S
        self._heard = False

    def __call__(self) -> bool:
        """Whether the upload has to end because the job or its batch was cancelled, as far as the last look knows.

        One thread asks the catalog again when it is time, and the others get the last answer without waiting.
        """
        if not self._heard and time.monotonic() >= self._next_s and self._lock.acquire(blocking=False):
            try:
                self._heard = self._is_canceled()
                self._next_s = time.monotonic() + _ASK_EVERY_S
            finally:
                self._lock.release()
        return self._heard

    def _is_canceled(self) -> bool:
        try:
            if self._ended_by is StopReason.CANCELED:
                return SimulationJobDocument.of(self._catalog.get(self._job)).upload_canceled
            reason = self._why_stop()
            if reason is StopReason.BATCH_CANCELED and self._batch is not None:
                # A job worker that ends may stop its jobs, too; the next one goes on with them.
                return reason is not self._ended_by and self._catalog.cancel_requested(self._batch)
            return reason is StopReason.CANCELED
        except ServiceUnavailableException as error:  # it is asked again at once
            _logger.warning("whether the upload of %s is to end is not known: %s", self._job, error)
            return False
