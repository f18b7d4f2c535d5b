"""Job worker for one batch: takes jobs from the catalog and runs them; waits for jobs of others, and counts trials."""

import concurrent.futures
import logging
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack

from ...schemas.documents.document_base import Json
from ...schemas.documents.simulation_jobs import JobTrials, SimulationJobBatchDocument, SimulationJobDocument
from ...schemas.lifecycles import is_terminal
from ...schemas.reports.run_record import CaseOutcome, case_outcome
from ...schemas.runs.programs import STOPPING, Scarce, StopReason
from ...schemas.runs.trials import TrialCounts, TrialRecordings, planned_trials, trial_counts
from ...schemas.wire.errors import ConfigurationError, LeaseLostError, ResourceNotFoundException, RobomakerError
from ...schemas.wire.errors import ServiceUnavailableException as CatalogUnavailable
from ..catalog import Catalog, Resource
from ..execution.leases.giving_up import fail_job
from ..execution.leases.held_leases import HELD, WorkerStopping
from ..execution.leases.leased_runs import run_under_lease
from ..machine.machine_slots import MachineSlots, Turn
from ..service.service import Service
from .job_folders import KIND, remove_overtaken_runs
from .job_runs import launcher, perform_job
from .simulation_places import SIMULATED, Place, permit_of

_BATCH = "simulation-job-batch"
_LOOK_S = 0.25
_LONGEST_PAUSE_S = 10.0
_ABANDONED_LEASES = 2
"""Number of lease periods after which workers leave a batch that no process runs.

The next process that runs the batch starts workers again.
"""

_logger = logging.getLogger(__name__)


class BatchWorker:
    """Job worker of this process: takes jobs of one batch from the catalog and runs them.

    Args:
        batch: ARN of the batch.
        service: The service, with its catalog and object store.
    """

    def __init__(self, batch: str, service: Service) -> None:
        self._batch = batch
        self._service = service
        self._status = ""
        self._waited_s: Mapping[Scarce, float] = {}
        self._alone_since: float | None = None
        self._ended = threading.Event()

    def run(self) -> int:
        """Runs jobs of the batch until the batch has ended, or no process manages it any more.

        Returns:
            Number of jobs that were run here.

        Raises:
            ConfigurationError: The catalog of this machine does not have the batch.
            BaseException: The interruption that ended it; its jobs have been released, and the process has to end.
        """
        machine = self._machine()
        remove_overtaken_runs(self._service)
        launcher().start()
        # In as many threads as there are slots, jobs simulate; in as many, they finish.
        pool = ThreadPoolExecutor(2 * self._service.settings.max_jobs, thread_name_prefix="job")
        try:
            return self._run(pool, machine)
        except BaseException:
            HELD.give_back_all(self._service.catalog)
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        finally:
            machine.leave()

    def stop(self) -> None:
        """Makes the worker take no more jobs; `run` returns once the current ones have ended."""
        self._ended.set()

    def _machine(self) -> MachineSlots:
        """Returns the job slots of this machine, requested with the batch's own priority.

        Raises `ConfigurationError` if the catalog of this machine does not have the batch.
        """
        try:
            batch = SimulationJobBatchDocument.of(self._service.catalog.get(self._batch, kind=_BATCH))
        except ResourceNotFoundException as error:
            url = self._service.catalog.address
            raise ConfigurationError(
                f"the catalog of this machine, {url}, does not have {self._batch}: set ROBOMAKER_CATALOG_URL and "
                "ROBOMAKER_OBJECT_STORE to what the machine uses that runs the batch"
            ) from error
        priority = batch.batch_policy.priority or 0
        return MachineSlots(self._service.settings, self._batch, priority, tell=self._service.report_note)

    def _run(self, pool: ThreadPoolExecutor, machine: MachineSlots) -> int:
        running: set[Future[None]] = set()
        count, pause_s = 0, _LOOK_S
        while True:
            try:
                over = self._ended.is_set() or self._is_over()
                while not over and (begun := self._begin(pool, machine)) is not None:
                    running.add(begun)
                    count += 1
                pause_s = _LOOK_S
            except CatalogUnavailable as error:
                over = False
                _logger.warning("no job is begun, the catalog does not answer: %s", error)
                pause_s = min(2 * pause_s, _LONGEST_PAUSE_S)
            if over and not running:
                return count
            if not running:
                self._ended.wait(pause_s)
            running = concurrent.futures.wait(running, pause_s, concurrent.futures.FIRST_COMPLETED).not_done

    def _is_over(self) -> bool:
        """Whether this job worker should take no more jobs of the batch.

        That is so if the batch has ended or stops, if it has no job left to take, or if no process has managed it for
        two lease periods, which is logged.
        """
        self._status, _ = self._service.catalog.standing(self._batch)
        if is_terminal(_BATCH, self._status) or self._status in STOPPING:
            return True
        if self._status == "Completing" and not self._living():
            return True
        owner, has_run_out = self._service.catalog.lease_of(self._batch)
        if owner is not None and not has_run_out:
            self._alone_since = None
            return False
        self._alone_since = self._alone_since or time.monotonic()
        if time.monotonic() - self._alone_since < _ABANDONED_LEASES * self._service.timing.lease_s:
            return False
        _logger.warning("no process carries out %s any more; `robomaker perform %s` does", self._batch, self._batch)
        return True

    def _living(self) -> bool:
        """Whether any job of the batch has no final status yet; if that job's worker dies, another can take it."""
        standing = self._service.catalog.count_children(self._batch, KIND)
        return any(not is_terminal(KIND, status) for status in standing)

    def _begin(self, pool: ThreadPoolExecutor, machine: MachineSlots) -> Future[None] | None:
        """Claims a waiting job of the batch and runs it in a thread of the pool, holding a slot of this machine.

        Returns `None`, and holds no slot, if the machine has no free slot or the batch no waiting job.
        """
        slot = machine.take(self._batch.rpartition("/")[2])
        if slot is None:
            return None
        arn = None
        waited_s = machine.waited_s(since_s=self._waited_s)
        self._waited_s = machine.waited_s()
        try:
            arn = self._claim()
        finally:
            if arn is None:
                machine.give_back(slot)
                machine.leave()  # others have more use for it
        return None if arn is None else pool.submit(self._run_job, arn, machine, slot, waited_s)

    def _claim(self) -> str | None:
        """Claims a job of the batch that may run now, by taking its lease in the catalog, and returns the job's ARN.

        Returns `None` if no job may run now, as when as many run as the batch allows.
        """
        catalog, lease_s = self._service.catalog, self._service.timing.lease_s

        def take(owner: str) -> str | None:
            places = ("InProgress", "Completing")
            return catalog.claim_child(
                self._batch, KIND, owner, lease_s, most="concurrency", parent_in=places, finishing=SIMULATED
            )

        return HELD.reserve_any(take, catalog)

    def _run_job(self, arn: str, machine: MachineSlots, slot: int, waited_s: Mapping[Scarce, float]) -> None:
        """Runs a claimed job to its end, and gives its slot and its lease back.

        No error is raised: a job whose lease is lost, or whose catalog is away, is left to another job worker, and any
        other error fails the job.
        """
        name = arn.rpartition("/")[2]

        def take(stack: ExitStack) -> Turn | None:
            if slots:
                stack.callback(machine.give_back, slots.pop())  # the one with which it was claimed
                return Turn(waited_s)
            return stack.enter_context(machine.hold(lambda: self._stop_reason() is not None, name))

        slots = [slot]
        try:
            with Place(take, permit_of(machine)) as place:
                place.simulate()
                perform_job(arn, self._service, self._stop_reason, waited_s=waited_s, place=place, waits=False)
        except (CatalogUnavailable, LeaseLostError, WorkerStopping) as error:
            _logger.warning("%s is left to another job worker: %s", arn, error)
        except Exception as error:
            _logger.exception("%s broke its job worker", arn)
            self._fail(arn, f"running it failed: {type(error).__name__}: {error}")
        finally:
            try:
                HELD.cancel_reservation(arn, self._service.catalog)
            except CatalogUnavailable as error:
                _logger.warning("the lease of %s is not given back; it runs out by itself: %s", arn, error)

    def _fail(self, arn: str, reason: str) -> None:
        try:
            run_under_lease(arn, KIND, self._service, lambda lease: fail_job(lease, reason, self._service), HELD)
        except RobomakerError as error:
            _logger.warning("%s could not be marked as failed: %s", arn, error)

    def _stop_reason(self) -> StopReason | None:
        """Returns the reason why the batch's jobs have to end, by its last known status; `None` if they do not."""
        return STOPPING.get(self._status)


_WAIT_S = 0.5


_LASTING_S = 3.0
"""Time without a new job after which jobs count as waiting for a worker, in seconds.

A worker that has just ended a job takes the next one sooner.
"""


class AwaitedJobs:
    """Waits for a batch's jobs to end, with one query for all of them; safe to use from several threads.

    Args:
        catalog: The catalog.
        batch: ARN of the batch.
    """

    def __init__(self, catalog: Catalog, batch: str) -> None:
        self._catalog = catalog
        self._batch = batch
        self._ended: frozenset[str] = frozenset()
        self._changed = threading.Condition()

    def look(self) -> None:
        """Queries the catalog once which jobs of the batch have ended, and wakes the threads that wait for these.

        Raises:
            ServiceUnavailableException: The catalog does not answer.
        """
        standing = self._catalog.children_standing(self._batch, KIND)
        ended = frozenset(arn for arn, status in standing.items() if is_terminal(KIND, status))
        with self._changed:
            if ended != self._ended:
                self._ended = ended
                self._changed.notify_all()

    def wait(self, job: str, should_stop: Callable[[], bool]) -> None:
        """Waits until a job has ended, or `should_stop` is true.

        Args:
            job: ARN of the job.
            should_stop: Called now and then; must return at once.
        """
        with self._changed:
            while job not in self._ended and not should_stop():
                self._changed.wait(_WAIT_S)


class WorkerWait:
    """Detects that no job worker takes the jobs of a batch."""

    def __init__(self) -> None:
        self._since_s: float | None = None

    def lasts(self, pending: int, running: int, now_s: float) -> bool:
        """Updates the numbers of jobs; returns whether all have waited for a worker for too long.

        Args:
            pending: Jobs that no worker has begun.
            running: Jobs that workers have begun and not ended.
            now_s: Seconds of a clock that never goes back.
        """
        if not pending or running:
            self._since_s = None
            return False
        if self._since_s is None:
            self._since_s = now_s
        return now_s - self._since_s >= _LASTING_S


_LOOK_EVERY_S = 2.0


class BatchTrials:
    """Counts the finished trials of a batch's jobs, for its progress.

    Args:
        batch: ARN of the batch.
        requests: The requests of its jobs, in order.
        catalog: Catalog of the jobs, with the numbers of their finished trials.
        clock: Seconds on a clock that only runs forward.
    """

    def __init__(
        self, batch: str, requests: Sequence[Json], catalog: Catalog, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._batch, self._catalog, self._clock = batch, catalog, clock
        self._planned = [planned_trials(request) for request in requests]
        self._total = sum(self._planned)
        self._next_look_s = 0.0
        self.counts = TrialCounts(0, self._total) if self._total else None
        """Counts of a batch's trials at the last poll; `None`: no job has trials."""

    def look(self, *, now: bool = False) -> bool:
        """Counts the finished trials again, at most every two seconds.

        Args:
            now: Counts in any case.

        Returns:
            Whether more have finished, or another one is recorded.
        """
        if not self._total or (not now and self._clock() < self._next_look_s):
            return False
        self._next_look_s = self._clock() + _LOOK_EVERY_S
        before, self.counts = self.counts, self._counted()
        return self.counts != before

    def _counted(self) -> TrialCounts:
        page = self._catalog.list(
            KIND, filters={"parent": [self._batch]}, limit=len(self._planned), members=JobTrials.members()
        )
        told = [(job, JobTrials.of_members(job)) for job in page.resources]
        recordings = {job.id: _recordings(job, each) for job, each in told if each.trials_recorded is not None}
        return trial_counts(sum(self._finished_of(*each) for each in told), self._total, recordings)

    def _finished_of(self, job: Resource, told: JobTrials) -> int:
        planned = 0 if told.request_index is None else self._planned[told.request_index]
        # A job is asked now and then, so the last number of one that has ended well is mostly too small.
        return planned if job.status == "Completed" else min(planned, told.trials_finished or 0)


def _recordings(job: Resource, told: JobTrials) -> TrialRecordings:
    """Returns how far a job is with recording trials; one that has ended records none any more."""
    found = told.trials_recorded
    assert found is not None
    return found.model_copy(update={"finished": found.total}) if is_terminal(KIND, job.status) else found


_JUDGED = ("Failed", "Completed")
"""Statuses of jobs that ended by themselves, of which the verdict says more."""


class EndedJobs:
    """Outcomes of a batch's jobs that have ended, for its progress: a job that completed may have failed.

    Args:
        jobs: Jobs of the batch so far, ended or not.
    """

    def __init__(self, jobs: Iterable[Resource] = ()) -> None:
        self._outcomes: dict[str, tuple[str, CaseOutcome]] = {}
        for job in jobs:
            self.note(job)

    def note(self, job: Resource) -> None:
        """Remembers how a job ended; from any thread."""
        if job.status in _JUDGED:
            document = SimulationJobDocument.of(job)
            outcome = case_outcome(job.status, document.verdict, document.failure_code)
            self._outcomes[job.arn] = (job.status.lower(), outcome)

    def tell(self, counts: Counter[str]) -> None:
        """Replaces statuses by outcomes in counts of jobs by status.

        Jobs whose end is noted in a moment are counted as storing, so that no job changes its end.
        """
        noted = Counter(list(self._outcomes.values()))
        left = {status: counts.pop(status, 0) for status in map(str.lower, _JUDGED)}
        for (status, outcome), count in noted.items():
            moved = min(count, left[status])  # the counts may have been taken before
            left[status] -= moved
            counts[outcome] += moved
        counts["storing"] += sum(left.values())
