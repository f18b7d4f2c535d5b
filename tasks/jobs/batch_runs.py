"""Runs a simulation job batch: creates a job for each request, runs the jobs, ends the batch."""

import logging
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from datetime import timedelta
from typing import TYPE_CHECKING, Any, TypeVar

from ...schemas.documents.simulation_jobs import (
    BatchProgress,
    FailedRequest,
    SimulationJobBatchDocument,
    SimulationJobDocument,
)
from ...schemas.lifecycles import batch_outcome, is_terminal
from ...schemas.operations.simulation_jobs import SimulationJobRequest
from ...schemas.reports.run_record import case_outcome
from ...schemas.reports.run_states import outcomes_in_words
from ...schemas.runs.programs import STOP_EVENTS, STOPPING, StopReason, Wait
from ...schemas.wire.base import STORED
from ...schemas.wire.common import shorten
from ...schemas.wire.errors import ServiceError, ServiceUnavailableException, StorageError, StorageUnavailableError
from ..backends.backend import Backend, BackendError
from ..catalog import ClientToken, Resource
from ..execution.credential_blocks import read_credential_block
from ..execution.leases.catalog_outages import CatalogWait
from ..execution.leases.job_leases import Lease
from ..execution.task_pool import run_tasks
from ..machine.machine_slots import MachineSlots, Turn
from ..service.service import Progress, Service
from ..simulations.planning.job_contents import CurrentApplications
from ..simulations.stored_jobs import check_references, reuse_job, store_job
from .batch_workers import AwaitedJobs, BatchTrials, EndedJobs, WorkerWait
from .job_runs import perform_job, stop_idle_job
from .request_order import mixed_order
from .simulation_places import IS_STORED, SIMULATED, Place, only_finishes, permit_of

if TYPE_CHECKING:
    from ..execution.batch_slots import Slots

Result = TypeVar("Result")

_logger = logging.getLogger(__name__)

_WAIT_S = 0.5
_ASK_S = 0.2
"""Interval between two checks of the catalog whether the batch should be cancelled, in seconds."""
_REPORT_S = 1.0
"""Interval between two looks at the statuses of the jobs, which change without news here, in seconds."""
_INTERNAL = "InternalServiceError"
_MOST_AHEAD = 16  # jobs of a backend that wait for a worker: more than workers take between two looks
_END_EVENTS: Mapping[str, str] = {
    "Completed": "complete",
    "Failed": "fail",
    "TimedOut": "timed_out",
    "Canceled": "canceled",
}
# What becomes of a request that the service's own checks refuse for good.
_FAILURE_CODES: Mapping[str, str] = {
    "ResourceNotFoundException": "ResourceNotFound",
    "InvalidParameterException": "InvalidInput",
    "LimitExceededException": "LimitExceeded",
}


def jobs_by_request(batch: Resource, service: Service) -> dict[int, Resource]:
    """Returns a batch's jobs by the index of their request."""
    jobs = service.catalog.children(batch.arn, kind="simulation-job")
    return {index: job for job in jobs if (index := SimulationJobDocument.of(job).request_index) is not None}


class BatchRun:
    """Runs one simulation job batch: makes jobs from its requests, and follows them to their end.

    Args:
        lease: The right to change the batch.
        service: The service, with its catalog and object store.
    """

    def __init__(self, lease: Lease, service: Service) -> None:
        self._lease = lease
        self._batch = batch = lease.job
        self._arn = batch.arn
        document = SimulationJobBatchDocument.of(batch)
        self._service = service.ordered_by(document.spec_run, reuse=document.reuse)
        self._policy, self._requests = document.batch_policy, document.requests
        self._trials = BatchTrials(self._arn, self._requests, service.catalog)
        self._in_campaign = document.in_campaign
        self._order = mixed_order(self._requests) if document.mixed else range(len(self._requests))
        self._ask_again_at, self._cancelled = 0.0, False
        self._misses_catalog = False  # since the last look, which did not see all
        self._patient = self._service.patient(batch.id, lambda: self._stop_reason() is not None)
        self._failed = dict(document.failed)
        self._saved = len(self._failed)
        jobs = jobs_by_request(batch, service)
        self._made, self._ended = set(jobs), EndedJobs(jobs.values())
        self._stop: StopReason | None = STOPPING.get(batch.status)
        priority = self._policy.priority or 0
        self._machine = MachineSlots(
            service.settings, self._arn, priority, tell=service.report_note, watch=self._note_wait
        )
        self._waits_for: Wait | None = None
        self._is_news = False  # since progress was told; the next look tells it, once for all that happened meanwhile
        self._told, self._report_at_s = Progress({}, 0), 0.0
        self._finishing = threading.BoundedSemaphore(1)
        self._concurrency: int | None = None
        self._workers = ""
        self._looks_for_worker_at_s = 0.0
        self._deadline = batch.created_at + timedelta(seconds=self._policy.timeout_in_seconds)

    def run(self) -> None:
        """Runs every unfinished request of the batch as a simulation job, and then sets the batch's final status.

        Requests with reusable results get finished jobs at once, and requests that name missing resources fail early.
        If the backend has no machine for the jobs, they are cancelled and the batch fails; no error is raised. Blocks
        until all jobs have ended.
        """
        if self._batch.status == "Pending":
            self._lease.transition("start")
        else:
            self._reset_lost_workers()
        if self._service.reuses:
            self._reuse_results()
        if not self._stop_reason():
            self._refuse_early()
        if unfinished := self._unfinished():
            try:
                self._run_requests(unfinished)
            except BackendError as error:
                self._abandon(str(error))
                return
        while self._stop_reason() and not self._lease.lost and not self._stop_remaining_jobs():
            time.sleep(_WAIT_S)  # somebody else performs one of its jobs, and has been told to end it
        self._settle()

    def _reset_lost_workers(self) -> None:
        """Resets the count of dead job workers if any job has ended since the batch was last taken over."""
        statuses = self._service.catalog.count_children(self._arn, kind="simulation-job")
        ended = sum(count for status, count in statuses.items() if is_terminal("simulation-job", status))
        if ended > SimulationJobBatchDocument.of(self._batch).ended_when_taken:
            self._lease.update(BatchProgress(ended_when_taken=ended))
            self._lease.forget_lost_workers()

    def _abandon(self, reason: str) -> None:
        """Fails the batch, after cancelling its running jobs and waiting for their end, as its backend has no machine.

        Requests without a job are recorded as failed.
        """
        while not self._lease.lost and not self._stop_remaining_jobs():
            time.sleep(_WAIT_S)
        for index in self._waiting():
            self._fail_request(index, _INTERNAL, "the batch ended before a job was made of this request")
        self._save_failures()
        self._lease.transition("fail", BatchProgress(failure_code=_INTERNAL, failure_reason=shorten(reason)))
        self._report()

    def end(self) -> None:
        """Ends a batch that has to stop, and those of its jobs that no job worker holds.

        Jobs that other workers run are cancelled; the batch is then left to the next job worker.
        """
        self._note_stop()
        if self._stop_remaining_jobs():
            self._settle()

    def _stop_remaining_jobs(self) -> bool:
        """Ends the batch's jobs that no job worker holds, and requests the cancellation of the others.

        Jobs that only upload their outputs by now are left alone.

        Returns:
            Whether all jobs have ended.
        """
        reason = self._stop_reason() or StopReason.BATCH_CANCELED
        performed = [
            job for _, job in sorted(self._active().items()) if not stop_idle_job(job.arn, self._service, reason)
        ]
        for job in performed:
            if not only_finishes(job, reason):
                self._service.catalog.request_cancel(job.arn)
        return not performed

    def _active(self) -> dict[int, Resource]:
        """Returns the unfinished jobs of the batch, by the index of their request."""
        jobs = jobs_by_request(self._batch, self._service)
        return {index: job for index, job in jobs.items() if not is_terminal(job.kind, job.status)}

    def _unfinished(self) -> list[int]:
        """Returns the indices of unfinished requests.

        Once the batch has to stop, only those that have become jobs are returned.
        """
        active = set(self._active())
        unfinished = active if self._stop_reason() else active.union(self._waiting())
        return [index for index in self._order if index in unfinished]

    def _waiting(self) -> list[int]:
        """Returns the indices of the requests that have neither become jobs nor been refused."""
        return [i for i in range(len(self._requests)) if i not in self._made and str(i) not in self._failed]

    def _run_requests(self, indices: list[int]) -> None:
        from ..execution.batch_slots import Slots, limit_name

        most = min(self._policy.max_concurrency, len(indices))
        if self._service.backend is None:
            most = min(most, self._service.settings.max_jobs)  # no more run on this machine
        self._finishing = threading.BoundedSemaphore(most)
        with Slots(limit_name(self._batch.id), self._policy.max_concurrency, most, order=indices) as slots:
            try:
                if self._service.backend is None:
                    self._run_tasks(
                        indices,
                        lambda index: self._simulate(index, slots),
                        min(2 * most, len(indices)),
                        lambda: self._look_or_miss(self._look),
                    )
                else:
                    self._run_elsewhere(indices, slots, most, self._service.backend)
            finally:
                if not self._lease.lost:  # else the slots are another job worker's
                    slots.remove()

    def _run_tasks(
        self, indices: list[int], simulate: Callable[[int], None], at_once: int, look: Callable[[], bool]
    ) -> None:
        run_tasks(
            "simulate-request",
            simulate,
            [{"index": index} for index in indices],
            run_name="request-{index}",
            workers=at_once,
            job_arn=self._arn,
            service=self._service,
            look=look,
            summary=self._in_words if self._in_campaign else None,
        )

    def _in_words(self) -> str:
        """Counts the batch's requests so far by outcome, as text: `10 jobs: 8 passed, 2 failed`."""
        jobs = jobs_by_request(self._batch, self._service).values()
        documents = [(job.status, SimulationJobDocument.of(job)) for job in jobs]
        outcomes = [case_outcome(status, job.verdict, job.failure_code) for status, job in documents]
        unmade = [case_outcome("NotCreated", None, failure.failure_code) for failure in self._failed.values()]
        return outcomes_in_words([*outcomes, *unmade])

    def _run_elsewhere(self, indices: list[int], slots: "Slots", most: int, backend: Backend) -> None:
        """Runs the batch's jobs on job workers of a backend; this process only creates them and waits for their end.

        It creates some more jobs than may run, so that a worker that has ended one finds the next; and as many jobs may
        finish (draw and upload) as may run.
        """
        awaited, broken = AwaitedJobs(self._service.catalog, self._arn), threading.Event()
        wait = WorkerWait()

        def simulate(index: int) -> None:
            if (job := self._outlasting(lambda: self.create_job(index))) is not None:
                self._is_news = True
                awaited.wait(job.arn, lambda: self._stop is not None or broken.is_set())
                self._note_end(job)
            self._is_news = True

        def look_at_workers() -> bool:
            self._allow(slots.count)
            awaited.look()
            self._note_workers(workers.look())
            self._look_for_worker(wait)
            return self._look()

        def look() -> bool:
            try:
                return self._look_or_miss(look_at_workers)
            except BaseException:
                broken.set()  # no thread looks any more, so none may wait for what it would see
                raise

        with backend.job_workers(self._arn, most) as workers:
            self._run_tasks(indices, simulate, min(2 * most + min(most, _MOST_AHEAD), len(indices)), look)
        self._waits_for = None

    def _allow(self, concurrency: int) -> None:
        """Stores the number of jobs that job workers may run at once, if it changed."""
        if concurrency != self._concurrency:
            self._lease.update(BatchProgress(concurrency=concurrency))
            self._concurrency = concurrency

    def _look_for_worker(self, wait: WorkerWait) -> None:
        """Notes for the next report whether the batch's jobs wait for a job worker; checks at most once a second."""
        if (now_s := time.monotonic()) < self._looks_for_worker_at_s:
            return
        self._looks_for_worker_at_s = now_s + 1.0
        statuses = self._service.catalog.count_children(self._arn, kind="simulation-job")
        pending = statuses.get("Pending", 0)
        running = sum(n for status, n in statuses.items() if not is_terminal("simulation-job", status)) - pending
        waits: Wait | None = "worker" if wait.lasts(pending, running, now_s) else None
        if waits != self._waits_for:
            self._note_wait(waits)

    def _note_workers(self, workers: str) -> None:
        """Tells the user which job workers the batch has, whenever that changes."""
        if workers != self._workers:
            self._service.report_note(f"{self._batch.id}: {workers}")
            self._workers = workers

    def _simulate(self, index: int, slots: "Slots") -> None:
        """Creates the job for one request, while holding a slot of the batch and one of the machine, and runs it.

        The slots are released when the job's programs have ended, so drawing and storing delay no other job. At most as
        many jobs as there are slots finish at once; further ones keep their slots until they have ended.
        """
        should_stop = lambda: self._stop_reason() is not None  # noqa: E731
        name = f"request {index} of {self._batch.id}"

        def take(stack: ExitStack) -> Turn | None:
            if not stack.enter_context(slots.hold(should_stop, index)):
                return None
            return stack.enter_context(self._machine.hold(should_stop, name, self._wants_more))

        with Place(take, self._may_finish) as place:
            turn = place.simulate()
            job = self._outlasting(lambda: self.create_job(index)) if turn is not None else None
            if job is not None and turn is not None:
                self._is_news = True
                self._outlasting(
                    lambda: perform_job(
                        job.arn, self._service, self._jobs_stop_reason, waited_s=turn.waited_s, place=place
                    )
                )
                self._note_end(job)
        self._is_news = True

    def _note_end(self, job: Resource) -> None:
        """Remembers how a job ended; until the catalog says so, progress tells that it stores."""
        with suppress(ServiceError):
            self._ended.note(self._patient.catalog.get(job.arn))

    def _may_finish(self, stack: ExitStack) -> bool:
        """Takes a place for drawing and uploading, of the batch's and the machine's; returns whether both had one."""
        if not self._finishing.acquire(blocking=False):
            return False
        stack.callback(self._finishing.release)
        return permit_of(self._machine)(stack)

    def _note_wait(self, wait: Wait | None) -> None:
        """Remembers the reason why the next job waits until the next report: no catalog call while slots are locked."""
        self._waits_for, self._is_news = wait, True

    def _wants_more(self) -> bool:
        """Whether the batch goes on and has requests that have neither become jobs nor been refused."""
        return self._stop_reason() is None and len(self._made) + len(self._failed) < len(self._requests)

    def _stop_reason(self) -> StopReason | None:
        """Returns the first reason why the batch must stop its jobs (cancellation or timeout), or `None`."""
        if self._stop is None:
            if self._lease.lost or self._is_cancelled():
                self._stop = StopReason.BATCH_CANCELED
            elif self._service.clock() >= self._deadline:
                self._stop = StopReason.BATCH_TIMED_OUT
        return self._stop

    def _jobs_stop_reason(self) -> StopReason | None:
        """Reason why running jobs have to stop, or `None`.

        A batch that another process has taken over is no reason: each job has a lease of its own, and the other process
        waits for those that are held.
        """
        reason = self._stop_reason()
        if reason is not StopReason.BATCH_CANCELED or not self._lease.lost or self._is_cancelled():
            return reason
        return StopReason.BATCH_TIMED_OUT if self._service.clock() >= self._deadline else None

    def _is_cancelled(self) -> bool:
        """Whether the batch's cancellation was requested.

        All its jobs ask this all the time, so the catalog is asked only once per interval.
        """
        if (now := time.monotonic()) >= self._ask_again_at:
            self._ask_again_at = now + _ASK_S
            with suppress(ServiceUnavailableException):  # the last answer stands until there is another
                self._cancelled = self._service.catalog.cancel_requested(self._arn)
        return self._cancelled

    def create_job(self, index: int) -> Resource | None:
        """Stores the simulation job for one request of the batch, or returns the job that the request has already.

        Returns `None` if the request is refused, or its job cannot be stored; the request is then recorded as failed,
        unless the batch has to stop. Raises `ServiceUnavailableException` if the catalog does not answer.
        """
        if str(index) in self._failed:
            return None
        request, token = self._request(index)
        try:
            job = store_job(
                request, self._patient.with_blocks(read_credential_block), token=token, batch=(self._arn, index)
            )
        except StorageUnavailableError as error:
            if not self._stop_reason():
                self._fail_request(index, "InternalServiceError", str(error))
            return None
        except ServiceUnavailableException:
            raise  # the catalog is away, not the request wrong
        except ServiceError as error:
            self._fail_request(index, _FAILURE_CODES.get(error.code, "InternalServiceError"), str(error))
            return None
        self._made.add(index)
        return job

    def _outlasting(self, call: Callable[[], Result]) -> Result:
        """Calls a function, and calls it again after each outage of the catalog, until it returns a result.

        Raises the function's `ServiceUnavailableException` once the batch has to stop or its lease is lost, or if the
        catalog answers reads but refuses the call again and again.
        """
        catalog = self._service.catalog
        wait = CatalogWait(
            self._arn,
            lambda: catalog.standing(self._arn),
            lambda: self._stop is not None or self._lease.lost,
            self._service.timing.after_outage_s,
        )
        return wait.outlasting(call)

    def _look_or_miss(self, look: Callable[[], bool]) -> bool:
        """Calls a function that polls the batch, and returns its answer: whether the batch's jobs have to stop.

        If the catalog does not answer, the outage is logged once and the last known answer is returned; running jobs
        continue.
        """
        try:
            if self._misses_catalog:
                self._lease.refreshed()  # the answer to a change may have been lost
                self._misses_catalog = False
            return look()
        except ServiceUnavailableException as error:
            if not self._misses_catalog:
                _logger.warning("%s waits for the catalog: %s", self._arn, error)
            self._misses_catalog = self._is_news = True
            return self._stop is not None

    def _request(self, index: int) -> tuple[SimulationJobRequest, ClientToken]:
        """Returns a request of the batch, and its client token, with which it becomes a job only once."""
        token = ClientToken.of_batch_job(self._batch.id, index)
        return SimulationJobRequest.model_validate(self._requests[index], context=STORED), token

    def _reuse_results(self) -> None:
        """Creates finished jobs for the waiting requests whose results exist already, and reports the batch's progress.

        Requests without reusable results, and those that are refused here, stay waiting; returns early if the batch has
        to stop.
        """
        applications = CurrentApplications(self._patient)
        for index in self._waiting():
            if self._stop_reason():
                return
            request, token = self._request(index)
            with suppress(ServiceError, StorageError):  # what is wrong with it is said when it is to be run
                place = (self._arn, index)
                job = reuse_job(request, self._patient, token=token, batch=place, applications=applications)
                if job is not None:
                    self._made.add(index)
                    self._ended.note(job)
        self._report()

    def _refuse_early(self) -> None:
        """Records the requests that name missing or invalid resources as failed, before each of them costs a task run.

        Other errors are ignored here, as they may have passed when the request becomes a job.
        """
        applications = CurrentApplications(self._patient)
        for index in self._waiting():
            try:
                check_references(self._requests[index], self._patient, applications)
            except ServiceError as error:
                if error.code in _FAILURE_CODES:  # anything else may pass
                    self._fail_request(index, _FAILURE_CODES[error.code], str(error))
        self._save_failures()

    def _fail_request(self, index: int, code: str, reason: str) -> None:
        """Marks a request as failed, so that it never becomes a job; `_save_failures` stores that."""
        failed_at = self._service.clock().isoformat()
        self._failed[str(index)] = FailedRequest(failure_code=code, failure_reason=shorten(reason), failed_at=failed_at)

    def _save_failures(self) -> None:
        """Stores the newly failed requests, if any, in the batch, all at once, as its document can be large."""
        failed = dict(self._failed)
        if len(failed) > self._saved:
            self._lease.update(BatchProgress(failed=failed, failed_count=len(failed)))
            self._saved = len(failed)

    def _report(self) -> None:
        """Reports the number of the batch's requests in each state, including requests that have no job yet.

        Does nothing if nothing has changed since the last report.
        """
        self._is_news, self._report_at_s = False, time.monotonic() + _REPORT_S
        statuses = self._service.catalog.count_children(self._arn, kind="simulation-job")
        counts = Counter({status.lower(): count for status, count in statuses.items()})
        failed = len(self._failed)
        for status, finishing in self._finish().items():
            count = min(finishing, counts[status.lower()])  # a job's status may have changed between the two counts
            counts[status.lower()] -= count
            counts["storing" if status == IS_STORED else "drawing"] += count
        self._ended.tell(counts)
        # Requests that are no jobs yet wait as those do that are.
        counts["pending"] += len(self._requests) - counts.total() - failed
        counts["not created"] = failed
        total, trials = len(self._requests), self._trials.counts
        progress = Progress({state: count for state, count in counts.items() if count}, total, self._waits_for, trials)
        if progress != self._told:
            self._told = progress
            self._service.report_progress(progress)

    def _finish(self) -> dict[str, int]:
        """Counts the jobs, by status, that have simulated and only draw videos or store outputs."""
        return self._service.catalog.count_alive(self._arn, "simulation-job", having=SIMULATED)

    def _look(self) -> bool:
        """Polls the batch once, and records failed requests, progress and changes of the batch's status in the catalog.

        The batch run calls it several times a second.

        Returns:
            True if no further jobs are to be created, because the batch has to stop.
        """
        self._save_failures()
        if not self._only_finishes():
            self._note_stop()
        if self._trials.look() or self._is_news or time.monotonic() >= self._report_at_s:
            self._report()
        if self._lease.job.status == "InProgress" and not self._waiting():
            self._lease.transition("drain")
        return self._stop_reason() is not None

    def _only_finishes(self) -> bool:
        """Whether no job waited or simulated any more at the batch's timeout, so that the timeout ends no job."""
        reason = self._stop_reason()
        if reason is not StopReason.BATCH_TIMED_OUT or self._waiting():
            return False
        return all(only_finishes(job, reason) for job in self._active().values())

    def _note_stop(self) -> None:
        """Changes the batch's status if its jobs have to stop, by the reason: it was cancelled, or timed out."""
        event = STOP_EVENTS.get(self._stop_reason() or "")
        if event and self._lease.job.status in ("Pending", "InProgress", "Completing"):
            self._lease.transition(event)

    def _settle(self) -> None:
        jobs = jobs_by_request(self._batch, self._service)
        self._ended = EndedJobs(jobs.values())
        waiting = self._waiting()
        if waiting or any(SimulationJobDocument.of(job).failure_code in STOP_EVENTS for job in jobs.values()):
            self._note_stop()  # the last jobs may have ended before anybody looked why
        status = self._lease.job.status
        for index in waiting:
            code = STOPPING.get(status, "InternalServiceError")
            self._fail_request(index, code, "the batch ended before a job was made of this request")
        self._save_failures()
        end = batch_outcome(
            pending=0,
            failed=[failure.failure_code for failure in self._failed.values()],
            created=[job.status for job in jobs.values()],
            timed_out=status == "TimingOut",
            canceled=status == "Canceling",
        )
        if end == "Completed" and status == "InProgress":
            self._lease.transition("drain")
        documents = [SimulationJobDocument.of(job) for job in jobs.values() if job.status == "Completed"]
        verdicts = dict(Counter(document.verdict for document in documents if document.verdict))
        failure: dict[str, Any] = {}
        if end == "Failed":
            reason = "at least one request could not become a job because of an internal fault"
            failure = {"failure_code": _INTERNAL, "failure_reason": reason}
        self._lease.transition(_END_EVENTS[end], BatchProgress(verdicts=verdicts, **failure))
        self._trials.look(now=True)
        self._report()
