"""Places of outputs in the object store, their buckets, and notes about outputs for the result."""

import logging
from collections.abc import Collection, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from ....schemas.documents.simulation_jobs import SimulationJobDocument
from ....schemas.runs.requirements import doubtful_variables
from ....schemas.wire.errors import (
    InvalidParameterException,
    ObjectNotFoundError,
    StorageAccessDeniedError,
    StorageError,
)
from ...catalog import Resource
from ...service.service import Service
from ...storage.object_store import check_bucket, check_key, join_key
from ..environment.run_environment import application_configs
from .upload_files import Upload

DEFAULT_PREFIX = "simulation-jobs"

_logger = logging.getLogger(__name__)


def check_output_location(location: Mapping[str, Any] | None) -> None:
    """Raises an error for an output location that no object store can have.

    Args:
        location: `s3Bucket` and `s3Prefix` of a request, either may be absent.

    Raises:
        InvalidParameterException: Names the member and what is wrong with it.
    """
    given = location or {}
    try:
        if (bucket := given.get("s3Bucket")) is not None:
            check_bucket(bucket)
    except StorageError as error:
        raise InvalidParameterException(f"outputLocation.s3Bucket: {error}") from error
    try:
        check_key(join_key(given.get("s3Prefix", ""), "outputs"))
    except StorageError as error:
        raise InvalidParameterException(f"outputLocation.s3Prefix: {error}") from error


def output_place(job: Resource, run_id: str, service: Service) -> tuple[str, str]:
    """Returns bucket and prefix of one run's outputs: `<prefix>/<job id>/<run id>`.

    Without a bucket in the request, the configured bucket is used; without bucket and prefix, the prefix is
    `simulation-jobs`.
    """
    location = SimulationJobDocument.of(job).request.get("outputLocation") or {}
    prefix = location.get("s3Prefix", "") if location else DEFAULT_PREFIX
    return location.get("s3Bucket") or service.settings.bucket, join_key(prefix, job.id, run_id)


def prepare_bucket(service: Service, bucket: str) -> None:
    """Creates the bucket for outputs if the service may do so: in folder stores, and the configured bucket.

    A misspelt name never creates a bucket on an S3 server, even if the server creates buckets on upload. If the
    credentials may write to a bucket, but not check its existence, the bucket is assumed to exist. For other buckets it
    is only checked that they exist.

    Raises:
        BucketNotFoundError: The bucket does not exist, and the service may not create it.
        StorageError: The bucket cannot be created.
    """
    ours = bucket == service.settings.bucket or service.store.local_path(bucket, "any") is not None
    try:
        if ours:
            service.store.ensure_bucket(bucket)
        else:
            service.store.head(bucket, "any")
    except ObjectNotFoundError:
        return  # there is the bucket, which is what was asked
    except StorageAccessDeniedError as error:
        _logger.debug("writing will show whether bucket %s can be used: %s", bucket, error)


_NEW_BUCKET = "new-bucket.txt"
_NEAR = 0.8
"""Similarity of two names from which one is probably a misspelling of the other."""


def keep_new_bucket(service: Service, bucket: str, folder: Path) -> None:
    """Stores a note if a job creates a local bucket whose name resembles that of an existing one.

    The bucket is created anyway, as programs rely on it.

    Args:
        service: The service, with its catalog and object store.
        bucket: Name of the bucket for the job's outputs.
        folder: Folder of the run.
    """
    place = service.store.local_path(bucket, "any")
    if place is None or place.parent.exists() or not place.parent.parent.is_dir():
        return
    others = [each.name for each in place.parent.parent.iterdir() if each.is_dir() and not each.name.startswith(".")]
    if near := get_close_matches(bucket, others, 1, _NEAR):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / _NEW_BUCKET).write_text(f"bucket {bucket} was new; did you mean {near[0]}?")


def notes_of(
    request: Mapping[str, Any], folder: Path, uploads: Sequence[Upload], matched: Collection[int]
) -> list[str]:
    """Returns the notes about a run's outputs for its result.

    Args:
        request: Request of the job.
        folder: Folder of the run.
        uploads: Upload configurations of the job.
        matched: Indices of the configurations that matched a file.
    """
    notes = [
        f"upload configuration {upload.name}: no file matched {upload.path}"
        for index, upload in enumerate(uploads)
        if upload.path and index not in matched
    ]
    notes += [
        f"the launch variable {name} means nothing here; did you mean {meant}?"
        for _, config in application_configs(request)
        for name, meant in doubtful_variables((config.get("launchConfig") or {}).get("environmentVariables") or {})
    ]
    kept = folder / _NEW_BUCKET
    return [*notes, kept.read_text()] if kept.is_file() else notes
