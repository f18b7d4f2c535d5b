"""Outputs that a run left on this machine because the object store was away: found, and stored after all.

A job whose outputs could not be stored ends as the service's jobs do, `Failed` with a code, and its lifecycle leads
nowhere from there. When its outputs are stored later it keeps that status and code; it says where they are, has the
verdict of its run again, and its failure reason says that they were late.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ...schemas.documents.simulation_jobs import EarlierRun, Outcome, SimulationJobDocument, SimulationJobProgress
from ...schemas.documents.worlds import StoredPlace
from ...schemas.lifecycles import is_terminal
from ...schemas.wire.common import shorten
from ...schemas.wire.errors import StateConflictError
from ..catalog import Resource
from ..execution.blocks.credential_blocks import read_credential_block
from ..execution.held_leases import HELD
from ..execution.job_leases import Lease
from ..service.service import Service
from ..simulations.containers.cleanup import remove_run
from ..simulations.outputs.run_outputs import RunOutputs
from .job_folders import KIND, clean_up_job, has_unstored, kept_runs


@dataclass(frozen=True)
class KeptOutputs:
    """Outputs of one run of a job that has ended."""

    job: Resource
    run_id: str
    folder: Path
    """The run's own."""

    @property
    def output_dir(self) -> Path:
        """The folder that the run wrote to."""
        return self.folder / "output"

    def files(self) -> Iterator[Path]:
        """Files to store; one may be there under two names."""
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
    """Finds the outputs on this machine of jobs that have ended and whose outputs are not stored.

    Args:
        service: where the jobs are stored.
        job: ARN or id of the only job that is looked at; absent: all.

    Raises:
        ResourceNotFoundException: there is no such job.
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
    """Stores outputs that were kept, says in the job where they are, and removes them from this machine.

    What an earlier attempt stored of them is not stored again.

    Raises:
        StateConflictError: another process does the same, or has done it.
        StorageError: they cannot be stored.
        OSError: they cannot be read.
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
    """Whether the job says of a run that its outputs are nowhere."""
    if run_id == document.run_id:
        return document.outputs is None
    earlier = kept_runs(document).get(run_id)
    return earlier is not None and earlier.outputs is None


def _outcome_of(document: SimulationJobDocument) -> Outcome:
    """How the job's last run finished; of a job whose job workers died all the time nothing else is known."""
    return document.outcome or Outcome(
        status="Failed", failure_code=document.failure_code, failure_reason=document.failure_reason
    )


def _store_earlier(run: EarlierRun, outputs: RunOutputs) -> StoredPlace:
    """Stores what a run left that was not its job's last one, as it would have been when it ended."""
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
    """Changes of the job: it stays failed, and is no longer without outputs."""
    late = f"the outputs could not be stored when the run ended; they were at {service.clock():%Y-%m-%dT%H:%M:%SZ}"
    reason = shorten("\n".join(filter(None, (late, outcome.failure_reason))))
    if document.failure_code is None:  # such as of a job that was cancelled
        return SimulationJobProgress(outputs=place)
    return SimulationJobProgress(
        outputs=place, failure_reason=reason, verdict=outcome.verdict, verdict_reason=outcome.verdict_reason
    )
