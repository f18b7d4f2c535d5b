"""Runs of jobs under their leases: waits for the lease, holds it while the job runs, goes on after outages."""

import logging
import time
from collections.abc import Callable

from ....schemas.lifecycles import is_terminal
from ....schemas.wire.errors import LeaseLostError, ServiceUnavailableException
from ...service.service import Service
from ...service.spans import span
from .catalog_outages import CatalogWait
from .giving_up import fail_job, why_not_retried
from .held_leases import HELD, HeldLeases
from .job_leases import Lease

_logger = logging.getLogger(__name__)

_WAIT_S = 0.5


def run_under_lease(
    arn: str, kind: str, service: Service, work: Callable[[Lease], object], held: HeldLeases = HELD
) -> None:
    """Waits for a job's lease (lock) and runs its work while holding it; does nothing if the job has ended.

    Args:
        arn: The job.
        kind: The resource kind it has to be.
        service: The service, with its catalog and object store.
        work: Runs the job from its current state to a terminal state.
        held: Record of the leases that this process holds.

    Raises:
        ResourceNotFoundException: The catalog has no such job.
    """
    while True:
        try:
            if run_if_unclaimed(arn, kind, service, work, held):
                return
        except LeaseLostError as error:
            _logger.warning("%s; its end is waited for", error)
        time.sleep(_WAIT_S)


def run_if_unclaimed(
    arn: str, kind: str, service: Service, work: Callable[[Lease], object], held: HeldLeases = HELD
) -> bool:
    """Runs a job's work if the job has not ended and no other job worker holds its lease (lock).

    Args:
        arn: The job.
        kind: The resource kind it has to be.
        service: The service, with its catalog and object store.
        work: Carries the job on, holding its lease.
        held: Record of the leases that this process holds.

    Returns:
        True when `work` was run or the job had ended; false when another worker holds its lease.

    Raises:
        ResourceNotFoundException: The catalog has no such job.
        LeaseLostError: Another job worker took over the job while its work was running.
        WorkerStopping: This process is about to end.
    """
    job = service.catalog.get(arn, kind=kind)
    if is_terminal(job.kind, job.status):
        return True
    with held.owner_of(arn) as owner:
        if not service.catalog.claim(arn, owner, service.timing.lease_s):
            return False
        lease = Lease(job, owner, service)
        with lease.renewed():
            if is_terminal(kind, lease.refreshed().status):
                return True
            if reason := why_not_retried(lease, service):
                fail_job(lease, reason, service)
            else:
                with span(f"run {kind}", arn=arn) as current:
                    _outlast(work, lease, service)
                    current.set_attribute("robomaker.status", lease.job.status)
    return True


def _outlast(work: Callable[[Lease], object], lease: Lease, service: Service) -> None:
    """Runs a job to completion, and continues from its current state after each outage of the catalog.

    Args:
        work: Runs the job from its current state to a terminal state.
        lease: The right to change the job.
        service: The service, with its catalog and object store.

    Raises:
        ServiceUnavailableException: Another worker took the job over during an outage, or the catalog is there and
            accepts no change.
    """
    wait = CatalogWait.of(lease, service)
    while not is_terminal(lease.job.kind, lease.job.status):
        try:
            work(lease)
        except ServiceUnavailableException as error:
            wait.outlast(error)
        else:
            return
