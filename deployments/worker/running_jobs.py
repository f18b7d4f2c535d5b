"""Runs the jobs of this process: starts them, retries failed ones later, and fails them after too many attempts."""

import logging
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import httpx
from prefect.exceptions import PrefectException

from ...flows import lookup
from ...schemas.lifecycles import is_terminal
from ...schemas.wire.errors import RobomakerError, ServiceError, ServiceUnavailableException
from ...tasks.catalog import Resource
from ...tasks.execution.leases.giving_up import fail_job
from ...tasks.execution.leases.held_leases import HELD, HeldLeases, WorkerStopping
from ...tasks.execution.leases.leased_runs import run_under_lease
from ...tasks.jobs.job_owners import needs_elsewhere, standing_of
from ...tasks.service.service import Service
from .flow_runs import mark_crashed
from .job_pools import JobPool
from .prefect_watch import PrefectWatch

MOST_TRIES = 3
"""Limit on how many times a job's flow run may raise before the job fails; outages of services do not count."""

_LOOK_AGAIN_S = 60.0

_UNAVAILABLE = (httpx.HTTPError, PrefectException, ServiceUnavailableException, lookup.PrefectServerLostError)

_logger = logging.getLogger(__name__)


@dataclass
class _Trouble:
    """Failures of one job so far, and the time before which it is not retried."""

    failures: int = 0
    defects: int = 0
    not_before: float = 0.0


@dataclass
class Jobs:
    """Runs jobs in this process, each as a Prefect flow run in a thread.

    Args:
        service: The service, with its catalog and object store.
        changed: Called when one has ended, from its thread.
        prefect: Watches the server that flow runs need.
        held: Record of the leases that this process holds.
        find_flow: Finds what performs the jobs of an operation.
    """

    service: Service
    changed: Callable[[], None]
    prefect: PrefectWatch
    held: HeldLeases = field(default_factory=lambda: HELD)
    find_flow: Callable[[str], Callable[[str], object]] = lambda operation: partial(lookup.perform, operation)
    left: dict[str, str] = field(default_factory=dict[str, str])
    """Reasons why this process cannot run jobs that other processes ordered for themselves, by ARN."""

    _left_since_s: float = field(default_factory=time.monotonic)
    _told: set[str] = field(default_factory=set[str])
    _running: dict[str, JobPool] = field(default_factory=dict)
    _troubles: dict[str, _Trouble] = field(default_factory=dict)

    def counts(self) -> Counter[str]:
        """Returns the numbers of running jobs of this worker, by kind."""
        return Counter(pool.kind for pool in list(self._running.values()))

    def begin_some(self, pool: JobPool) -> None:
        """Starts the oldest waiting jobs of a pool, as many as may run.

        Raises:
            ServiceUnavailableException: The catalog does not answer.
        """
        free = pool.at_once - self.counts()[pool.kind]
        if free <= 0:
            return
        paused = {arn for arn, trouble in list(self._troubles.items()) if trouble.not_before > time.monotonic()}
        known_left = -1
        while free > 0 and len(self.left) > known_left:  # those that are left may have hidden others
            known_left = len(self.left)
            for job in self.service.catalog.unfinished([pool.kind], limit=free + len(paused), without=self.left):
                if free > 0 and job.arn not in paused and not self._leaves(job) and self._reserve(job):
                    self._begin(pool, job)
                    free -= 1

    def renew_reservations(self) -> None:
        """Renews the leases of jobs whose flow runs have not started yet."""
        for arn in list(self._running):
            self.held.renew_reservation(arn, self.service.catalog, self.service.timing.lease_s)

    def look_again(self) -> None:
        """Forgets, once a minute, which jobs this process could not run, so that they are checked again."""
        if time.monotonic() - self._left_since_s > _LOOK_AGAIN_S:
            self._left_since_s = time.monotonic()
            self.left.clear()

    def _leaves(self, job: Resource) -> bool:
        """Whether a job is left to a process with another environment; it is checked again a minute later.

        If a command has to be run for that, the command is kept for the health page, and logged once.
        """
        ownership = self.service.catalog.ownerships([job.arn]).get(job.arn)
        if ownership is None or not needs_elsewhere(ownership.needed_environment, self.service):
            return False
        if (standing := standing_of(job, self.service)) is not None and standing.waits_for_command:
            self.left[job.arn] = f"on {standing.machine}: {standing.command}"
            if job.arn not in self._told:
                self._told.add(job.arn)
                _logger.warning("%s was %s; go on with it %s", job.id, standing.in_words(), self.left[job.arn])
        return True

    def _reserve(self, job: Resource) -> bool:
        return self.held.reserve(job.arn, self.service.catalog, self.service.timing.lease_s)

    def _begin(self, pool: JobPool, job: Resource) -> None:
        self._running[job.arn] = pool
        threading.Thread(target=self._run, args=(pool, job), name=job.id, daemon=True).start()

    def _run(self, pool: JobPool, job: Resource) -> None:
        began = time.monotonic()
        _logger.info("%s: begun", job.id)
        try:
            if self.service.catalog.lost_workers(job.arn):
                mark_crashed([job.id], "its job worker died; the job is run again")
            self._run_flow(pool, job.arn)
        except WorkerStopping:
            return
        except BaseException as error:
            self._note(pool, job, error)
        else:
            self._troubles.pop(job.arn, None)
            self._log_end(job, time.monotonic() - began)
        finally:
            self._end(job.arn)

    def _run_flow(self, pool: JobPool, arn: str) -> None:
        with self.service.activated():
            self.find_flow(pool.operation)(arn)

    def _log_end(self, job: Resource, duration_s: float) -> None:
        try:
            status = self.service.catalog.get(job.arn).status
        except ServiceError as error:
            _logger.warning("%s: how it ended is not known: %s", job.id, error)
        else:
            _logger.info("%s: %s after %.1f s", job.id, status, duration_s)

    def _note(self, pool: JobPool, job: Resource, error: BaseException) -> None:
        """Decides whether a job whose flow run raised an error is retried after a pause, or fails after several errors.

        Errors that come from a server that is away do not count. A job that has ended is only logged.
        """
        try:
            if is_terminal(job.kind, self.service.catalog.get(job.arn).status):
                _logger.warning("%s has ended; Prefect may not show it so: %s", job.id, error)
                return
        except ServiceError as unknown:
            _logger.debug("%s: %s", job.id, unknown)
        trouble = self._troubles.setdefault(job.arn, _Trouble())
        trouble.failures += 1
        pause_s = min(self.service.timing.longest_retry_pause_s, 2.0**trouble.failures)
        trouble.not_before = time.monotonic() + pause_s
        # Prefect's client has several ways of saying that its server is gone.
        if not isinstance(error, _UNAVAILABLE) and self.prefect.looked_at_now():
            trouble.defects += 1
        words = f"{type(error).__name__}: {error}"
        if trouble.defects >= MOST_TRIES:
            self._fail_job(pool, job, f"running it failed {trouble.defects} times: {words}")
        else:
            _logger.warning("%s: running it failed, and is tried again in %g s: %s", job.id, pause_s, words)

    def _fail_job(self, pool: JobPool, job: Resource, reason: str) -> None:
        self._troubles.pop(job.arn, None)
        _logger.error("%s: the job is not tried again: %s", job.id, reason)
        try:
            self.held.cancel_reservation(job.arn, self.service.catalog)
            run_under_lease(job.arn, pool.kind, self.service, lambda lease: fail_job(lease, reason, self.service))
        except RobomakerError as error:
            _logger.warning("%s: the job could not be marked as failed: %s", job.id, error)

    def _end(self, arn: str) -> None:
        try:
            self.held.cancel_reservation(arn, self.service.catalog)
        except ServiceError as error:
            _logger.warning("a lease is not given back; it runs out by itself: %s", error)
        finally:
            self._running.pop(arn, None)
            self.changed()
