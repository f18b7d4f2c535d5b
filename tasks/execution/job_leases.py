"""Leases of stored jobs: at most one worker runs a job at a time; a job whose workers keep dying fails."""

import logging
import threading
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TypeVar

from ...schemas.documents.document_base import Changes, FailureChanges
from ...schemas.documents.simulation_jobs import Outcome
from ...schemas.lifecycles import LIFECYCLES, is_terminal
from ...schemas.wings import parts_of_wings
from ...schemas.wire.errors import LeaseLostError, ServiceUnavailableException, StateConflictError
from ..catalog import Resource, Stored
from ..service.service import Service
from ..service.spans import span
from .held_leases import HELD, HeldLeases

Result = TypeVar("Result")
_logger = logging.getLogger(__name__)

_MAX_REFUSALS = 3
"""Limit of consecutive failures of a catalog that answers, after which waiting for it is of no use."""


class Lease:
    """A held lease: the right of one job worker to change one job in the catalog.

    Changes made through it fail with `LeaseLostError` once another worker has taken over.

    Args:
        job: the job as it was when the lease was taken.
        owner: name of the lease's holder.
        service: the service, with its catalog and object store.
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
        """Renews the lease regularly inside the `with` block, and releases it at the end."""
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
        """Applies an event to the job's status and updates its document and labels; returns the updated job."""
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
        """Resets the count of job workers that died while running this job, because it has made progress."""
        self._service.catalog.forget_lost_workers(self.job.arn, self._owner)

    def refreshed(self) -> Resource:
        """Reads the job again from the catalog, and returns it."""
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
        """Renews the lease once, unless another worker holds it; returns whether it is still held."""
        return self._service.catalog.renew(self.job.arn, self._owner, self._service.timing.lease_s)


class CatalogWait:
    """Waits and retries while the catalog's database is unreachable.

    A catalog that answers and still refuses a change is soon given up.

    Args:
        arn: ARN of the waiting job, for the log.
        look: reads the catalog.
        is_over: returns whether to stop waiting.
        pause_s: seconds until the next try after the catalog did not answer.
    """

    def __init__(self, arn: str, look: Callable[[], object], is_over: Callable[[], bool], pause_s: float) -> None:
        self._arn, self._look, self._is_over, self._pause_s = arn, look, is_over, pause_s
        self._refusals = 0

    @classmethod
    def of(cls, lease: Lease, service: Service) -> "CatalogWait":
        """Makes the retry policy for work on a job, which reads the job again after an outage."""
        return cls(lease.job.arn, lease.refreshed, lambda: lease.lost, service.timing.after_outage_s)

    def outlasting(self, call: Callable[[], Result]) -> Result:
        """Calls a function, and calls it again after an outage of the catalog's database.

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
        """Waits until the catalog's database answers again.

        Args:
            failure: error by which the outage was noticed.

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
            if self._refusals < _MAX_REFUSALS:
                return
            break
        raise failure


MAX_LOST_WORKERS = 3
_MAX_LOST_WORKERS_OF_BATCH = 10
"""Limit of lost job workers for a batch, higher than for a job: the job at fault reaches its own limit first."""

_CODE = "InternalServiceError"
_EVENTS = ("terminate", "fail", "canceled")


@dataclass(frozen=True)
class GivenUp:
    """Defines how a kind of job is marked as failed from outside, when it cannot be run any more."""

    failure_code: str
    """Failure code that jobs of a kind get when they are given up."""

    tell: Callable[[Resource, Service], None]
    """Function that is called after a given-up job has ended."""


def _given_up(kind: str) -> GivenUp | None:
    return next((part.KINDS[kind] for part in parts_of_wings("tasks", "given_up") if kind in part.KINDS), None)


def why_not_retried(lease: Lease, service: Service) -> str | None:
    """Returns the reason why a job has reached its retry limit; `None` if it may run."""
    most = _MAX_LOST_WORKERS_OF_BATCH if lease.job.kind == "simulation-job-batch" else MAX_LOST_WORKERS
    lost = service.catalog.lost_workers(lease.job.arn)
    if lost < most:
        return None
    return f"{lost} job workers died, one after the other, while they ran this job; it is not begun again"


def fail_job(lease: Lease, reason: str, service: Service) -> None:
    """Ends a job as failed (or canceled, if that was requested), and cancels a batch's jobs."""
    transitions = LIFECYCLES[lease.job.kind].transitions
    own = _given_up(lease.job.kind)
    changes = FailureChanges(failure_code=_CODE if own is None else own.failure_code, failure_reason=reason)
    if lease.job.kind == "simulation-job":
        changes = Outcome(status="Failed", failure_code=_CODE, failure_reason=reason).announced(finished=None)
    for job in service.catalog.children(lease.job.arn, kind="simulation-job"):
        service.catalog.request_cancel(job.arn)
    for event in _EVENTS:
        if (lease.job.status, event) in transitions:
            lease.transition(event, changes)
    if own is not None:
        own.tell(lease.job, service)


_WAIT_S = 0.5


def run_under_lease(
    arn: str, kind: str, service: Service, work: Callable[[Lease], object], held: HeldLeases = HELD
) -> None:
    """Runs a job's work while holding its lease, after waiting for it; does nothing if the job has ended.

    Args:
        arn: the job.
        kind: the resource kind it has to be.
        service: the service, with its catalog and object store.
        work: runs the job from its current state to a terminal state.
        held: record of the leases that this process holds.

    Raises:
        ResourceNotFoundException: the catalog has no such job.
    """
    while True:
        try:
            if run_if_unclaimed(arn, kind, service, work, held):
                return
        except LeaseLostError as error:
            _logger.warning("%s; its end is waited for", error)
        time.sleep(_WAIT_S)


def run_if_unclaimed(
    arn: str, kind: str, service: Service, work: Callable[[Lease], object], held: HeldLeases = HELD
) -> bool:
    """Runs a job's work if the job has not ended and no other job worker holds its lease.

    Args:
        arn: the job.
        kind: the resource kind it has to be.
        service: the service, with its catalog and object store.
        work: carries the job on, holding its lease.
        held: record of the leases that this process holds.

    Returns:
        True when `work` was run or the job had ended; false when another worker holds its lease.

    Raises:
        ResourceNotFoundException: the catalog has no such job.
        LeaseLostError: another job worker took over the job while its work was running.
        WorkerStopping: this process is about to end.
    """
    job = service.catalog.get(arn, kind=kind)
    if is_terminal(job.kind, job.status):
        return True
    with held.owner_of(arn) as owner:
        if not service.catalog.claim(arn, owner, service.timing.lease_s):
            return False
        lease = Lease(job, owner, service)
        with lease.renewed():
            if is_terminal(kind, lease.refreshed().status):
                return True
            if reason := why_not_retried(lease, service):
                fail_job(lease, reason, service)
            else:
                with span(f"run {kind}", arn=arn) as current:
                    _outlast(work, lease, service)
                    current.set_attribute("robomaker.status", lease.job.status)
    return True


def _outlast(work: Callable[[Lease], object], lease: Lease, service: Service) -> None:
    """Runs a job to completion, and continues from its current state after each outage of the catalog.

    Args:
        work: runs the job from its current state to a terminal state.
        lease: the right to change the job.
        service: the service, with its catalog and object store.

    Raises:
        ServiceUnavailableException: another worker took the job over during an outage, or the catalog is there and
            accepts no change.
    """
    wait = CatalogWait.of(lease, service)
    while not is_terminal(lease.job.kind, lease.job.status):
        try:
            work(lease)
        except ServiceUnavailableException as error:
            wait.outlast(error)
        else:
            return
