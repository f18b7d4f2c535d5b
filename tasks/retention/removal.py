"""Deletes a run, its jobs and their outputs, in an order in which nothing partly deleted looks complete."""

import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping, Set
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ...schemas.documents.simulation_jobs import SimulationJobDocument
from ...schemas.documents.worlds import StoredPlace, WorldDocument
from ...schemas.wire.errors import (
    BucketNotFoundError,
    ObjectNotFoundError,
    ResourceNotFoundException,
    RobomakerError,
    ServiceUnavailableException,
    StorageError,
)
from ..catalog import Resource
from ..inspection.reports import rebuild_report
from ..runtime.agents.action_log import ACTIONS_FILE
from ..runtime.episode.run_results import RESULT_FILE
from ..runtime.episode.run_timeline import TIMELINE_FILE
from ..runtime.states.digest import DIGEST_FILE
from ..runtime.states.provenance import PROVENANCE_FILE
from ..runtime.video.video_settings import POSTER_FILE
from ..service.service import Service
from ..simulations.containers.cleanup import remove_containers_of_job, remove_run
from ..simulations.environment.folders import remove
from ..simulations.outputs.output_places import output_place
from ..storage import thin, unpublish
from ..storage.object_store import ObjectInfo, join_key
from ..worlds.archive_places import archive_place
from ..worlds.stored_bundles import BUNDLE_LABEL, bundle_label, delete_world
from .inventory import BATCH, EXPORT, JOB, RECORD, REMOVING, Unit

KEPT_RESULTS = frozenset((RESULT_FILE, PROVENANCE_FILE, TIMELINE_FILE, DIGEST_FILE, ACTIONS_FILE, POSTER_FILE))
"""Files of a run that are kept when it is thinned: reports, time lines, `verify` and `repro` need them."""

_LEASE_S = 120.0


class StillInUse(RobomakerError):
    """Raised when a run or job that is to be deleted has come into use since it was chosen."""


@dataclass(frozen=True)
class Amount:
    """Number and bytes of files that are or would be deleted; amounts can be added."""

    objects: int = 0
    size_bytes: int = 0

    def __add__(self, other: "Amount") -> "Amount":
        return Amount(self.objects + other.objects, self.size_bytes + other.size_bytes)


def measure(unit: Unit, spared: Set[str], service: Service, *, results_stay: bool) -> Amount:
    """Returns the number of files and bytes that deleting a unit would free; deletes nothing.

    Args:
        unit: The unit.
        spared: ARNs of the jobs that stay.
        service: The service, with its catalog and object store.
        results_stay: Whether it would only be thinned.

    Raises:
        StorageError: The store does not answer.
    """
    total = Amount()
    for job in unit.jobs.values():
        if job.arn not in spared:
            total += _measured(job, service, results_stay=results_stay)
    return total if results_stay or unit.folder is None else total + on_disk(unit.folder)


def remove_unit(unit: Unit, spared: Set[str], service: Service) -> None:
    """Deletes a unit (a run or an order with its jobs). An interrupted deletion is resumed by the next one.

    Args:
        unit: The unit.
        spared: ARNs of the jobs that stay, as something that is kept names them.
        service: The service, with its catalog and object store.

    Raises:
        StillInUse: A job is used by somebody.
        StorageError: An object or file cannot be deleted.
        OSError: A local file cannot be deleted.
    """
    if unit.folder is not None and (unit.folder / RECORD).exists():
        (unit.folder / RECORD).replace(unit.folder / REMOVING)
    for job in unit.jobs.values():
        if job.arn not in spared and not (job.kind == BATCH and spared & unit.jobs.keys()):
            _remove_job(job, service)
    if unit.folder is not None:
        for path in unit.folder.iterdir():
            if path.name != REMOVING:
                remove(path)
        (unit.folder / REMOVING).unlink(missing_ok=True)
        unit.folder.rmdir()


def thin_unit(unit: Unit, spared: Set[str], service: Service) -> None:
    """Deletes recordings, videos, logs and uploads of a run, and rewrites its report accordingly.

    Raises:
        StillInUse: A job is used by somebody.
        StorageError: An object or file cannot be deleted.
        OSError: The report cannot be written.
    """
    for job in unit.jobs.values():
        if job.kind == JOB and job.arn not in spared:
            with _held(job, service):
                for place in job_places(job, service):
                    _thin(place, service)
    if unit.record is not None:
        rebuild_report(unit.record, service)


def remove_world(world: Resource, service: Service) -> None:
    """Deletes a world, with its local copy if no other world shares it.

    Raises:
        StorageError: The world's bundle cannot be deleted.
    """
    with suppress(ResourceNotFoundException):
        delete_world(world, service)
    if (bundle := WorldDocument.of(world).bundle) is not None:
        sharing = service.catalog.list("world", filters={BUNDLE_LABEL: [bundle_label(bundle)]}, limit=1).resources
        if not sharing:
            remove(_copy(bundle, service))


def measure_world(world: Resource, service: Service) -> Amount:
    """Returns the number and bytes of a world's stored files, local and in the object store.

    Worlds of equal content share them.
    """
    bundle = WorldDocument.of(world).bundle
    return Amount() if bundle is None else _stored(bundle, service) + on_disk(_copy(bundle, service))


def _remove_job(job: Resource, service: Service) -> None:
    with _held(job, service):
        for place in job_places(job, service):
            with suppress(BucketNotFoundError):
                unpublish(service.store, place.bucket, place.prefix)
        if job.kind == EXPORT:
            with suppress(BucketNotFoundError):
                service.store.delete(*archive_place(job))
        if job.kind == JOB:
            _remove_folder(service.settings.home / "jobs" / job.id)
        with suppress(ResourceNotFoundException):
            service.catalog.delete(job.arn)


def _remove_folder(folder: Path) -> None:
    """Deletes the folder of a job with its containers; does nothing if there is none.

    Raises `StorageError` if a container cannot be removed, since the folder records that container.
    """
    if not folder.is_dir():
        return
    remove_containers_of_job(folder)
    left = [run for run in folder.iterdir() if not remove_run(run)]
    if left:
        raise StorageError(f"{left[0]} has containers that cannot be removed; the engine has to answer")
    folder.rmdir()


def _thin(place: StoredPlace, service: Service) -> None:
    try:
        thin(service.store, place.bucket, place.prefix, KEPT_RESULTS.__contains__)
    except BucketNotFoundError:
        return
    except ObjectNotFoundError:  # of a crashed run, which nothing takes for whole
        for info in list(service.store.list(place.bucket, join_key(place.prefix, ""))):
            if _name(info.key, place) not in KEPT_RESULTS:
                service.store.delete(place.bucket, info.key)


@contextmanager
def _held(job: Resource, service: Service) -> Iterator[None]:
    """Holds a job's lease inside the `with` block, so that no other process changes the job meanwhile.

    Raises `StillInUse` if another process holds the lease. A job that no longer exists counts as held.
    """
    owner = f"gc:{uuid.uuid4().hex}"
    try:
        claimed = service.catalog.claim(job.arn, owner, _LEASE_S)
    except ResourceNotFoundException:
        claimed = True  # it is gone, and its outputs go too
    if not claimed:
        raise StillInUse(f"{job.kind} {job.id} is in use")
    try:
        yield
    finally:
        with suppress(ResourceNotFoundException):
            service.catalog.release(job.arn, owner)


def job_places(job: Resource, service: Service) -> list[StoredPlace]:
    """Lists the folders in the object store that the runs of a simulation job have written, including earlier runs.

    Folders that belong to another job, whose results were reused, are left out; other kinds of job have none.
    """
    if job.kind != JOB:
        return []
    document = SimulationJobDocument.of(job)
    places = [document.outputs, *(run.outputs for run in document.earlier_runs)]
    run_ids = [document.run_id, *(run.run_id for run in document.earlier_runs)]
    computed = [output_place(job, run_id, service) for run_id in run_ids if run_id]
    places += [StoredPlace(bucket=bucket, prefix=prefix) for bucket, prefix in computed]
    ours = {(place.bucket, place.prefix): place for place in places if place is not None}
    return [place for place in ours.values() if place.prefix.split("/")[-2:] == [job.id, place.last_part]]


def _measured(job: Resource, service: Service, *, results_stay: bool) -> Amount:
    total = Amount()
    for place in job_places(job, service):
        total += _stored(place, service, results_stay=results_stay)
    if job.kind == EXPORT and not results_stay:
        with suppress(ObjectNotFoundError, BucketNotFoundError):
            total += Amount(1, service.store.head(*archive_place(job)).size_bytes)
    folder = service.settings.home / "jobs" / job.id
    return total if results_stay or job.kind != JOB else total + on_disk(folder)


def _stored(place: StoredPlace, service: Service, *, results_stay: bool = False) -> Amount:
    kept = KEPT_RESULTS | {"manifest.json"} if results_stay else frozenset[str]()
    try:
        found = [
            info
            for info in service.store.list(place.bucket, join_key(place.prefix, ""))
            if _name(info.key, place) not in kept
        ]
    except BucketNotFoundError:
        return Amount()
    return Amount(len(found), sum(info.size_bytes for info in found))


def _name(key: str, place: StoredPlace) -> str:
    return key.removeprefix(join_key(place.prefix, ""))


def _copy(bundle: StoredPlace, service: Service) -> Path:
    return service.settings.home / "cache" / "worlds" / bundle.last_part


def problem_of_removal(objects: Iterable[ObjectInfo], service: Service) -> str | None:
    """Deletes stored objects, up to the first that cannot be deleted; see `problem_of`."""
    return problem_of(*(partial(service.store.delete, each.bucket, each.key) for each in objects))


def problem_of(*steps: Callable[[], None]) -> str | None:
    """Calls functions that measure or delete; returns the error as text if one fails, else `None`.

    The functions after that one are not called. Raises `ServiceUnavailableException` if the catalog does not answer.
    """
    try:
        for step in steps:
            step()
    except ServiceUnavailableException:
        raise  # without the catalog nothing goes on
    except (RobomakerError, OSError) as error:
        return str(error)
    return None


def on_disk(folder: Path) -> Amount:
    """Returns the number and bytes of the files below a folder; unreadable ones are left out."""
    total = Amount()
    for path in folder.rglob("*"):
        with suppress(OSError):
            about = path.lstat()
            if not path.is_dir() or path.is_symlink():
                total += Amount(1, about.st_size)
    return total


def spared_jobs(unit: Unit, holders: Mapping[str, str]) -> dict[str, str]:
    """Returns the jobs of a run to delete that must be kept, each with the kept item that refers to it."""
    return {arn: holders[arn] for arn in unit.jobs if arn in holders}
