"""Packing worlds into the archive of an export job."""

import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from prefect import task
from prefect.cache_policies import NO_CACHE

from ...schemas.wire.errors import TransferStoppedError
from ..catalog import Resource
from ..service.service import Service
from ..simulations.inputs.bundles import world_bundle
from ..simulations.outputs.locations import prepare_bucket
from ..worldforge.exports.export import write_export_zip
from .jobs import archive_place


@task(name="export-worlds", cache_policy=NO_CACHE)
def export_worlds(job: Resource, stopped: Callable[[], bool]) -> str | None:
    """Stores one archive with all worlds of an export job.

    Args:
      job: the export job.
      stopped: whether the archive is not wanted any more; asked all the time.

    Returns:
      Where the archive is; `None`: it was stopped, and there is none.

    Raises:
      ResourceNotFoundException: a world was deleted meanwhile.
      StorageError: a bundle cannot be read or the archive cannot be stored.
    """
    service = Service.current()
    bucket, key = archive_place(job)
    prepare_bucket(service, bucket)
    worlds = [service.catalog.get(arn, kind="world") for arn in job.document["request"]["worlds"]]
    try:
        with tempfile.TemporaryDirectory(dir=service.folder("scratch")) as scratch:
            archive = Path(scratch, "export.zip")
            write_export_zip(_Bundles(worlds, service, stopped), archive)
            service.store.put_file(bucket, key, archive, stopped=stopped)
    except TransferStoppedError:
        return None
    return service.store.uri(bucket, key)


class _Bundles(Mapping[str, Path]):
    """The folders of worlds' bundles by the worlds' names, each fetched when it is asked for.

    Args:
      worlds: the worlds.
      service: where their bundles are stored.
      stopped: whether no more are wanted.
    """

    def __init__(self, worlds: list[Resource], service: Service, stopped: Callable[[], bool]) -> None:
        self._worlds = {archive_name(world): world for world in worlds}
        self._service = service
        self._stopped = stopped

    def __getitem__(self, name: str) -> Path:
        world = self._worlds[name]
        if self._stopped():
            raise TransferStoppedError(f"{world.arn} is not wanted any more")
        return world_bundle(world, self._service)

    def __iter__(self) -> Iterator[str]:
        return iter(self._worlds)

    def __len__(self) -> int:
        return len(self._worlds)


def archive_name(world: Resource) -> str:
    """The world's name in archives: its id with underscores, `generation_82856b0yq33y_world_3`."""
    return world.id.replace("-", "_").replace("/", "_")
