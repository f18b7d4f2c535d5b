"""Folders of jobs on this machine: what stays of them when a job is over, and the cleanup after dead job workers.

Containers go on when the process that started them dies. When a job worker and its supervisors were killed and no
other takes the job over, the next job worker on the machine removes the containers, whatever job it runs.
"""

import logging
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from ...schemas.documents.simulation_jobs import EarlierRun, SimulationJobDocument
from ...schemas.lifecycles import is_terminal
from ...schemas.wire.errors import ServiceUnavailableException
from ..catalog import Resource
from ..execution.held_leases import died_here
from ..service.service import Service
from ..simulations.containers.cleanup import has_containers, remove_containers, remove_containers_of_job, remove_run
from ..simulations.environment.folders import remove
from ..simulations.outputs.run_outputs import NOT_STORED

KIND = "simulation-job"

_QUIET_S = 600.0
"""For how long nothing of a run must have changed before its folder counts as left."""

_logger = logging.getLogger(__name__)


def clean_up_job(folder: Path, document: SimulationJobDocument, run_id: str) -> None:
    """Removes what is not needed any more of a job that no job worker runs.

    Outputs that could not be stored stay, and so does a run with containers that could not be removed.

    Args:
        folder: the job's.
        document: what is known of the job.
        run_id: its last run.
    """
    remove_containers_of_job(folder)
    run = folder / run_id
    if document.outputs is not None:
        kept = {run_id for run_id, run in kept_runs(document).items() if run.outputs is None}
        for each in folder.glob("*"):  # also what job workers left that died
            if each.name not in kept:
                remove_run(each)
    elif not has_containers(run) and has_unstored(run):
        for each in run.iterdir():
            if each.name not in NOT_STORED:
                remove(each)
    else:
        remove_run(run)
    with suppress(OSError):
        folder.rmdir()


def kept_runs(document: SimulationJobDocument) -> dict[str, EarlierRun]:
    """The runs before a job's last one, by their ids."""
    return {run.run_id: run for run in document.earlier_runs}


def remove_abandoned_containers(service: Service) -> None:
    """Removes the containers of abandoned runs: of jobs that are over, and of job workers that died here.

    Of the former the folders go too, which were kept because a container could not be removed. What does not work is
    logged, and tried again by the next.

    Args:
        service: where the jobs are stored.
    """
    try:
        for run, job in abandoned_runs(service):
            _logger.warning("containers of %s are removed: no job worker runs it any more", run)
            if is_terminal(job.kind, job.status):
                document = SimulationJobDocument.of(job)
                clean_up_job(run.parent, document, document.run_id or run.name)
            else:
                remove_containers(run)
            if has_containers(run):
                return  # so that an engine that does not answer costs one timeout only
    except (OSError, ServiceUnavailableException) as error:
        _logger.warning("abandoned containers are not looked for: %s", error)


def abandoned_runs(service: Service) -> Iterator[tuple[Path, Resource]]:
    """Folders of runs on this machine that have containers, but no job worker; each with its job.

    Jobs that the catalog does not know may be of another region or account, and are left alone.

    Args:
        service: where the jobs are stored.

    Raises:
        ServiceUnavailableException: the catalog does not answer.
    """
    for run in _runs(service.settings.home / "jobs"):
        if has_containers(run):
            arn = service.arn(KIND, run.parent.name)
            job = service.catalog.get_many([arn]).get(arn)
            if job is not None and _is_abandoned(job, service):
                yield run, job


def overtaken_runs(service: Service) -> list[tuple[Path, Resource]]:
    """Folders of runs on this machine of which nothing is needed, each with its job, which has ended.

    Another process took the job over, perhaps on another machine, and the outputs are those of its run. Outputs that
    could not be stored are needed; so is what has changed a moment ago, as its process may still end its programs.

    Args:
        service: where the jobs are stored.

    Raises:
        ServiceUnavailableException: the catalog does not answer.
    """
    runs = [run for run in _runs(service.settings.home / "jobs") if run.is_dir() and _is_quiet(run)]
    jobs = service.catalog.get_many({service.arn(KIND, run.parent.name) for run in runs})
    found: list[tuple[Path, Resource]] = []
    for run in runs:
        job = jobs.get(service.arn(KIND, run.parent.name))
        if job is None or not is_terminal(job.kind, job.status):
            continue
        document = SimulationJobDocument.of(job)
        earlier = kept_runs(document).get(run.name)
        is_needed = (
            document.outputs is None if run.name == document.run_id else earlier is not None and not earlier.outputs
        )
        if not is_needed and service.catalog.lease_of(job.arn)[0] is None:
            found.append((run, job))
    return found


def remove_overtaken_runs(service: Service) -> list[Path]:
    """Removes what is not needed of jobs that others took over; what does not work is logged, and tried again later.

    Returns:
        The folders that are gone.
    """
    gone: list[Path] = []
    try:
        for run, _ in overtaken_runs(service):
            if remove_run(run):
                gone.append(run)
            with suppress(OSError):
                run.parent.rmdir()
    except (OSError, ServiceUnavailableException) as error:
        _logger.warning("runs that others took over are not looked for: %s", error)
    if gone:
        _logger.info("removed %d folders of runs that others took over", len(gone))
    return gone


def _is_quiet(run: Path) -> bool:
    """Whether nothing in a run's folder was written lately."""
    with suppress(OSError):
        changed_s = max(path.stat().st_mtime for path in (run, *run.iterdir(), *run.glob("output/*")))
        return time.time() - changed_s > _QUIET_S
    return False


def _runs(jobs: Path) -> list[Path]:
    """The folders of all runs, job by job: jobs that end meanwhile take theirs away, which breaks a single glob."""
    found: list[Path] = []
    for job in jobs.glob("*"):
        with suppress(FileNotFoundError, NotADirectoryError):
            found += job.iterdir()
    return sorted(found)


def _is_abandoned(job: Resource, service: Service) -> bool:
    owner, has_run_out = service.catalog.lease_of(job.arn)
    if owner is None:
        return is_terminal(job.kind, job.status)
    return has_run_out and died_here(owner)  # not where its machine slept for a while


def has_unstored(run: Path) -> bool:
    """Whether there is something in a run's folder that was to be stored."""
    return any((run / "output").glob("*")) or any((run / name).exists() for name in NOT_STORED[1:])
