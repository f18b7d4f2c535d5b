"""The lease of a stored job: the right of one job worker to change it, renewed while the job runs."""

import logging
import threading
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager, suppress

from ....schemas.documents.document_base import Changes
from ....schemas.wire.errors import LeaseLostError, ServiceUnavailableException, StateConflictError
from ...catalog import Resource, Stored
from ...service.service import Service

_logger = logging.getLogger(__name__)


class Lease:
    """A held lease: the right of one job worker to change one job in the catalog.

    Changes made through it fail with `LeaseLostError` once another worker has taken over.

    Args:
        job: The job as it was when the lease was taken.
        owner: Name of the lease's holder.
        service: The service, with its catalog and object store.
    """

    def __init__(self, job: Resource, owner: str, service: Service) -> None:
        self.job = job
        self._owner = owner
        self._service = service
        self._ended = threading.Event()
        self._lost = threading.Event()

    @property
    def lost(self) -> bool:
        """Whether another job worker has taken over the job, because this one was stalled for too long."""
        return self._lost.is_set()

    @contextmanager
    def renewed(self) -> Generator[None]:
        """Renews the lease (lock of the job) in a thread inside the `with` block, and releases it at the end.

        If the catalog is away at the end, that is logged, and the lease runs out by itself.
        """
        renewer = threading.Thread(target=self._renew, name=f"lease of {self.job.arn}", daemon=True)
        renewer.start()
        try:
            yield
        finally:
            self._ended.set()
            renewer.join()
            try:
                self._service.catalog.release(self.job.arn, self._owner)
            except ServiceUnavailableException as error:
                _logger.warning("the lease of %s runs out by itself: %s", self.job.arn, error)

    def transition(
        self, event: str, changes: Changes | None = None, labels: Mapping[str, Sequence[str]] | None = None
    ) -> Resource:
        """Applies an event to the job's status, updates its document and labels, and returns the updated job.

        Args:
            event: Event of the kind's lifecycle, such as `start`.
            changes: Members of the document to set.
            labels: Labels that replace the job's.

        Raises:
            LeaseLostError: Another job worker has taken the job over.
            StateConflictError: The event is not possible in the job's status.
        """
        with self._noticing_loss():
            catalog, arn = self._service.catalog, self.job.arn
            self.job = catalog.transition(arn, event, document_changes=changes, owner=self._owner, labels=labels)
        return self.job

    def update(self, changes: Changes | Callable[[Stored], Changes]) -> Resource:
        """Sets members of the job's document in the catalog, and returns the updated job; several threads may call it.

        Raises `LeaseLostError` if another job worker has taken the job over. See `Catalog.update`.
        """
        with self._noticing_loss():
            self.job = self._service.catalog.update(self.job.arn, changes, owner=self._owner)
        return self.job

    def forget_lost_workers(self) -> None:
        """Resets the count of job workers that died while running this job, because it has made progress."""
        self._service.catalog.forget_lost_workers(self.job.arn, self._owner)

    def refreshed(self) -> Resource:
        """Reads the job again from the catalog, and returns it."""
        self.job = self._service.catalog.get(self.job.arn)
        return self.job

    @contextmanager
    def _noticing_loss(self) -> Generator[None]:
        """Checks after a refused change inside the `with` block whether the lease was lost, and marks it as lost then.

        Raises `LeaseLostError` if it was, else the `StateConflictError` of the change.
        """
        try:
            yield
        except StateConflictError as error:
            with suppress(ServiceUnavailableException):
                if not self._renew_once():
                    self._lost.set()
            if self.lost:
                raise LeaseLostError(
                    f"{self.job.arn} was taken over by another process, which goes on with it"
                ) from error
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
        """Renews the lease once, unless another worker holds it; returns whether it is still held."""
        return self._service.catalog.renew(self.job.arn, self._owner, self._service.timing.lease_s)
