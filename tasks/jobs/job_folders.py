"""Local folders of jobs: cleanup after job workers that died, and late uploads of outputs."""

import logging
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ...schemas.documents.simulation_jobs import EarlierRun, Outcome, SimulationJobDocument, SimulationJobProgress
from ...schemas.documents.worlds import StoredPlace
from ...schemas.lifecycles import is_terminal
from ...schemas.wire.common import shorten
from ...schemas.wire.errors import ServiceUnavailableException, StateConflictError
from ..catalog import Resource
from ..execution.credential_blocks import read_credential_block
from ..execution.leases.held_leases import HELD, died_here
from ..execution.leases.job_leases import Lease
from ..service.service import Service
from ..simulations.containers.cleanup import has_containers, remove_containers, remove_containers_of_job, remove_run
from ..simulations.environment.folders import remove
from ..simulations.outputs.run_outputs import NOT_STORED, RunOutputs

KIND = "simulation-job"

_QUIET_S = 600.0
"""Time without changes after which a run's folder counts as abandoned, in seconds."""

_logger = logging.getLogger(__name__)


def clean_up_job(folder: Path, document: SimulationJobDocument, run_id: str) -> None:
    """Deletes local files of a job that no job worker runs; outputs not uploaded yet stay.

    Outputs that could not be stored stay, and so does a run with containers that could not be removed.

    Args:
        folder: Folder of the job.
        document: Document of the job.
        run_id: Id of the job's last run.
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
    """Returns the job's runs before the last one, by run id."""
    return {run.run_id: run for run in document.earlier_runs}


def remove_abandoned_containers(service: Service) -> None:
    """Removes containers of jobs that have ended, and of job workers that died on this machine.

    Folders of ended jobs that were kept because a container could not be removed are removed as well. Failures are
    logged; the next call tries again.

    Args:
        service: The service, with its catalog and object store.
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
    """Yields run folders on this machine that have containers but no job worker, each with its job.

    Jobs that the catalog does not know may be of another region or account, and are left alone.

    Args:
        service: The service, with its catalog and object store.

    Raises:
        ServiceUnavailableException: The catalog does not answer.
    """
    for run in _runs(service.settings.home / "jobs"):
        if has_containers(run):
            arn = service.arn(KIND, run.parent.name)
            job = service.catalog.get_many([arn]).get(arn)
            if job is not None and _is_abandoned(job, service):
                yield run, job


def overtaken_runs(service: Service) -> list[tuple[Path, Resource]]:
    """Lists run folders on this machine that another process made useless by taking over the job.

    Another process took the job over, perhaps on another machine, and the outputs are those of its run. Outputs that
    could not be stored are needed; so is what has changed a moment ago, as its process may still end its programs.

    Args:
        service: The service, with its catalog and object store.

    Raises:
        ServiceUnavailableException: The catalog does not answer.
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
    """Deletes the run folders that `overtaken_runs` lists; failures are logged and retried later.

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
    """Whether nothing in a run's folder was written lately, so that no process uses it; false if it cannot be read."""
    with suppress(OSError):
        changed_s = max(path.stat().st_mtime for path in (run, *run.iterdir(), *run.glob("output/*")))
        return time.time() - changed_s > _QUIET_S
    return False


def _runs(jobs: Path) -> list[Path]:
    """Lists the folders of all runs, job by job.

    Jobs that end meanwhile delete theirs, which breaks a single glob.
    """
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
    """Whether a run's folder has outputs that were not uploaded."""
    return any((run / "output").glob("*")) or any((run / name).exists() for name in NOT_STORED[1:])


@dataclass(frozen=True)
class KeptOutputs:
    """Outputs of a run that are still on this machine because their upload failed."""

    job: Resource
    run_id: str
    folder: Path
    """Folder of the job's run whose upload failed."""

    @property
    def output_dir(self) -> Path:
        """Folder that the run wrote its outputs to."""
        return self.folder / "output"

    def files(self) -> Iterator[Path]:
        """Yields the files to upload from the run's folders; a file with two names comes once; links are left out."""
        seen: set[tuple[int, int]] = set()
        for path in (
            *self.output_dir.rglob("*"),
            *self.folder.glob("uploads/*/**/*"),
            *self.folder.glob("rolling/**/*"),
        ):
            about = path.lstat()
            if path.is_file() and not path.is_symlink() and (about.st_dev, about.st_ino) not in seen:
                seen.add((about.st_dev, about.st_ino))
                yield path


def find_kept(service: Service, job: str | None = None) -> list[KeptOutputs]:
    """Returns outputs on this machine whose upload failed, of jobs that have ended.

    Args:
        service: The service, with its catalog and object store.
        job: ARN or id of the only job that is looked at; absent: all.

    Raises:
        ResourceNotFoundException: The catalog has no such job.
    """
    pattern = "*/*"
    if job is not None:
        arn = job if job.startswith("arn:") else service.arn(KIND, job)
        pattern = f"{service.catalog.get(arn, kind=KIND).id}/*"
    found: list[KeptOutputs] = []
    for folder in sorted((service.settings.home / "jobs").glob(pattern)):
        if folder.is_dir() and has_unstored(folder):
            arn = service.arn(KIND, folder.parent.name)
            stored = service.catalog.get_many([arn]).get(arn)
            if stored is not None and _is_kept(stored, folder.name, service):
                found.append(KeptOutputs(stored, folder.name, folder))
    return found


def store_kept(kept: KeptOutputs, service: Service) -> StoredPlace:
    """Uploads outputs whose upload had failed, records their place in the job and returns it, deletes the local copy.

    What an earlier attempt stored of them is not stored again.

    Raises:
        StateConflictError: Another process uploads the same outputs now, or has already uploaded them.
        StorageError: The outputs cannot be stored.
        OSError: The outputs cannot be read.
    """
    arn = kept.job.arn
    with HELD.owner_of(arn) as owner:
        if not service.catalog.claim(arn, owner, service.timing.lease_s):
            raise StateConflictError(f"another process stores or removes the outputs of {arn}")
        lease = Lease(kept.job, owner, service)
        with lease.renewed():
            document = SimulationJobDocument.of(lease.refreshed())
            if not _misses(document, kept.run_id):
                raise StateConflictError(f"the outputs of {arn} have just been stored")
            outputs = RunOutputs(lease.job, kept.run_id, kept.folder, service.with_blocks(read_credential_block))
            if kept.run_id == document.run_id:
                outcome = _outcome_of(document)
                place = outputs.store(outcome.about_run(), finished=bool(document.finished), resumes=True)
                lease.update(_stored_late(document, outcome, place, service))
            else:
                place = _store_earlier(kept_runs(document)[kept.run_id], outputs)
                lease.update(SimulationJobProgress(earlier_runs=_with_place(document, kept.run_id, place)))
            remove_run(kept.folder)
            clean_up_job(kept.folder.parent, SimulationJobDocument.of(lease.job), document.run_id or kept.run_id)
    return place


def _is_kept(job: Resource, run_id: str, service: Service) -> bool:
    if not is_terminal(job.kind, job.status) or not _misses(SimulationJobDocument.of(job), run_id):
        return False
    owner, has_run_out = service.catalog.lease_of(job.arn)
    return owner is None or has_run_out


def _misses(document: SimulationJobDocument, run_id: str) -> bool:
    """Whether the job's document says that the outputs of a run are stored nowhere."""
    if run_id == document.run_id:
        return document.outputs is None
    earlier = kept_runs(document).get(run_id)
    return earlier is not None and earlier.outputs is None


def _outcome_of(document: SimulationJobDocument) -> Outcome:
    """Returns the outcome of the job's last run; if none is recorded, a failure with the job's code and reason."""
    return document.outcome or Outcome(
        status="Failed", failure_code=document.failure_code, failure_reason=document.failure_reason
    )


def _store_earlier(run: EarlierRun, outputs: RunOutputs) -> StoredPlace:
    """Uploads the outputs of an earlier run of a job, and returns the place in the object store where they are now.

    Files that are stored already are not uploaded again. Raises `StorageError` if the upload fails.
    """
    outcome = Outcome(
        status=run.status,
        failure_code=run.failure_code,
        failure_reason=run.failure_reason,
        simulation_time_millis=run.simulation_time_millis,
    )
    about = {**outcome.about_run(), "restarted": run.restarted}
    return outputs.store(about, finished=run.status == "Completed", resumes=True)


def _with_place(document: SimulationJobDocument, run_id: str, place: StoredPlace) -> list[EarlierRun]:
    return [
        run.model_copy(update={"outputs": place, "not_stored": None}) if run.run_id == run_id else run
        for run in document.earlier_runs
    ]


def _stored_late(
    document: SimulationJobDocument, outcome: Outcome, place: StoredPlace, service: Service
) -> SimulationJobProgress:
    """Returns the changes to record in a job whose outputs were uploaded late: their place, verdict and reason.

    The job stays failed, and its failure reason says that the upload was late; a job that has no failure code, such as
    a cancelled one, gets only the place.
    """
    late = f"the outputs could not be stored when the run ended; they were at {service.clock():%Y-%m-%dT%H:%M:%SZ}"
    reason = shorten("\n".join(filter(None, (late, outcome.failure_reason))))
    if document.failure_code is None:  # such as of a job that was cancelled
        return SimulationJobProgress(outputs=place)
    return SimulationJobProgress(
        outputs=place, failure_reason=reason, verdict=outcome.verdict, verdict_reason=outcome.verdict_reason
    )
