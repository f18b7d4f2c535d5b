"""Common parts of world generation jobs and world export jobs: cancellation and end."""

from collections.abc import Callable
from contextlib import suppress

from ...schemas.documents.world_export_jobs import WorldExportProgress
from ...schemas.documents.world_generation_jobs import WorldGenerationProgress
from ...schemas.lifecycles import is_terminal
from ...schemas.wire.errors import StateConflictError
from ..execution.job_leases import Lease
from ..execution.one_worker_per_job import run_if_unclaimed
from ..service.service import Service

WorldJobProgress = WorldGenerationProgress | WorldExportProgress


def cancel_world_job(arn: str, kind: str, service: Service, work: Callable[[Lease], None]) -> None:
    """Cancels a job: at once if no job worker runs it, else as soon as its worker notices.

    Cancelling a job that has ended, or is being cancelled, changes nothing and succeeds.

    Args:
        arn: the job.
        kind: the resource kind it has to be.
        service: where it is stored.
        work: ends a job that is being cancelled, holding its lease.

    Raises:
        ResourceNotFoundException: there is no such job.
    """
    service.catalog.get(arn, kind=kind)
    if is_terminal(kind, service.catalog.request_cancel(arn).status):
        return
    with suppress(StateConflictError):  # it has just ended, or is being cancelled already
        service.catalog.transition(arn, "cancel")
    run_if_unclaimed(arn, kind, service, work)


def move_on(lease: Lease, event: str, changes: WorldJobProgress | None = None) -> bool:
    """Moves a job on, unless it is being cancelled meanwhile: then it ends as cancelled.

    Args:
        lease: the right to change the job.
        event: what happened.
        changes: members of the document that are set with it, without those of failures if it is cancelled.

    Returns:
        Whether the event happened; false: the job is `Canceled` now.

    Raises:
        StateConflictError: the event cannot happen, or the lease was lost.
    """
    try:
        lease.transition(event, changes)
    except StateConflictError:
        if lease.refreshed().status != "Canceling":
            raise
        lease.transition("canceled", changes and changes.without("failure_code", "failure_reason"))
        return False
    return True


def end_canceled(lease: Lease, changes: WorldJobProgress | None = None) -> None:
    """Ends a job as cancelled, whether its status says already that it will be or not.

    Raises:
        StateConflictError: it has ended, or the lease was lost.
    """
    with suppress(StateConflictError):
        lease.transition("cancel")
    lease.transition("canceled", changes)
