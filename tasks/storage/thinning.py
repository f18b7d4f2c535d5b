"""Removing some of the files that were published together, so that the rest counts as a whole again.

While files are removed there is no manifest, so that no reader takes the rest for the whole. What will be the new
manifest is stored first, under another name: an interrupted call is finished by the next.
"""

from collections.abc import Callable

from ...schemas.runs.manifest import Manifest
from ...schemas.wire.errors import ObjectNotFoundError, StorageError
from .base import ObjectStore
from .naming import join_key
from .parallel import run_all
from .publication import MANIFEST_NAME, read_manifest

NEXT_NAME = "manifest.next.json"
"""Name of the future manifest while files are removed."""


def thin(store: ObjectStore, bucket: str, prefix: str, keep: Callable[[str], bool]) -> None:
    """Removes files that are published under a prefix, and everything there that the manifest does not name.

    Args:
        store: where.
        bucket: where.
        prefix: the keys of the files start with it, then a slash; not empty.
        keep: says of a file's name whether it stays.

    Raises:
        ObjectNotFoundError: nothing is published there.
        StorageError: something cannot be removed; calling it again goes on.
    """
    if not prefix.strip("/"):
        raise StorageError(f"the prefix is empty; everything in {bucket} would be removed")
    after = _prepared(store, bucket, prefix)
    if after is None:
        before = read_manifest(store, bucket, prefix)
        after = thinned(before, keep)
        if after == before:
            return
        store.put_bytes(bucket, join_key(prefix, NEXT_NAME), _written(after))
    _remove_rest(store, bucket, prefix, after)


def finish_thinning(store: ObjectStore, bucket: str, prefix: str) -> None:
    """Finishes an interrupted call of `thin`; does nothing if there is none.

    Args:
        store: where.
        bucket: where.
        prefix: the prefix of that call.

    Raises:
        StorageError: something cannot be removed; calling it again goes on.
    """
    if (after := _prepared(store, bucket, prefix)) is not None:
        _remove_rest(store, bucket, prefix, after)


def _remove_rest(store: ObjectStore, bucket: str, prefix: str, after: Manifest) -> None:
    """Removes what a manifest does not name, and puts it in its place."""
    store.delete(bucket, join_key(prefix, MANIFEST_NAME))
    stay = {join_key(prefix, name) for name in (NEXT_NAME, *(file.path for file in after.files))}
    gone = [info.key for info in store.list(bucket, join_key(prefix, "")) if info.key not in stay]
    run_all(lambda key: store.delete(bucket, key), gone)
    store.put_bytes(bucket, join_key(prefix, MANIFEST_NAME), _written(after))
    store.delete(bucket, join_key(prefix, NEXT_NAME))


def thinned(manifest: Manifest, keep: Callable[[str], bool]) -> Manifest:
    """The manifest of what stays; its `about` counts what went, in all calls so far."""
    stay = [file for file in manifest.files if keep(file.path)]
    count, size = removed_before(manifest)
    gone = [file for file in manifest.files if not keep(file.path)]
    if not gone:
        return manifest
    removed = {"files": count + len(gone), "sizeBytes": size + sum(file.size_bytes for file in gone)}
    return manifest.model_copy(update={"files": stay, "about": {**manifest.about, "removed": removed}})


def removed_before(manifest: Manifest) -> tuple[int, int]:
    """How many files were removed of what was published, and their bytes."""
    removed = manifest.about.get("removed")
    if not isinstance(removed, dict):
        return 0, 0
    count, size = removed.get("files"), removed.get("sizeBytes")
    return (count, size) if isinstance(count, int) and isinstance(size, int) else (0, 0)


def _prepared(store: ObjectStore, bucket: str, prefix: str) -> Manifest | None:
    """Manifest that an interrupted call prepared; None: there is none."""
    try:
        return Manifest.model_validate_json(store.get_bytes(bucket, join_key(prefix, NEXT_NAME)))
    except ObjectNotFoundError:
        return None


def _written(manifest: Manifest) -> bytes:
    return f"{manifest.model_dump_json(indent=2)}\n".encode()
