"""Packing worlds into the archive of an export job."""

import tempfile
from pathlib import Path

from prefect import task
from prefect.cache_policies import NO_CACHE

from .bundles import world_bundle
from .catalog import Resource
from .service import Service
from .uploads import prepare_bucket
from .worldforge.export import export_key, write_export_zip


@task(name="export-worlds", cache_policy=NO_CACHE)
def export_worlds(job: Resource) -> str:
    """Stores one archive with all worlds of an export job.

    Returns:
      Where the archive is.

    Raises:
      ResourceNotFoundException: a world was deleted meanwhile.
      StorageError: a bundle cannot be read or the archive cannot be stored.
    """
    service = Service.current()
    location = job.document["request"]["outputLocation"]
    prepare_bucket(service, location["s3Bucket"])
    worlds = [service.catalog.get(arn, kind="world") for arn in job.document["request"]["worlds"]]
    bundles = {archive_name(world): world_bundle(world, service) for world in worlds}
    key = export_key(location.get("s3Prefix") or "", job.id)
    with tempfile.TemporaryDirectory(dir=service.folder("scratch")) as scratch:
        archive = Path(scratch, "export.zip")
        write_export_zip(bundles, archive)
        service.store.put_file(location["s3Bucket"], key, archive)
    return service.store.uri(location["s3Bucket"], key)


def archive_name(world: Resource) -> str:
    """The world's name in archives: its id with underscores, `generation_82856b0yq33y_world_3`."""
    return world.id.replace("-", "_").replace("/", "_")
