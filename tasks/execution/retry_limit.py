"""Giving up a job that its performers do not survive.

A simulation runs in a process of its own, which its performer outlives. What still takes performers
along, again and again, would do so for ever: for want of memory, or through a defect. Such a job fails.
"""

from typing import Any

from ...schemas.lifecycles import LIFECYCLES
from ..service.service import Service
from .leases import Lease

MAX_LOST_WORKERS = 3
_MOST_OF_BATCHES = 10
"""How many a batch may lose: its jobs are found out before it is."""

_EVENTS = ("terminate", "fail", "canceled")


def why_not_retried(lease: Lease, service: Service) -> str | None:
    """Why a job is not to be begun again, if so."""
    most = _MOST_OF_BATCHES if lease.job.kind == "simulation-job-batch" else MAX_LOST_WORKERS
    lost = service.catalog.lost_performers(lease.job.arn)
    if lost < most:
        return None
    return f"{lost} performers died, one after the other, while they performed this job; it is not begun again"


def give_up(lease: Lease, reason: str, service: Service) -> None:
    """Ends a job as failed, or as canceled if it was being canceled; the jobs of a batch are to be canceled."""
    transitions = LIFECYCLES[lease.job.kind].transitions
    changes: dict[str, Any] = {"failureCode": "InternalServiceError", "failureReason": reason}
    if lease.job.kind == "simulation-job":
        changes["ending"] = {"status": "Failed", **changes}
    for job in service.catalog.children(lease.job.arn, kind="simulation-job"):
        service.catalog.request_cancel(job.arn)
    for event in _EVENTS:
        if (lease.job.status, event) in transitions:
            lease.transition(event, **changes)
