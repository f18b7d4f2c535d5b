"""How a simulation job ends, as the catalog keeps it: status, failure code, reason, how long it ran."""

from typing import Any

from ...schemas.runs.plan import RunOutcome
from ...schemas.wire.common import shorten

Ending = dict[str, Any]
"""`status`, and those of `failureCode`, `failureReason`, `simulationTimeMillis` and `outputs` that there are."""

CANCELED = "Canceled"
"""Why a job stops that was cancelled itself; other reasons are failure codes."""

END_EVENTS = {"Completed": "complete", "Failed": "fail", CANCELED: "cancel"}
"""The event that leads from `Terminating` to an ending's status."""


def ending_of(outcome: RunOutcome, stopped_because: str | None) -> Ending:
    """The ending that a run leads to.

    Args:
      outcome: how the run ended.
      stopped_because: why the job had to stop, `CANCELED` or a failure code; `None` if it did not have to.
    """
    ending: Ending = {"status": outcome.status}
    if outcome.failure_code:
        ending |= failed(outcome.failure_code, outcome.failure_reason or "") | {"status": outcome.status}
    elif outcome.status == CANCELED:
        ending = stopped(stopped_because or CANCELED, "the job was stopped while it ran")
    duration = outcome.ended_at - outcome.started_at
    return ending | {"simulationTimeMillis": round(duration.total_seconds() * 1000)}


def stopped(reason: str, words: str) -> Ending:
    """The ending of a job that had to stop, because of `CANCELED` or a failure code."""
    if reason == CANCELED:
        return {"status": CANCELED}
    return {"status": CANCELED, "failureCode": reason, "failureReason": words}


def failed(code: str, reason: str) -> Ending:
    """The ending of a job that failed."""
    return {"status": "Failed", "failureCode": code, "failureReason": shorten(reason)}


def without_outputs(ending: Ending, code: str, reason: str) -> Ending:
    """An ending that lost its outputs: a crash that came before keeps its code, a cancelled job stays cancelled."""
    reasons = [reason, ending["failureReason"]] if "failureReason" in ending else [reason]
    failure = failed(code, "\n".join(reasons))
    if ending["status"] != "Completed":
        failure |= {"status": ending["status"], "failureCode": ending.get("failureCode", code)}
    return ending | failure


def members_of(ending: Ending) -> dict[str, Any]:
    """What of an ending is a member of the job's document; its status is the job's own."""
    return {key: value for key, value in ending.items() if key != "status"}
