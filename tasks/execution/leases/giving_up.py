"""Giving up on jobs: how many job workers may die while they run a job, and how the job is failed after them."""

from collections.abc import Callable
from dataclasses import dataclass

from ....schemas.documents.document_base import FailureChanges
from ....schemas.documents.simulation_jobs import Outcome
from ....schemas.lifecycles import LIFECYCLES
from ....schemas.wings import parts_of_wings
from ...catalog import Resource
from ...service.service import Service
from .job_leases import Lease

MAX_LOST_WORKERS = 3
_MOST_OF_BATCHES = 10
"""Number of job workers that may die while they run a batch: more than for a job, as the job at fault ends first."""

_CODE = "InternalServiceError"
_EVENTS = ("terminate", "fail", "canceled")


@dataclass(frozen=True)
class GivenUp:
    """Failure code, and function that tells others, by which a kind of job is failed when it cannot be run any more."""

    failure_code: str
    """Failure code that jobs of a kind get when they are given up."""

    tell: Callable[[Resource, Service], None]
    """Function that is called after a given-up job has ended."""


def _given_up(kind: str) -> GivenUp | None:
    return next((part.KINDS[kind] for part in parts_of_wings("tasks", "given_up") if kind in part.KINDS), None)


def why_not_retried(lease: Lease, service: Service) -> str | None:
    """Returns the reason why a job is not begun again, as too many job workers died while they ran it; else `None`."""
    most = _MOST_OF_BATCHES if lease.job.kind == "simulation-job-batch" else MAX_LOST_WORKERS
    lost = service.catalog.lost_workers(lease.job.arn)
    if lost < most:
        return None
    return f"{lost} job workers died, one after the other, while they ran this job; it is not begun again"


def fail_job(lease: Lease, reason: str, service: Service) -> None:
    """Sets a job's status to failed, or canceled if that was requested, and requests that a batch's jobs are cancelled.

    Args:
        lease: The right to change the job.
        reason: Failure reason for the user.
        service: The service, with its catalog and object store.
    """
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
