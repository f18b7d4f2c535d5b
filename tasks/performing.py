"""Performing a stored job exactly once at a time, whoever tries.

Every job operation has a perform half that carries a stored job to its end. Several may try: the
flow that made the job, a worker that was handed it, someone who resumes after a crash. A lease in
the catalog lets one of them work; the others wait for the end, or take over when the lease of a
dead one runs out.
"""

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from ..schemas.errors import ServiceUnavailableException, StateConflictError
from ..schemas.lifecycles import is_terminal
from .catalog import Resource
from .giving_up import give_up, why_hopeless
from .held_leases import HELD
from .service import Service

LEASE_S = 30.0
"""How long after its last sign of life a performer counts as dead."""
_RENEWALS = 6  # how often a lease is renewed before it would run out
_WAIT_S = 0.5

_logger = logging.getLogger(__name__)


class Lease:
    """The right to change one job, held by one performer.

    Changes made through it fail with `StateConflictError` once another performer has taken over.

    Args:
      job: the job as it was when the lease was taken.
      owner: who holds the lease.
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
        """Whether another performer has taken over, because this one was held up for too long."""
        return self._lost.is_set()

    @contextmanager
    def renewed(self) -> Iterator[None]:
        """Keeps the lease inside the block, and gives it back at its end."""
        renewer = threading.Thread(target=self._renew, name=f"lease of {self.job.arn}", daemon=True)
        renewer.start()
        try:
            yield
        finally:
            self._ended.set()
            renewer.join()
            self._service.catalog.release(self.job.arn, self._owner)

    def transition(self, event: str, **changes: Any) -> Resource:
        """Moves the job on and sets members of its document; returns the job, which `job` is from then on."""
        with self._noticing_loss():
            catalog, arn = self._service.catalog, self.job.arn
            self.job = catalog.transition(arn, event, document_changes=changes, owner=self._owner)
        return self.job

    def update(self, changes: Callable[[dict[str, Any]], dict[str, Any]]) -> Resource:
        """Changes the job's document; safe to call from several threads."""
        with self._noticing_loss():
            self.job = self._service.catalog.update(self.job.arn, changes, owner=self._owner)
        return self.job

    def refreshed(self) -> Resource:
        """The job as it is now."""
        self.job = self._service.catalog.get(self.job.arn)
        return self.job

    @contextmanager
    def _noticing_loss(self) -> Iterator[None]:
        """Finds out about a change that was refused whether it was for want of the lease, before any clean-up."""
        try:
            yield
        except StateConflictError:
            with suppress(ServiceUnavailableException):
                if not self._service.catalog.renew(self.job.arn, self._owner, LEASE_S):
                    self._lost.set()
            raise

    def _renew(self) -> None:
        while not self._ended.wait(LEASE_S / _RENEWALS):
            try:
                if not self._service.catalog.renew(self.job.arn, self._owner, LEASE_S):
                    self._lost.set()
                    return
            except ServiceUnavailableException as error:
                _logger.warning("the lease of %s is not renewed: %s", self.job.arn, error)


def perform_once(arn: str, kind: str, service: Service, work: Callable[[Lease], None]) -> None:
    """Runs `work` on a job unless it has ended, holding its lease meanwhile.

    Args:
      arn: the job.
      kind: the resource kind it has to be.
      service: where it is stored.
      work: carries the job on from wherever it stands to a terminal state.

    Raises:
      ResourceNotFoundException: there is no such job.
    """
    while not perform_if_idle(arn, kind, service, work):
        time.sleep(_WAIT_S)


def perform_if_idle(arn: str, kind: str, service: Service, work: Callable[[Lease], None]) -> bool:
    """Runs `work` on a job if it has not ended and nobody performs it.

    Args:
      arn: the job.
      kind: the resource kind it has to be.
      service: where it is stored.
      work: carries the job on, holding its lease.

    Returns:
      Whether there is nothing to wait for: `work` was run, or the job had ended; false if another
      performs it.

    Raises:
      ResourceNotFoundException: there is no such job.
      PerformerEnding: this process is about to end.
    """
    job = service.catalog.get(arn, kind=kind)
    if is_terminal(job.kind, job.status):
        return True
    with HELD.owner_of(arn) as owner:
        if not service.catalog.claim(arn, owner, LEASE_S):
            return False
        lease = Lease(job, owner, service)
        with lease.renewed():
            if is_terminal(kind, lease.refreshed().status):
                return True
            if reason := why_hopeless(lease, service):
                give_up(lease, reason, service)
            else:
                work(lease)
    return True
