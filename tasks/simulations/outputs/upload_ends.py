"""When the upload of a run's outputs is to end: its job, or the job's batch, is cancelled while it goes on."""

import logging
import threading
import time
from collections.abc import Callable

from ....schemas.documents.simulation_jobs import SimulationJobDocument
from ....schemas.runs.stops import StopReason
from ....schemas.wire.errors import ServiceUnavailableException
from ...catalog import Catalog

_ASK_EVERY_S = 0.2
"""The threads of an upload ask thousands of times a second; the catalog is asked as often as while a job runs."""

_CANCELED = (StopReason.CANCELED, StopReason.BATCH_CANCELED)

_logger = logging.getLogger(__name__)


class UploadEnd:
    """Says whether a job or its batch was cancelled since its upload began: again, if that is why its run ended.

    A batch whose time is over lets uploads finish.

    Args:
        job: ARN of the job.
        batch: ARN of its batch; `None`: it has none.
        catalog: where it is stored.
        why_stop: why the job has to end; `None` if it does not have to.
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
        self._was_canceled = why_stop() in _CANCELED
        self._lock = threading.Lock()
        self._next_s = time.monotonic() + _ASK_EVERY_S
        self._heard = False

    def __call__(self) -> bool:
        """The last answer; one thread asks again when it is time, and no other waits for it."""
        if not self._heard and time.monotonic() >= self._next_s and self._lock.acquire(blocking=False):
            try:
                self._heard = self._is_canceled()
                self._next_s = time.monotonic() + _ASK_EVERY_S
            finally:
                self._lock.release()
        return self._heard

    def _is_canceled(self) -> bool:
        try:
            if not self._was_canceled:
                reason = self._why_stop()
                if reason is StopReason.BATCH_CANCELED and self._batch is not None:
                    # Jobs of a batch whose lease is lost have to stop, too; the process that has it goes on with them.
                    return self._catalog.cancel_requested(self._batch)
                return reason is StopReason.CANCELED
            return SimulationJobDocument.of(self._catalog.get(self._job)).upload_canceled
        except ServiceUnavailableException as error:  # it is asked again at once
            _logger.warning("whether the upload of %s is to end is not known: %s", self._job, error)
            return False
