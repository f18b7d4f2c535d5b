"""Where outputs go."""

from .catalog import Resource
from .service import Service


def output_place(job: Resource, run_id: str, service: Service) -> tuple[str, str]:
    """Bucket and prefix of one run's outputs: `<prefix>/<job id>/<run id>`.

    A job whose request names no output location puts its outputs below `simulation-jobs` in the
    configured bucket.
    """
    location = job.document["request"].get("outputLocation") or {}
    bucket = location.get("s3Bucket")
    prefix = location.get("s3Prefix", "").strip("/") if bucket else "simulation-jobs"
    return bucket or service.settings.bucket, "/".join(part for part in (prefix, job.id, run_id) if part)


def prepare_bucket(service: Service, bucket: str) -> None:
    """Creates the bucket where that is ours to do: any folder on this machine, else only the configured one.

    A bucket of somebody's S3 is never created by a misspelt name; writing to it fails instead.
    """
    if bucket == service.settings.bucket or service.store.local_path(bucket, "any") is not None:
        service.store.ensure_bucket(bucket)
