"""The lease of a stored job: the right to change it, renewed by a thread while it is held.

How long it lasts and how often it is renewed is in `tasks/service/timing.py`.
"""

import logging
import threading
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager, suppress

from ...schemas.documents.base import Changes
from ...schemas.wire.errors import ServiceUnavailableException, StateConflictError
from ..catalog import Resource, Stored
from ..service.service import Service

_logger = logging.getLogger(__name__)


class Lease:
    """The right to change one job, held by one job worker.

    Changes made through it fail with `StateConflictError` once another worker has taken over.

    Args:
        job: the job as it was when the lease was taken.
        owner: name of the lease's holder.
        service: where the job is stored.
    """

    def __init__(self, job: Resource, owner: str, service: Service) -> None:
        self.job = job
        self._owner = owner
        self._service = service
        self._ended = threading.Event()
        self._lost = threading.Event()

    @property
    def lost(self) -> bool:
        """Whether another worker has taken over, because this one was held up for too long."""
        return self._lost.is_set()

    @contextmanager
    def renewed(self) -> Generator[None]:
        """Renews the lease inside the block, and releases it at its end."""
        renewer = threading.Thread(target=self._renew, name=f"lease of {self.job.arn}", daemon=True)
        renewer.start()
        try:
            yield
        finally:
            self._ended.set()
            renewer.join()
            self._service.catalog.release(self.job.arn, self._owner)

    def transition(
        self, event: str, changes: Changes | None = None, labels: Mapping[str, Sequence[str]] | None = None
    ) -> Resource:
        """Moves the job on, sets members of its document and labels; returns the job, which `job` is from then on."""
        with self._noticing_loss():
            catalog, arn = self._service.catalog, self.job.arn
            self.job = catalog.transition(arn, event, document_changes=changes, owner=self._owner, labels=labels)
        return self.job

    def update(self, changes: Changes | Callable[[Stored], Changes]) -> Resource:
        """Sets members of the job's document, see `Catalog.update`; safe to call from several threads."""
        with self._noticing_loss():
            self.job = self._service.catalog.update(self.job.arn, changes, owner=self._owner)
        return self.job

    def forget_lost_workers(self) -> None:
        """Says that the job has come further than when its job workers died."""
        self._service.catalog.forget_lost_workers(self.job.arn, self._owner)

    def refreshed(self) -> Resource:
        """The job as it is now."""
        self.job = self._service.catalog.get(self.job.arn)
        return self.job

    @contextmanager
    def _noticing_loss(self) -> Generator[None]:
        """Checks after a refused change whether the lease was lost, before any cleanup."""
        try:
            yield
        except StateConflictError:
            with suppress(ServiceUnavailableException):
                if not self._renew_once():
                    self._lost.set()
            raise

    def _renew(self) -> None:
        while not self._ended.wait(self._service.timing.renew_lease_every_s):
            try:
                if not self._renew_once():
                    self._lost.set()
                    return
            except ServiceUnavailableException as error:
                _logger.warning("the lease of %s is not renewed: %s", self.job.arn, error)

    def _renew_once(self) -> bool:
        """Renews the lease, unless another holds it."""
        return self._service.catalog.renew(self.job.arn, self._owner, self._service.timing.lease_s)
