"""Finds a stored run, or one of its trials, by ARN or id of its job, S3 address, or folder."""

import errno
import hashlib
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from pydantic import ValidationError

from ...schemas.documents.simulation_jobs import SimulationJobDocument
from ...schemas.lifecycles import is_terminal
from ...schemas.runs.plan import RunPlan
from ...schemas.runs.provenance import PROVENANCE_FILE, Manifest
from ...schemas.runs.trial_rows import TRIALS_FILE, TrialRow, TrialsSummary, plan_of_trial
from ...schemas.runs.trials import Trial
from ...schemas.wire.errors import ConfigurationError, ObjectNotFoundError, StorageError
from ..catalog import Resource
from ..files.untrusted_files import open_left
from ..runtime.agents.action_log import ACTIONS_FILE
from ..runtime.episode.run_results import RESULT_FILE
from ..runtime.replay.replay import RunOutputs, read_outputs
from ..runtime.states.digest import DIGEST_FILE
from ..runtime.trials.completion import read_row
from ..service.references import find_job
from ..service.service import Service
from ..storage import MANIFEST_NAME
from ..storage.object_store import join_key

_NO_FILE = (errno.ELOOP, errno.EINVAL, errno.ENXIO)
"""Error numbers of opening a link, a folder or FIFO, or a socket as a file."""
_TRIAL_OUTPUTS = re.compile(r"trials/(\d+)/")
_WRITTEN_DOWN = (PROVENANCE_FILE, DIGEST_FILE, ACTIONS_FILE, RESULT_FILE, TRIALS_FILE, MANIFEST_NAME)

Sha256Of = Callable[[str], str | None]
"""Function that returns the SHA-256 of an output file by its path; None: the file does not exist."""


@dataclass(frozen=True)
class FoundRun:
    """A simulation run with its plan, provenance and results, in a folder on this machine."""

    outputs: RunOutputs
    folder: Path
    """Folder with the run's records; it does not contain all outputs."""
    job: Resource | None
    """Job of the run, if the catalog still has it."""
    sha256_of: Sha256Of
    """Function that returns the SHA-256 of an output file, whether or not it is in `folder`."""
    failure_code: str | None = None
    """Failure code of the run; None: it did not fail."""

    def alterations(self, trial: int | None = None) -> list[str]:
        """Lists, as text, the output files that differ from the run's manifest.

        Args:
            trial: Number of the trial to check; files of other trials are ignored.

        Raises:
            StorageError: The manifest or a file cannot be read.
        """
        try:
            manifest = Manifest.model_validate_json((self.folder / MANIFEST_NAME).read_bytes())
        except FileNotFoundError:
            return []
        except ValidationError as error:
            raise StorageError(f"{MANIFEST_NAME} cannot be read: {error.errors()[0]['msg']}") from error
        stated = {file.path: file.sha256 for file in manifest.files if _is_asked(file.path, trial)}
        new = [name for name in _WRITTEN_DOWN if name not in stated and (self.folder / name).exists()]
        found = [f"{name} was added" for name in new if name != MANIFEST_NAME]
        for name, sha256 in stated.items():
            now = self.sha256_of(name)
            if now != sha256:
                found.append(f"{name} is gone" if now is None else f"{name} changed after the run")
        return found


def _is_asked(path: str, trial: int | None) -> bool:
    of_trial = _TRIAL_OUTPUTS.match(path)
    return trial is None or of_trial is None or int(of_trial[1]) == trial


@contextmanager
def found_run(reference: str, service: Service) -> Iterator[FoundRun]:
    """Finds a simulation run and copies its records to a temporary folder, which is deleted after the `with` block.

    Args:
        reference: ARN, id (or its beginning) or name of a simulation job, `s3://bucket/prefix` or a local folder of
            outputs.
        service: Service whose catalog has the job and whose object store has the outputs.

    Raises:
        ConfigurationError: The reference is not that of a run, or the run has not ended.
        ResourceNotFoundException: The catalog has no such job.
        StorageError: The outputs of the run cannot be read.
    """
    with scratch_folder(service) as scratch:
        job = _job_of(reference, service)
        if job is not None:
            _check_ended(job)
            sha256_of = _fetch_of_job(job, scratch, service)
        elif reference.startswith("s3://"):
            bucket, _, prefix = reference.removeprefix("s3://").partition("/")
            sha256_of = _fetch(bucket, prefix.rstrip("/"), scratch, service)
        else:
            sha256_of = _copy(Path(reference), scratch)
        outputs = _read(scratch, reference)
        if job is None:
            plan = outputs.provenance.plan
            job = service.catalog.get_many([plan.job_arn]).get(plan.job_arn)
            if job is not None and SimulationJobDocument.of(job).run_id == plan.run_id:  # earlier runs of it have ended
                _check_ended(job)
        failure_code = SimulationJobDocument.of(job).failure_code if job is not None else None
        yield FoundRun(outputs, scratch, job, sha256_of, failure_code)


def _job_of(reference: str, service: Service) -> Resource | None:
    if reference.startswith("s3://") or (not reference.startswith("arn:") and Path(reference).is_dir()):
        return None
    return find_job(reference, service, ", nor s3://BUCKET/PREFIX or a folder of outputs")


def _check_ended(job: Resource) -> None:
    """Raises ConfigurationError if a job has not ended: its files are incomplete, and it may still use containers."""
    if not is_terminal(job.kind, job.status):
        raise ConfigurationError(
            f"{job.arn} has not ended, it is {job.status}: wait until it is Completed, Failed or Canceled, or cancel it"
        )


def _fetch_of_job(job: Resource, folder: Path, service: Service) -> Sha256Of:
    """Copies the records of a job's last run to a folder, from the object store or from its folder on this machine.

    Raises ConfigurationError if the job has no outputs in either place.
    """
    document = SimulationJobDocument.of(job)
    kept = service.settings.home / "jobs" / job.id / str(document.run_id) / "output"
    if place := document.outputs:
        return _fetch(place.bucket, place.prefix, folder, service)
    if kept.is_dir():
        return _copy(kept, folder)
    raise ConfigurationError(f"{job.arn} has no outputs: it is {job.status}, and none are on this machine")


def _fetch(bucket: str, prefix: str, folder: Path, service: Service) -> Sha256Of:
    for name in _WRITTEN_DOWN:
        try:
            service.store.get_file(bucket, join_key(prefix, name), folder / name)
        except ObjectNotFoundError:
            continue  # runs without physics and failed ones lack some

    def sha256_of(path: str) -> str | None:
        if path in _WRITTEN_DOWN:
            return _sha256_of_left(folder / path)
        fetched = folder / "hashed"
        try:
            service.store.get_file(bucket, join_key(prefix, path), fetched)
            return _sha256_of_left(fetched)
        except ObjectNotFoundError:
            return None
        finally:
            fetched.unlink(missing_ok=True)

    return sha256_of


def _copy(outputs: Path, folder: Path) -> Sha256Of:
    for name in _WRITTEN_DOWN:
        _copy_left(outputs / name, folder / name)
    return lambda path: _sha256_of_left(outputs / path)


def _sha256_of_left(file: Path) -> str | None:
    """Computes the SHA-256 of a file without reading it into memory; `None` if there is no such regular file.

    Raises StorageError if the file cannot be read.
    """
    try:
        with open_left(file) as content:
            return hashlib.file_digest(content, "sha256").hexdigest()
    except OSError as error:
        if isinstance(error, FileNotFoundError | NotADirectoryError) or error.errno in _NO_FILE:
            return None
        raise StorageError(f"its outputs cannot be read: {file} {error.strerror}") from error


def _copy_left(file: Path, copy: Path) -> None:
    """Copies a regular file that untrusted code may have made; does nothing if the file is missing.

    Raises StorageError if it is a link or a FIFO, or cannot be read.
    """
    try:
        with open_left(file) as left, copy.open("xb") as right:
            shutil.copyfileobj(left, right)
    except FileNotFoundError:
        return  # runs without physics and failed ones lack some
    except OSError as error:
        why = "is a link or something else that no run writes" if error.errno in _NO_FILE else error.strerror
        raise StorageError(f"its outputs cannot be read: {file} {why}") from error


def _read(folder: Path, reference: str) -> RunOutputs:
    try:
        return read_outputs(folder)
    except FileNotFoundError as error:
        raise ConfigurationError(
            f"{reference}: there is no {PROVENANCE_FILE} in its outputs; {_below(reference)}it ended before it ran, or "
            "was run by an earlier version"
        ) from error
    except ValidationError as error:
        raise StorageError(f"{reference}: its outputs cannot be read: {error.errors()[0]['msg']}") from error
    except ValueError as error:
        raise StorageError(f"{reference}: its outputs cannot be read: {error}") from error


def _below(reference: str) -> str:
    """Returns a hint for an error message if the user gave the folder of a job instead of that of its run."""
    runs = sorted(str(path.parent) for path in Path(reference).glob(f"*/{PROVENANCE_FILE}"))
    return f"did you mean {runs[0]}? Otherwise " if runs else ""


@contextmanager
def scratch_folder(service: Service) -> Iterator[Path]:
    """Creates a temporary folder that exists inside the `with` block."""
    with tempfile.TemporaryDirectory(prefix="replay-", dir=service.folder("scratch")) as folder:
        yield Path(folder)


def found_trial(run: FoundRun, number: int | None) -> FoundRun:
    """Finds one trial of a simulation run; returns the run itself if it has no trials.

    Of a trial whose application crashed, so that the job failed, only that is known.

    Args:
        run: Run that has the trial; records of the trial are written to a folder in the run's folder.
        number: Number of the trial; None: the first one that did not pass, else the first one.

    Raises:
        ConfigurationError: The run has no trials, or this one has not finished.
        StorageError: The table of trials cannot be read.
    """
    provenance = run.outputs.provenance
    plan = provenance.plan
    if plan.trials is None:
        if number is not None:
            raise ConfigurationError(f"{plan.job_arn} has no trials; leave --trial out")
        return run
    if number is None:
        number = _first_not_passed(run)
    try:
        trial = plan.trials.trial(number, plan.seed)
    except IndexError as error:
        raise ConfigurationError(f"--trial {number}: {error}") from None
    row = _row_of(run, number)
    failure_code = _failure_code(run, number, row)
    provenance = provenance.model_copy(
        update={
            "plan": plan_of_trial(plan, _as_run(trial, row)),
            "model_sha256": row.model_sha256 if row else None,
            "digest": row.digest if row else None,
            "ended_by": row.ended_by if row else None,
        }
    )
    folder = run.folder / f"trial-{number}"
    folder.mkdir()
    (folder / PROVENANCE_FILE).write_text(provenance.model_dump_json(indent=1) + "\n")
    if row is not None and row.ended_by is not None:
        (folder / RESULT_FILE).write_text(row.result().model_dump_json(indent=2) + "\n")
    return FoundRun(read_outputs(folder), folder, run.job, run.sha256_of, failure_code)


def _first_not_passed(run: FoundRun) -> int:
    """Returns the number of the trial that a user would look at first."""
    summary = TrialsSummary.of(run.outputs.result)
    if summary is None:
        return 0
    if summary.failing:
        return summary.failing[0].trial
    # A job that was only stopped has no failure, and the trial that it was stopped in no end to repeat.
    return summary.stopped_in or 0 if run.failure_code is not None else 0


def plan_of_found_trial(plan: RunPlan, found: RunPlan) -> RunPlan:
    """Returns the plan of a job, or of one of its trials, depending on which one a found run was.

    Args:
        plan: Plan of the job.
        found: Plan of the found run.
    """
    if found.trial is None or plan.trials is None:
        return plan
    of_trial = plan_of_trial(plan, plan.trials.trial(found.trial, plan.seed))
    return of_trial.model_copy(update={"axes": found.axes})


def _as_run(trial: Trial, row: TrialRow | None) -> Trial:
    """Returns a trial with the axis values of its actual run, as another scipy release may draw others."""
    if row is None:
        return trial
    numbers = {name: value for name, value in row.axes.items() if not isinstance(value, str)}
    return replace(trial, axes={**trial.variables, **numbers})


def _row_of(run: FoundRun, number: int) -> TrialRow | None:
    table = run.folder / TRIALS_FILE
    try:
        return read_row(table, number) if table.exists() else None
    except (ValueError, OSError) as error:
        raise StorageError(f"its outputs cannot be read: {error}") from error


def _failure_code(run: FoundRun, number: int, row: TrialRow | None) -> str | None:
    """Returns the failure code with which a trial of a run crashed; `None` if it did not crash.

    Raises ConfigurationError if the trial has not finished.
    """
    if row is not None:
        return row.failure_code
    document = SimulationJobDocument.of(run.job) if run.job is not None else None
    has_begun = number == 0 or _row_of(run, number - 1) is not None
    if document is None or document.failure_code is None or not has_begun:
        raise ConfigurationError(f"trial {number} of {run.outputs.provenance.plan.job_arn} has not finished")
    return document.failure_code
