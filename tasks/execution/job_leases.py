"""The lease of a stored job: the right to change it, renewed by a thread while it is held.

How long it lasts and how often it is renewed is in `tasks/service/timing.py`.
"""

import logging
import threading
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import TypeVar

from ...schemas.documents.base import Changes
from ...schemas.wire.errors import LeaseLostError, ServiceUnavailableException, StateConflictError
from ..catalog import Resource, Stored
from ..service.service import Service

Result = TypeVar("Result")
_logger = logging.getLogger(__name__)

_MOST_REFUSALS = 3
"""After so many failures in a row, each of which was none of being away, waiting would be of no use."""


class Lease:
    """The right to change one job, held by one job worker.

    Changes made through it fail with `LeaseLostError` once another worker has taken over.

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
        """Renews the lease inside the block, and releases it at its end; where that fails, it runs out by itself."""
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
        """Renews the lease, unless another holds it."""
        return self._service.catalog.renew(self.job.arn, self._owner, self._service.timing.lease_s)


class CatalogWait:
    """Waits for a catalog that is away; one that answers, and still refuses a change, is soon given up.

    Args:
        arn: what waits, for the log.
        look: reads the catalog.
        is_over: whether to wait no more.
        pause_s: how long after it did not answer it is asked again.
    """

    def __init__(self, arn: str, look: Callable[[], object], is_over: Callable[[], bool], pause_s: float) -> None:
        self._arn, self._look, self._is_over, self._pause_s = arn, look, is_over, pause_s
        self._refusals = 0

    @classmethod
    def of(cls, lease: Lease, service: Service) -> "CatalogWait":
        """For the work on a job, which it reads anew: the answer to a change may have been lost."""
        return cls(lease.job.arn, lease.refreshed, lambda: lease.lost, service.timing.after_outage_s)

    def outlasting(self, call: Callable[[], Result]) -> Result:
        """Calls again until the catalog answers.

        Args:
            call: does the same when it is called again, whether or not the catalog had done it.

        Raises:
            ServiceUnavailableException: as `outlast`.
        """
        while True:
            try:
                return call()
            except ServiceUnavailableException as error:
                self.outlast(error)

    def outlast(self, failure: ServiceUnavailableException) -> None:
        """Returns once the catalog answers again.

        Args:
            failure: how the outage was noticed.

        Raises:
            ServiceUnavailableException: `failure`, when waiting is over, or when the catalog was never away the last
                times: its disk may be full.
        """
        _logger.warning("%s waits for the catalog: %s", self._arn, failure)
        was_away = False
        while not self._is_over():
            time.sleep(self._pause_s)
            try:
                self._look()
            except ServiceUnavailableException as still:
                was_away = True
                _logger.debug("the catalog is still away: %s", still)
                continue
            self._refusals = 0 if was_away else self._refusals + 1
            if self._refusals < _MOST_REFUSALS:
                return
            break
        raise failure
