"""Packs worlds into the archive of an export job."""

import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from ...schemas.documents.worlds import WorldExportJobDocument
from ...schemas.wire.errors import TransferStoppedError
from ..catalog import Resource
from ..execution.task_pool import RunStep
from ..service.service import Service
from ..simulations.inputs.bundles import world_bundle
from ..simulations.outputs.output_places import prepare_bucket
from ..worldforge.exports.export import archive_name, write_export_zip
from .archive_places import archive_place


def export_worlds(
    job: Resource, service: Service, acting: Service, stopped: Callable[[], bool], run_step: RunStep
) -> str | None:
    """Packs all worlds of an export job into one archive, and uploads it.

    Args:
        job: The export job.
        service: The service, with its catalog and object store.
        acting: The same service with the access of the job's role, which stores the archive.
        stopped: Returns whether the archive is no longer wanted; called often.
        run_step: Runs the steps `export` and `upload`, directly or as Prefect tasks.

    Returns:
        URI of the archive; `None`: it was stopped, and there is none.

    Raises:
        ResourceNotFoundException: A world was deleted meanwhile.
        StorageError: A bundle cannot be read or the archive cannot be stored.
    """
    bucket, key = archive_place(job)
    prepare_bucket(acting, bucket)
    worlds = [service.catalog.get(arn, kind="world") for arn in WorldExportJobDocument.of(job).request.worlds]
    try:
        with tempfile.TemporaryDirectory(dir=service.folder("scratch")) as scratch:
            archive = Path(scratch, "export.zip")
            run_step("export", lambda: write_export_zip(_Bundles(worlds, service, stopped), archive))
            run_step("upload", lambda: acting.store.put_file(bucket, key, archive, stopped=stopped))
    except TransferStoppedError:
        return None
    return service.store.uri(bucket, key)


class _Bundles(Mapping[str, Path]):
    """Folders of the worlds' bundles by world name, each downloaded when it is accessed.

    Args:
        worlds: The worlds.
        service: The service, with its catalog and object store.
        stopped: Returns whether no more are wanted.
    """

    def __init__(self, worlds: list[Resource], service: Service, stopped: Callable[[], bool]) -> None:
        self._worlds = {archive_name(world.id): world for world in worlds}
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
