"""Places of a job's outputs: bucket, prefix of its run, and whether that bucket can be used."""

import logging
from collections.abc import Mapping
from typing import Any

from ....schemas.documents.simulation_jobs import SimulationJobDocument
from ....schemas.wire.errors import (
    InvalidParameterException,
    ObjectNotFoundError,
    StorageAccessDeniedError,
    StorageError,
)
from ...catalog import Resource
from ...service.service import Service
from ...storage.naming import check_bucket, check_key, join_key

DEFAULT_PREFIX = "simulation-jobs"

_logger = logging.getLogger(__name__)


def check_output_location(location: Mapping[str, Any] | None) -> None:
    """Refuses an output location that no object store can hold, before anything runs.

    Args:
        location: `s3Bucket` and `s3Prefix` of a request, either may be absent.

    Raises:
        InvalidParameterException: names the member and what is wrong with it.
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
    """Bucket and prefix of one run's outputs: `<prefix>/<job id>/<run id>`.

    A request that names no bucket means the configured one; outputs of a request that names neither
    bucket nor prefix are put below `simulation-jobs`.
    """
    location = SimulationJobDocument.of(job).request.get("outputLocation") or {}
    prefix = location.get("s3Prefix", "") if location else DEFAULT_PREFIX
    return location.get("s3Bucket") or service.settings.bucket, join_key(prefix, job.id, run_id)


def prepare_bucket(service: Service, bucket: str) -> None:
    """Creates the bucket where that is ours to do: any folder on this machine, else only the configured one.

    A bucket of somebody's S3 is never created by a misspelt name, also not by servers that create
    buckets when something is put into them. Who may write to a bucket, but not ask whether it exists,
    goes on to do so.

    Raises:
        BucketNotFoundError: it does not exist, and is not ours to create.
        StorageError: it cannot be created.
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
