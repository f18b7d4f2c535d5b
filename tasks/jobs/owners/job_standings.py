"""The process that carries out a job, whether it lives, and what goes on with the job, wherever that is shown."""

import os
from collections.abc import Iterable, Mapping

from ....schemas.job_owners import JobOwner, JobStanding, NeededEnvironment, OwnerState
from ....schemas.lifecycles import is_terminal
from ...catalog import Ownership, Resource
from ...execution.held_leases import died_here
from ...service.service import Service
from .needed_environments import environment_here


def standing_of(job: Resource, service: Service) -> JobStanding | None:
    """Returns who carries out a job.

    Args:
        job: the job or batch.
        service: where it is stored.

    Returns:
        Its standing; `None`: no process has begun with it.
    """
    return standings_of([job], service).get(job.arn)


def standings_of(jobs: Iterable[Resource], service: Service) -> dict[str, JobStanding]:
    """Returns who carries out some jobs, by ARN; jobs that no process has begun with are left out.

    Args:
        jobs: jobs and batches. Of a batch's job the environment that the batch needs counts.
        service: where they are stored.
    """
    wanted = list(jobs)
    found = service.catalog.ownerships([arn for job in wanted for arn in (job.arn, job.parent) if arn])
    return {
        job.arn: _standing(job, ownership, found.get(job.parent or ""), service)
        for job in wanted
        if (ownership := found.get(job.arn)) is not None and ownership.owner is not None
    }


def needs_elsewhere(needed: Mapping[str, object] | None, service: Service) -> list[str]:
    """Names the needs of a job that this process does not meet; nothing: it may carry the job out.

    Args:
        needed: what was recorded with the order; `None`: a client ordered it.
        service: of this process.
    """
    if needed is None:
        return []
    wanted = NeededEnvironment.of_stored(needed)
    return wanted.differences(environment_here(wanted, service.settings, os.environ))


def left_jobs(service: Service) -> list[tuple[Resource, JobStanding]]:
    """The jobs that have not ended, and that the process left that ordered them for itself."""
    jobs = service.catalog.ordered_for_oneself()
    standings = standings_of(jobs, service)
    return [(job, standings[job.arn]) for job in jobs if standings[job.arn].state in ("died", "left")]


def _standing(job: Resource, ownership: Ownership, above: Ownership | None, service: Service) -> JobStanding:
    standing = JobStanding(
        owner=JobOwner.of_lease(ownership.owner or ""),
        since=ownership.since,
        state=_state(job, ownership),
        lost=JobOwner.of_lease(ownership.lost_owner) if ownership.lost_owner else None,
    )
    needed = ownership.needed_environment or (above.needed_environment if above else None)
    if needed is None or standing.state not in ("died", "left"):
        return standing
    wanted = NeededEnvironment.of_stored(needed)
    here = environment_here(wanted, service.settings, os.environ)
    arn = job.arn if ownership.needed_environment else job.parent or job.arn
    return standing.model_copy(
        update={
            "differences": tuple(wanted.differences(here)),
            "command": wanted.command(arn, here),
            "machine": wanted.machine,
        }
    )


def _state(job: Resource, ownership: Ownership) -> OwnerState:
    if is_terminal(job.kind, job.status):
        return "ended"
    if ownership.is_released:
        return "left"
    return "works" if ownership.is_held and not died_here(ownership.owner or "") else "died"
