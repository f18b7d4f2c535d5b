"""Compares a folder of objects with the manifest that it was published with."""

import hashlib
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ...schemas.documents.worlds import StoredPlace
from ...schemas.reports.consistency import Problem
from ...schemas.runs.manifest import ManifestFile
from ...schemas.wire.errors import ObjectNotFoundError
from ..storage import MANIFEST_NAME, NEXT_NAME, ObjectStore, read_manifest
from ..storage.naming import join_key


@dataclass(frozen=True)
class Flaw:
    """Flaw of one object or of the folder."""

    problem: Problem
    key: str
    detail: str


@dataclass(frozen=True)
class Compared:
    """Result of a comparison."""

    objects: int
    size_bytes: int
    flaws: list[Flaw]


def compare_folder(place: StoredPlace, store: ObjectStore, *, read_content: bool) -> Compared:
    """Compares what is there with what the manifest names; objects that it does not name do not count.

    Args:
        place: where the folder is.
        store: where it is stored.
        read_content: whether every object is read; else sizes are compared, by one list of the folder.

    Raises:
        StorageError: the store does not answer or refuses, or what should be a manifest is none.
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
    """The digest of an object's content; through a file, since one may be larger than memory."""
    with tempfile.TemporaryDirectory(prefix="robomaker-fsck-") as folder:
        path = Path(folder) / "content"
        try:
            store.get_file(bucket, key, path)
        except ObjectNotFoundError:
            return "none: it has just been removed"
        with path.open("rb") as content:
            return hashlib.file_digest(content, "sha256").hexdigest()
