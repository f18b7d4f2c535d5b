"""Finding a stored run by the ARN or id of its job, by a place in the store, or by a folder."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from ..schemas.arns import ResourceArn
from ..schemas.errors import ConfigurationError, ObjectNotFoundError, StorageError
from ..schemas.provenance import PROVENANCE_FILE
from .catalog import Resource
from .runtime.action_log import ACTIONS_FILE
from .runtime.digest import DIGEST_FILE
from .runtime.replay import RunOutputs, read_outputs
from .runtime.results import RESULT_FILE
from .service import Service
from .storage.naming import join_key

_KIND = "simulation-job"
_WRITTEN_DOWN = (PROVENANCE_FILE, DIGEST_FILE, ACTIONS_FILE, RESULT_FILE)


@dataclass(frozen=True)
class FoundRun:
    """A run, with what it wrote down on this machine."""

    outputs: RunOutputs
    folder: Path
    """What it wrote down; only that, not all of its outputs."""
    job: Resource | None
    """Its job, while the catalog has it."""


@contextmanager
def found_run(reference: str, service: Service) -> Iterator[FoundRun]:
    """Finds a run, and fetches what it wrote down into a folder that is there inside the block.

    Args:
      reference: ARN or id of a simulation job, `s3://bucket/prefix` or a folder of outputs.
      service: where it is stored.

    Raises:
      ConfigurationError: that names no run.
      ResourceNotFoundException: there is no such job.
      StorageError: its outputs cannot be read.
    """
    with scratch_folder(service) as scratch:
        job = _job_of(reference, service)
        if job is not None:
            _fetch_of_job(job, scratch, service)
        elif reference.startswith("s3://"):
            bucket, _, prefix = reference.removeprefix("s3://").partition("/")
            _fetch(bucket, prefix.rstrip("/"), scratch, service)
        else:
            _copy(Path(reference), scratch)
        outputs = _read(scratch, reference)
        if job is None:
            job = service.catalog.get_many([outputs.provenance.plan.job_arn]).get(outputs.provenance.plan.job_arn)
        yield FoundRun(outputs, scratch, job)


def _job_of(reference: str, service: Service) -> Resource | None:
    if reference.startswith("arn:"):
        return service.catalog.get(str(ResourceArn.parse(reference, _KIND)), kind=_KIND)
    if reference.startswith("sim-") and "/" not in reference and not Path(reference).exists():
        return service.catalog.get(service.arn(_KIND, reference), kind=_KIND)
    return None


def _fetch_of_job(job: Resource, folder: Path, service: Service) -> None:
    """Fetches what the last run of a job wrote down, from the store or from this machine."""
    document = job.document
    run_id = document.get("runId")
    kept = service.settings.home / "jobs" / job.id / str(run_id) / "output"
    if place := document.get("outputs"):
        _fetch(place["bucket"], place["prefix"], folder, service)
    elif kept.is_dir():
        _copy(kept, folder)
    else:
        raise ConfigurationError(f"{job.arn} has no outputs: it is {job.status}, and none are on this machine")


def _fetch(bucket: str, prefix: str, folder: Path, service: Service) -> None:
    for name in _WRITTEN_DOWN:
        try:
            service.store.get_file(bucket, join_key(prefix, name), folder / name)
        except ObjectNotFoundError:
            continue  # runs without physics and failed ones lack some


def _copy(outputs: Path, folder: Path) -> None:
    if not outputs.is_dir():
        raise ConfigurationError(
            f"{str(outputs)!r} is no run: name the ARN or the id of a simulation job, s3://BUCKET/PREFIX or a folder"
        )
    for name in _WRITTEN_DOWN:
        if (outputs / name).is_file():
            shutil.copyfile(outputs / name, folder / name)


def _read(folder: Path, reference: str) -> RunOutputs:
    try:
        return read_outputs(folder)
    except FileNotFoundError as error:
        raise ConfigurationError(
            f"{reference}: there is no {PROVENANCE_FILE} in its outputs; it ended before it ran, or was run by an "
            "earlier version"
        ) from error
    except ValidationError as error:
        raise StorageError(f"{reference}: its outputs cannot be read: {error.errors()[0]['msg']}") from error
    except ValueError as error:
        raise StorageError(f"{reference}: its outputs cannot be read: {error}") from error


@contextmanager
def scratch_folder(service: Service) -> Iterator[Path]:
    """Makes a folder that is there inside the block."""
    with tempfile.TemporaryDirectory(prefix="replay-", dir=service.folder("scratch")) as folder:
        yield Path(folder)
