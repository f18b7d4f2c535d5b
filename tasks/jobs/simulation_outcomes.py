"""How a simulation job finishes: the outcome of its last run, or of stopping it before there was one."""

from collections.abc import Mapping

from ...schemas.documents.simulation_jobs import Outcome, OutcomeStatus
from ...schemas.runs.plan import RunOutcome
from ...schemas.runs.stops import StopReason
from ...schemas.wire.common import shorten

END_EVENTS: Mapping[OutcomeStatus, str] = {"Completed": "complete", "Failed": "fail", "Canceled": "cancel"}
"""The event that leads from `Terminating` to an outcome's status."""


def outcome_of(run: RunOutcome, stopped_because: StopReason | None) -> Outcome:
    """The outcome of a job that a run leads to.

    Args:
        run: how the run ended.
        stopped_because: why the job had to stop; `None` if it did not have to.
    """
    if is_overtaken(run.status, stopped_because):
        run = run.model_copy(update={"status": "Canceled"})
    outcome = Outcome(status=run.status)
    if run.status == "Completed" and run.verdict is not None:
        reason = shorten(run.verdict_reason) if run.verdict_reason else None
        outcome = outcome.model_copy(update={"verdict": run.verdict, "verdict_reason": reason})
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
    """Whether a run's good end gives way to a cancellation that was answered before the job had ended.

    One that failed stays failed, and the end of a batch takes nothing from a job whose run was over, unless its outputs
    were not stored as a whole for that.
    """
    if stopped_because is StopReason.BATCH_CANCELED and is_whole:
        return False
    return status == "Completed" and stopped_because in (StopReason.CANCELED, StopReason.BATCH_CANCELED)


def stopped(reason: StopReason, words: str) -> Outcome:
    """The outcome of a job that had to stop; one that was cancelled itself has no failure code."""
    if reason is StopReason.CANCELED:
        return Outcome(status="Canceled")
    return Outcome(status="Canceled", failure_code=reason.value, failure_reason=words)


def overtaken(outcome: Outcome, reason: StopReason | None = None) -> Outcome:
    """The outcome of a job whose run had completed when it, or its batch, was cancelled."""
    code = reason.value if reason is StopReason.BATCH_CANCELED else None
    without = {"failure_code": code, "verdict": None, "verdict_reason": None}
    return outcome.model_copy(update={"status": "Canceled", **without})


def failed(code: str, reason: str) -> Outcome:
    """The outcome of a job that failed."""
    return _with_failure(Outcome(status="Failed"), code, reason)


def without_outputs(outcome: Outcome, code: str, reason: str) -> Outcome:
    """An outcome that lost its outputs: a crash that came before keeps its code, a cancelled job stays cancelled."""
    reasons = [reason] if outcome.failure_reason is None else [reason, outcome.failure_reason]
    if outcome.status == "Completed":
        without = {"failure_code": None, "verdict": None, "verdict_reason": None}
        outcome = outcome.model_copy(update={"status": "Failed", **without})
    return _with_failure(outcome, outcome.failure_code or code, "\n".join(reasons))


def _with_failure(outcome: Outcome, code: str, reason: str) -> Outcome:
    return outcome.model_copy(update={"failure_code": code, "failure_reason": shorten(reason)})
