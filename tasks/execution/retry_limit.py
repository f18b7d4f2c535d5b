"""The retry limit: fails a job whose job workers keep dying.

A simulation runs in a process of its own, so a crash of it does not end the job worker. A job whose workers still die,
again and again, would kill workers for ever, through lack of memory or a defect. Such a job fails. Deaths are counted
from when the job last came further, so that a long one outlives any number of them.
"""

from ...schemas.documents.base import FailureChanges
from ...schemas.documents.simulation_jobs import Outcome
from ...schemas.lifecycles import LIFECYCLES
from ...schemas.rollouts.events import Stopped
from ..service.service import Service
from .job_leases import Lease

MAX_LOST_WORKERS = 3
_MOST_OF_BATCHES = 10
"""The limit for a batch is higher: the job at fault in it reaches its own limit first."""

_CODE = "InternalServiceError"
_DEPLOYMENT_CODE = "InternalServerError"
_EVENTS = ("terminate", "fail", "canceled")


def why_not_retried(lease: Lease, service: Service) -> str | None:
    """Returns why a job has reached its retry limit; `None` when it may run."""
    most = _MOST_OF_BATCHES if lease.job.kind == "simulation-job-batch" else MAX_LOST_WORKERS
    lost = service.catalog.lost_workers(lease.job.arn)
    if lost < most:
        return None
    return f"{lost} job workers died, one after the other, while they ran this job; it is not begun again"


def fail_job(lease: Lease, reason: str, service: Service) -> None:
    """Ends a job as failed, or as canceled if that was requested; requests the cancellation of a batch's jobs."""
    transitions = LIFECYCLES[lease.job.kind].transitions
    is_deployment = lease.job.kind == "deployment-job"
    changes = FailureChanges(failure_code=_DEPLOYMENT_CODE if is_deployment else _CODE, failure_reason=reason)
    if lease.job.kind == "simulation-job":
        changes = Outcome(status="Failed", failure_code=_CODE, failure_reason=reason).announced(finished=None)
    for job in service.catalog.children(lease.job.arn, kind="simulation-job"):
        service.catalog.request_cancel(job.arn)
    for event in _EVENTS:
        if (lease.job.status, event) in transitions:
            lease.transition(event, changes)
    if is_deployment:  # its robots are told with the next thing that one of them reports
        now_s = service.clock().timestamp()
        service.catalog.add_event(lease.job.arn, Stopped(why="canceled").to_json(), now_s)
