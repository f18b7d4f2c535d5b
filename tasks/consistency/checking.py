"""Compares the outputs that the catalog lists with the object store, and repairs some defects."""

import hashlib
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import timedelta
from functools import partial
from pathlib import Path

from ...schemas.documents.simulation_jobs import SimulationJobDocument
from ...schemas.documents.worlds import StoredPlace, WorldDocument
from ...schemas.reports.retention import ConsistencyReport, Finding, Problem
from ...schemas.runs.provenance import ManifestFile
from ...schemas.wire.errors import ObjectNotFoundError, RobomakerError, StorageError, StorageUnavailableError
from ..catalog import Resource
from ..jobs.job_folders import find_kept, store_kept
from ..service.service import Service
from ..storage import MANIFEST_NAME, NEXT_NAME, ObjectStore, finish_thinning, read_manifest
from ..storage.object_store import join_key, run_all
from ..worlds.archive_places import archive_place

JOB, WORLD, EXPORT = "simulation-job", "world", "world-export-job"
KINDS = (JOB, WORLD, EXPORT)
"""Kinds of resources that have stored outputs. Archives of applications belong to users, and are not checked."""


@dataclass(frozen=True)
class Folder:
    """A folder of the object store that should have the files listed in its manifest."""

    place: StoredPlace


@dataclass(frozen=True)
class Single:
    """A single object that should be in the object store."""

    bucket: str
    key: str


def stored_of(resource: Resource) -> Iterator[Folder | Single]:
    """Yields the stored folders and objects that a resource should have; none for an unfinished run."""
    if resource.kind == JOB:
        document = SimulationJobDocument.of(resource)
        if document.outputs is not None and document.finished:
            yield Folder(document.outputs)
    elif resource.kind == WORLD:
        world = WorldDocument.of(resource)
        if world.bundle is not None:
            yield Folder(world.bundle)
    elif resource.kind == EXPORT and resource.status == "Completed":
        yield Single(*archive_place(resource))


@dataclass(frozen=True)
class Flaw:
    """A defect that a check of stored outputs found: an object, or a whole folder, is missing or damaged."""

    problem: Problem
    key: str
    detail: str


@dataclass(frozen=True)
class Compared:
    """Result of comparing a stored folder with its manifest: the defects, and the numbers of objects checked."""

    objects: int
    size_bytes: int
    flaws: list[Flaw]


def compare_folder(place: StoredPlace, store: ObjectStore, *, read_content: bool) -> Compared:
    """Compares a stored folder with its manifest; objects that the manifest does not name are ignored.

    Args:
        place: The stored folder.
        store: The object store.
        read_content: Whether every object is read; else sizes are compared, by one list of the folder.

    Raises:
        StorageError: The store does not answer or refuses, or what should be a manifest is none.
    """
    there = {info.key: info.size_bytes for info in store.list(place.bucket, join_key(place.prefix, ""))}
    manifest_key, next_key = (join_key(place.prefix, name) for name in (MANIFEST_NAME, NEXT_NAME))
    if next_key in there:
        why = "the removal of some of its files was interrupted"
        return Compared(len(there), sum(there.values()), [Flaw(Problem.HALF_REMOVED, next_key, why)])
    if manifest_key not in there:
        why = f"{len(there)} objects are there, and no manifest that makes them count" if there else "nothing is there"
        return Compared(0, 0, [Flaw(Problem.NOT_PUBLISHED, manifest_key, why)])
    files = read_manifest(store, place.bucket, place.prefix).files
    flaws = [flaw for file in files for flaw in _flaws(file, place, there, store, read_content=read_content)]
    return Compared(len(files), sum(file.size_bytes for file in files), flaws)


def _flaws(
    file: ManifestFile, place: StoredPlace, there: dict[str, int], store: ObjectStore, *, read_content: bool
) -> Iterator[Flaw]:
    key = join_key(place.prefix, file.path)
    if key not in there:
        yield Flaw(Problem.MISSING, key, f"{file.size_bytes} bytes were stored")
    elif there[key] != file.size_bytes:
        yield Flaw(Problem.WRONG_SIZE, key, f"it has {there[key]} bytes; {file.size_bytes} were stored")
    elif read_content and (digest := _sha256(store, place.bucket, key)) != file.sha256:
        yield Flaw(Problem.WRONG_CONTENT, key, f"its SHA-256 is {digest}; {file.sha256} was stored")


def _sha256(store: ObjectStore, bucket: str, key: str) -> str:
    """Returns the SHA-256 of an object's content as hexadecimal text, or a text that says that the object is gone.

    The content is downloaded to a temporary file, since an object may be larger than memory.
    """
    with tempfile.TemporaryDirectory(prefix="robomaker-fsck-") as folder:
        path = Path(folder) / "content"
        try:
            store.get_file(bucket, key, path)
        except ObjectNotFoundError:
            return "none: it has just been removed"
        with path.open("rb") as content:
            return hashlib.file_digest(content, "sha256").hexdigest()


UNFINISHED_AFTER = timedelta(days=1)
"""Age of an unfinished multipart upload from which it counts as abandoned: none takes that long."""

_PAGE = 200
_JOBS = "simulation-jobs/"
"""Key prefix of simulation outputs in the service's own bucket."""

_AGAIN = {
    "simulation-job": "restore the bucket from a backup, or run the job again",
    "world": "restore the bucket from a backup, or make the world again from its template and seed, or its drawing",
    "world-export-job": "restore the bucket from a backup, or export the worlds again",
}


def check_consistency(service: Service, *, read_content: bool = False, mend: bool = False) -> ConsistencyReport:
    """Compares the catalog with the object store, and repairs what it can (`robomaker fsck`).

    Jobs in progress are left out until they have ended.

    Args:
        service: The service, with the catalog and object store to check.
        read_content: Whether every object is read and its SHA-256 compared; else sizes are.
        mend: Whether to store what is on this machine only, finish removals, and remove parts of old uploads.

    Raises:
        StorageUnavailableError: The object store does not answer.
        ServiceUnavailableException: The catalog does not.
    """
    return _Check(service, read_content=read_content, mend=mend).run()


@dataclass
class _Check:
    service: Service
    read_content: bool
    mend: bool
    buckets: set[str] = field(default_factory=set[str])

    def run(self) -> ConsistencyReport:
        """Checks the whole catalog against the object store, mends findings if asked to, and returns the report."""
        self.buckets.add(self.service.settings.bucket)
        checked = [each for page in self._pages() for each in run_all(self._checked, page)]
        findings = [finding for _, _, found in checked for finding in found]
        return ConsistencyReport(
            read_content=self.read_content,
            resources=len(checked),
            objects=sum(objects for objects, _, _ in checked),
            size_bytes=sum(size_bytes for _, size_bytes, _ in checked),
            findings=[*findings, *self._only_here(), *self._half_uploaded(), *self._unknown()],
        )

    def _pages(self) -> Iterator[Sequence[Resource]]:
        after = None
        while True:
            page = self.service.catalog.list(KINDS, limit=_PAGE, after=after, scope="fsck")
            yield page.resources
            if (after := page.next_token) is None:
                return

    def _checked(self, resource: Resource) -> tuple[int, int, list[Finding]]:
        """Compares one resource's stored outputs with its record; returns numbers of objects and bytes, and findings.

        An unreadable or missing object becomes a finding. Raises `StorageUnavailableError` if the object store is away.
        """
        objects, size_bytes, findings = 0, 0, list[Finding]()
        for thing in stored_of(resource):
            bucket = thing.place.bucket if isinstance(thing, Folder) else thing.bucket
            self.buckets.add(bucket)
            try:
                if isinstance(thing, Folder):
                    compared = compare_folder(thing.place, self.service.store, read_content=self.read_content)
                    objects, size_bytes = objects + compared.objects, size_bytes + compared.size_bytes
                    findings += [
                        self._mended(self._finding(resource, each.problem, bucket, each.key, each.detail), thing)
                        for each in compared.flaws
                    ]
                else:
                    size_bytes += self.service.store.head(thing.bucket, thing.key).size_bytes
                    objects += 1
            except StorageUnavailableError:
                raise
            except ObjectNotFoundError as error:
                findings.append(self._finding(resource, Problem.MISSING, bucket, _key(thing), str(error)))
            except StorageError as error:
                findings.append(self._finding(resource, Problem.UNREADABLE, bucket, _key(thing), str(error)))
        return objects, size_bytes, findings

    def _finding(self, resource: Resource, problem: Problem, bucket: str, key: str, detail: str) -> Finding:
        remedy = _AGAIN[resource.kind]
        if problem is Problem.UNREADABLE:
            remedy = "let the credentials of this machine read the bucket, and check again"
        elif problem is Problem.HALF_REMOVED:
            remedy = "`robomaker fsck --mend` finishes it"
        where = self.service.store.uri(bucket, key)
        return Finding(problem=problem, resource=resource.arn, where=where, detail=detail, remedy=remedy)

    def _mended(self, finding: Finding, folder: Folder) -> Finding:
        """Finishes an interrupted deletion, if the finding is one and repairs are wanted; returns the finding."""
        if not self.mend or finding.problem is not Problem.HALF_REMOVED:
            return finding
        place = folder.place
        return _done(finding, partial(finish_thinning, self.service.store, place.bucket, place.prefix))

    def _only_here(self) -> Iterator[Finding]:
        """Yields a finding for each ended job whose outputs exist only here; uploads them if asked to mend."""
        for kept in find_kept(self.service):
            finding = Finding(
                problem=Problem.ONLY_HERE,
                resource=kept.job.arn,
                where=str(kept.output_dir),
                detail="they could not be stored when the run ended",
                remedy="`robomaker fsck --mend` or `robomaker upload --kept` stores them",
            )
            yield _done(finding, partial(store_kept, kept, self.service)) if self.mend else finding

    def _half_uploaded(self) -> Iterator[Finding]:
        """Yields a finding for each old unfinished multipart upload; deletes the uploaded parts if mending was asked.

        Buckets that cannot be listed are left out. Raises `StorageUnavailableError` if the object store is away.
        """
        before = self.service.clock() - UNFINISHED_AFTER
        for bucket in sorted(self.buckets):
            try:
                uploads = self.service.store.unfinished_uploads(bucket, before)
            except StorageUnavailableError:
                raise
            except StorageError:  # one that is missing was told with what should be in it
                continue
            for upload in uploads:
                finding = Finding(
                    problem=Problem.HALF_UPLOADED,
                    where=self.service.store.uri(bucket, upload.key),
                    detail=f"the upload began {upload.began_at:%Y-%m-%d %H:%M} UTC and never ended",
                    remedy="`robomaker fsck --mend` removes its parts",
                )
                yield _done(finding, partial(self.service.store.abort_upload, upload)) if self.mend else finding

    def _unknown(self) -> Iterator[Finding]:
        """Yields a finding for each job folder in the service's own bucket that belongs to no job in the catalog.

        Yields none if the bucket cannot be listed. Raises `StorageUnavailableError` if the object store is away.
        """
        bucket = self.service.settings.bucket
        try:
            keys = [info.key for info in self.service.store.list(bucket, _JOBS)]
        except StorageUnavailableError:
            raise
        except StorageError:
            return
        ids = sorted({parts[1] for key in keys if len(parts := key.split("/")) > 2})
        known = self.service.catalog.get_many([self.service.arn(JOB, each) for each in ids])
        for each in ids:
            if self.service.arn(JOB, each) not in known:
                yield Finding(
                    problem=Problem.UNKNOWN,
                    where=self.service.store.uri(bucket, f"{_JOBS}{each}"),
                    detail="no job of this catalog has this id; another catalog may share the bucket",
                )


def _key(thing: Folder | Single) -> str:
    return thing.key if isinstance(thing, Single) else thing.place.prefix


def _done(finding: Finding, mend: partial[object]) -> Finding:
    """Repairs a finding by calling `mend`, and returns it marked as mended, or with the failure in its detail.

    Raises `StorageUnavailableError` if the object store is away; other failures do not end the check.
    """
    try:
        mend()
    except StorageUnavailableError:
        raise
    except (RobomakerError, OSError) as error:
        return finding.model_copy(update={"detail": f"{finding.detail}; it could not be mended: {error}"})
    return finding.model_copy(update={"mended": True})
