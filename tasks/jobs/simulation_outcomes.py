"""Outcomes of simulation jobs, and the stored outputs of a job's earlier runs."""

import logging
from collections.abc import Callable, Mapping

from ...schemas.documents.simulation_jobs import (
    EarlierRun,
    Outcome,
    OutcomeStatus,
    SimulationJobDocument,
    SimulationJobProgress,
)
from ...schemas.documents.worlds import StoredPlace
from ...schemas.runs.plan import RunOutcome
from ...schemas.runs.programs import StopReason
from ...schemas.wire.common import shorten
from ...schemas.wire.errors import StorageError, StorageUnavailableError
from ..execution.leases.job_leases import Lease
from ..runtime.limits.logs import add_note
from ..simulations.containers.cleanup import remove_run, settle_containers
from ..simulations.outputs.run_outputs import RunOutputs
from .job_folders import kept_runs

END_EVENTS: Mapping[OutcomeStatus, str] = {"Completed": "complete", "Failed": "fail", "Canceled": "cancel"}
"""Event that leads from status `Terminating` to the final status, by outcome."""


def outcome_of(run: RunOutcome, stopped_because: StopReason | None) -> Outcome:
    """Returns the outcome of a simulation job, decided from its run's end.

    Args:
        run: Outcome of the run.
        stopped_because: Why the job had to stop; `None` if it did not have to.
    """
    if is_overtaken(run.status, stopped_because):
        run = run.model_copy(update={"status": "Canceled"})
    outcome = Outcome(status=run.status)
    if run.status == "Completed" and run.verdict is not None:
        reason = shorten(run.verdict_reason) if run.verdict_reason else None
        outcome = outcome.model_copy(update={"verdict": run.verdict, "verdict_reason": reason, "judged": run.judged})
    if run.failure_code:
        outcome = _with_failure(outcome, run.failure_code, run.failure_reason or "")
    elif run.status == "Canceled":
        outcome = stopped(stopped_because or StopReason.CANCELED, "the job was stopped while it ran")
    duration = run.ended_at - run.started_at
    took = {
        "simulation_time_millis": round(duration.total_seconds() * 1000),
        "cpu_time_s": run.cpu_time_s,
        "video_s": run.video_s,
    }
    return outcome.model_copy(update=took)


def is_overtaken(status: OutcomeStatus, stopped_because: StopReason | None, *, is_whole: bool = True) -> bool:
    """Whether a successful run counts as cancelled, because a cancellation was accepted before.

    A failed run stays failed. The end of a batch does not affect a job whose run was over, unless its outputs could not
    be stored completely because of that.
    """
    if stopped_because is StopReason.BATCH_CANCELED and is_whole:
        return False
    return status == "Completed" and stopped_because in (StopReason.CANCELED, StopReason.BATCH_CANCELED)


def stopped(reason: StopReason, words: str) -> Outcome:
    """Returns the outcome of a job that had to stop; one that was cancelled itself has no failure code."""
    if reason is StopReason.CANCELED:
        return Outcome(status="Canceled")
    return Outcome(status="Canceled", failure_code=reason.value, failure_reason=words)


def overtaken(outcome: Outcome, reason: StopReason | None = None) -> Outcome:
    """Returns the outcome of a job whose run had completed when the job or its batch was cancelled.

    Its status is canceled, and it has no verdict.
    """
    code = reason.value if reason is StopReason.BATCH_CANCELED else None
    without = {"failure_code": code, "verdict": None, "verdict_reason": None}
    return outcome.model_copy(update={"status": "Canceled", **without})


def failed(code: str, reason: str) -> Outcome:
    """Returns the outcome of a job that failed, with failure code and reason."""
    return _with_failure(Outcome(status="Failed"), code, reason)


def without_outputs(outcome: Outcome, code: str, reason: str) -> Outcome:
    """Returns a job's outcome with the failure that its outputs could not be stored.

    A completed job fails with that code, and loses its verdict; another outcome keeps its status and code.
    """
    reasons = [reason] if outcome.failure_reason is None else [reason, outcome.failure_reason]
    if outcome.status == "Completed":
        without = {"failure_code": None, "verdict": None, "verdict_reason": None}
        outcome = outcome.model_copy(update={"status": "Failed", **without})
    return _with_failure(outcome, outcome.failure_code or code, "\n".join(reasons))


def _with_failure(outcome: Outcome, code: str, reason: str) -> Outcome:
    return outcome.model_copy(update={"failure_code": code, "failure_reason": shorten(reason)})


DIED = "the job worker died while this run went on; the job was run again"
KILLED = "this run was killed while it went on; the job was run again"
_LOST = "the machine it ran on died before its outputs were stored"
_RUNS = ("Preparing", "Running", "RunningFailed", "Restarting")
"""Statuses of a job in which its applications may have run.

A job with forwarded ports is `Preparing` until they answer.
"""

_logger = logging.getLogger(__name__)


class EarlierRuns:
    """Stores the outputs of a job's earlier runs, before a restart or after a crash.

    Args:
        lease: The right to change the job.
        outputs_of: The outputs of one of its runs.
        why_stop: Why the job has to end; `None` if it does not have to.
    """

    def __init__(
        self, lease: Lease, outputs_of: Callable[[str], RunOutputs], why_stop: Callable[[], StopReason | None]
    ) -> None:
        self._lease = lease
        self._outputs_of = outputs_of
        self._why_stop = why_stop

    def keep_restarted(self, run_id: str, ended: RunOutcome) -> None:
        """Uploads the outputs of a run that was ended by a restart of its job, and records that run in the job."""
        self._keep(run_id, outcome_of(ended, None), restarted=True, finished=ended.finished)

    def keep_dead(self, why: str) -> None:
        """Uploads the outputs of a run whose job worker died, and records that run in the job.

        It is unknown whether the run had ended, so it gets no manifest. Does nothing if the run has been recorded
        already, or has no outputs on this machine.

        Args:
            why: Reason why the run was not finished, for readers of its outputs.
        """
        job = self._lease.job
        document = SimulationJobDocument.of(job)
        run_id = document.run_id
        if run_id is None or run_id in kept_runs(document) or job.status not in _RUNS:
            return
        output = self._outputs_of(run_id).output_dir
        if not output.is_dir():
            return
        settle_containers(output.parent, output)  # they do not die with a job worker
        if not any(output.iterdir()):
            return
        add_note(output, why)
        outcome = failed("InternalServiceError", why)
        self._keep(run_id, outcome, restarted=job.status == "Restarting", finished=False)

    def note_lost(self) -> bool:
        """Records that a completed run is lost with its machine, so that the job has to run again.

        Logs it, and records the run in the job as failed. Does nothing for a run that did not complete.

        Returns:
            Whether it is lost: its outputs are neither on this machine nor stored. False if the store does not answer.
        """
        document = SimulationJobDocument.of(self._lease.job)
        run_id, outcome = document.run_id, document.outcome
        if run_id is None or outcome is None or not document.finished or outcome.status != "Completed":
            return False
        outputs = self._outputs_of(run_id)
        if outputs.output_dir.parent.is_dir():
            return False
        try:
            outputs.were_stored(self._is_stopped)
        except StorageUnavailableError:
            return False
        except StorageError as error:
            why = not_stored_by_dead(outputs, error)
            _logger.warning("%s is run again: %s", self._lease.job.arn, why)
            self._note(run_id, without_outputs(outcome, "InternalServiceError", why), not_stored=shorten(why))
            return True
        return False

    def _is_stopped(self) -> bool:
        return self._why_stop() is not None

    def _keep(self, run_id: str, outcome: Outcome, *, restarted: bool, finished: bool) -> None:
        """Uploads the outputs of a run that is not the job's last one, and records in the job where they are.

        If the job has to end while the store does not answer, this run's outputs become those of the job. If they
        cannot be stored, that is logged and recorded instead. Deletes the run's folder on this machine once they are.
        """
        outputs = self._outputs_of(run_id)
        place, not_stored = None, None
        try:
            about = {**outcome.about_run(), "restarted": restarted}
            place = outputs.store(about, finished=finished, stopped=self._is_stopped)
        except (StorageError, OSError) as error:
            if self._why_stop() is not None:
                return
            not_stored = shorten(outputs.not_stored(error))
            _logger.warning("%s is run again, but its %s", self._lease.job.arn, not_stored)
        self._note(run_id, outcome, restarted=restarted, place=place, not_stored=not_stored)
        if place is not None:  # noted by now: a job worker that dies here leaves a folder, and no unknown outputs
            remove_run(outputs.output_dir.parent)

    def _note(
        self,
        run_id: str,
        outcome: Outcome,
        *,
        restarted: bool = False,
        place: StoredPlace | None = None,
        not_stored: str | None = None,
    ) -> None:
        """Adds a run that was not the job's last to the job's list of earlier runs in the catalog.

        Args:
            run_id: The run.
            outcome: Status, failure and simulated time with which it ended.
            restarted: Whether it was ended to restart the job.
            place: Folder of its outputs in the object store; absent: none are stored.
            not_stored: Reason why its outputs are not stored; absent: they are, or it had none.
        """
        document = SimulationJobDocument.of(self._lease.job)
        run = EarlierRun(
            run_id=run_id,
            started_at=document.last_started_at,
            status=outcome.status,
            failure_code=outcome.failure_code,
            failure_reason=outcome.failure_reason,
            simulation_time_millis=outcome.simulation_time_millis,
            restarted=restarted,
            outputs=place,
            not_stored=not_stored,
        )
        self._lease.update(SimulationJobProgress(earlier_runs=[*document.earlier_runs, run]))


def not_stored_by_dead(outputs: RunOutputs, error: Exception) -> str:
    """Returns the failure text that a run's outputs are not stored, because the machine it ran on has died."""
    return f"{_LOST} in s3://{outputs.bucket}/{outputs.prefix}: {error}"
