"""Publishes a set of files with a manifest, which is written last.

It can also delete part of a set so that the rest stays valid.
"""

import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from pathlib import Path

from pydantic import JsonValue, ValidationError

from ...schemas.runs.provenance import Manifest, ManifestFile
from ...schemas.wire.errors import (
    ChecksumMismatchError,
    ObjectExistsError,
    ObjectNotFoundError,
    StorageAccessDeniedError,
    StorageError,
    TransferStoppedError,
)
from ..files.untrusted_folders import FolderFile, open_regular, os_failures, version_of
from .checksums import digest_of
from .object_store import ObjectInfo, ObjectStore, Stopped, Tell, check_key, join_key, never, run_all, tell_none

MANIFEST_NAME = "manifest.json"


def publish(
    store: ObjectStore,
    bucket: str,
    prefix: str,
    files: Sequence[FolderFile],
    *,
    about: Mapping[str, JsonValue],
    created_at: datetime,
    stored: Sequence[ManifestFile] = (),
    resumes: bool = False,
    stopped: Stopped = never,
    ended: Stopped = never,
    tell: Callable[[ManifestFile], None] | None = None,
) -> Manifest:
    """Uploads files and then their manifest, which makes them visible as a complete set.

    Publishing the same content with the same `about` again succeeds and returns the existing manifest, so an
    interrupted or repeated step can simply be run again.

    Args:
        store: The object store.
        bucket: Name of the bucket, which must exist.
        prefix: Beginning of the files' keys, before a slash; may be empty.
        files: Files to publish, by unique names; no process may write to them any more.
        about: Description of the run or job that the files belong to, for the manifest.
        created_at: The time of publication, with its time zone, for the manifest.
        stored: Objects that are under the prefix already, and belong to the set.
        resumes: Whether an earlier attempt may have stored a part; objects with the same content are not stored again.
        stopped: Called before the manifest is written; true if the files should not count after all.
        ended: Called often while files are read and stored; true stops that at once; must be quick.
        tell: Called with the key of each stored file, from any thread.

    Raises:
        TransferStoppedError: `stopped` or `ended` said so.
        ObjectExistsError: Other files are published under this prefix.
        ChecksumMismatchError: A file changed meanwhile.
        StorageError: A file cannot be read or stored.
    """
    keys = {file.name: join_key(prefix, file.name) for file in files}
    for key in keys.values():
        check_key(key)
    if MANIFEST_NAME in keys:
        raise StorageError(f"{keys[MANIFEST_NAME]} is in the way: the manifest gets this name")
    versions = [version_of(file.path) for file in files]
    own = run_all(lambda file: _described(file, ended), files)
    described = sorted([*own, *stored], key=lambda file: os.fsencode(file.path))
    manifest = Manifest(created_at=created_at, about=dict(about), files=described)
    if (there := _published(store, bucket, prefix)) is not None:
        return _same(there, manifest, bucket, prefix)
    wanted = {keys[file.name]: file.path for file in files}
    by_key = dict(zip(keys.values(), own, strict=True))
    _put(store, bucket, wanted, ended, lambda key: tell(by_key[key]) if tell else None, resumes=resumes)
    for file, version in zip(files, versions, strict=True):
        if version_of(file.path) != version:
            raise ChecksumMismatchError(f"{file.path} changed while it was being published")
    if stopped():
        raise TransferStoppedError(f"{bucket}/{prefix} is not wanted any more")
    return _conclude(store, bucket, prefix, manifest)


def store_unfinished(
    store: ObjectStore,
    bucket: str,
    prefix: str,
    files: Sequence[FolderFile],
    *,
    resumes: bool = False,
    ended: Stopped = never,
    tell: Callable[[str], None] = tell_none,
) -> None:
    """Uploads incomplete outputs for inspection, without a manifest.

    Args:
        store: The object store.
        bucket: Name of the bucket, which must exist.
        prefix: Beginning of the files' keys, before a slash; may be empty.
        files: Files to upload.
        resumes: Whether an earlier attempt may have stored a part.
        ended: Called often while files are read and stored; true stops that at once.
        tell: Called with the key of each stored file, from any thread.

    Raises:
        TransferStoppedError: `ended` said so.
        StorageError: A file cannot be read or stored.
    """
    keys = {join_key(prefix, file.name): file.path for file in files}
    keys.pop(join_key(prefix, MANIFEST_NAME), None)
    _put(store, bucket, keys, ended, tell, resumes=resumes)


def _put(store: ObjectStore, bucket: str, files: dict[str, Path], ended: Stopped, tell: Tell, *, resumes: bool) -> None:
    """Uploads files; if this continues an earlier attempt, files that are stored already are skipped."""
    if resumes:
        there, files = split_stored(store, bucket, files, ended)
        for key in there:
            tell(key)
    store.put_files(bucket, files, stopped=ended, tell=tell)


def split_stored(
    store: ObjectStore, bucket: str, files: Mapping[str, Path], stopped: Stopped = never
) -> tuple[dict[str, ObjectInfo], dict[str, Path]]:
    """Returns which of some files are stored already with the same content, and which are still to upload.

    Args:
        store: The object store.
        bucket: Name of the bucket.
        files: Files by their keys.
        stopped: Function that returns whether to stop; it is called while files are compared.

    Raises:
        StorageError: The stored objects cannot be compared.
    """
    found = run_all(lambda item: store.find_same(bucket, *item, stopped=stopped), files.items())
    there = {key: info for key, info in zip(files, found, strict=True) if info is not None}
    return there, {key: path for key, path in files.items() if key not in there}


def unpublish(store: ObjectStore, bucket: str, prefix: str) -> None:
    """Deletes everything under a prefix; the manifest goes first, so that an interruption leaves no valid set.

    Args:
        store: The object store.
        bucket: Name of the bucket.
        prefix: Beginning of the deleted keys, before a slash; not empty.

    Raises:
        BucketNotFoundError: The bucket does not exist.
        StorageError: An object cannot be deleted.
    """
    if not prefix.strip("/"):
        raise StorageError(f"the prefix is empty; everything in {bucket} would be removed")
    store.delete(bucket, join_key(prefix, MANIFEST_NAME))
    for info in list(store.list(bucket, join_key(prefix, ""))):
        store.delete(bucket, info.key)


def read_manifest(store: ObjectStore, bucket: str, prefix: str) -> Manifest:
    """Reads and returns the manifest of the files published under a prefix.

    Raises:
        ObjectNotFoundError: No files are published under this prefix.
        StorageError: The manifest cannot be read, or is invalid.
    """
    key = join_key(prefix, MANIFEST_NAME)
    try:
        return Manifest.model_validate_json(store.get_bytes(bucket, key))
    except ValidationError as error:
        raise StorageError(f"{store.uri(bucket, key)} is no manifest: {error}") from error


def fetch(store: ObjectStore, bucket: str, prefix: str, folder: Path) -> Manifest:
    """Downloads the files in a manifest to a folder, and returns the manifest.

    Args:
        store: The object store.
        bucket: Name of the bucket.
        prefix: Beginning of the files' keys, before a slash.
        folder: Target folder, which must be absent or empty, and appears only when all files are there.

    Raises:
        ChecksumMismatchError: A file is not what was published.
        StorageError: The folder is not empty, or something cannot be fetched.
    """
    manifest = read_manifest(store, bucket, prefix)
    with os_failures(f"fetch into {folder}"):
        folder.parent.mkdir(parents=True, exist_ok=True)
        arriving = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
        try:
            arriving.chmod(0o755)
            for file in manifest.files:
                (arriving / file.path).parent.mkdir(parents=True, exist_ok=True)

            def arrive(file: ManifestFile) -> None:
                path = arriving / file.path
                store.get_file(bucket, join_key(prefix, file.path), path)
                _verify(path, file, store.uri(bucket, join_key(prefix, file.path)))

            run_all(arrive, manifest.files)
            arriving.rename(folder)
        finally:
            shutil.rmtree(arriving, ignore_errors=True)
    return manifest


def _described(file: FolderFile, ended: Stopped) -> ManifestFile:
    with os_failures(f"read {file.path}"), open_regular(file.path) as content:
        digest, size = digest_of(content.fileno(), "sha256", ended)
        return ManifestFile(path=file.name, size_bytes=size, sha256=digest)


def _published(store: ObjectStore, bucket: str, prefix: str) -> Manifest | None:
    try:
        return read_manifest(store, bucket, prefix)
    except (ObjectNotFoundError, StorageAccessDeniedError):
        # AWS does not tell clients without the right to list a bucket that an object does not exist.
        return None


def _same(there: Manifest, ours: Manifest, bucket: str, prefix: str) -> Manifest:
    """Returns the stored manifest after checking that it equals the new one; only the times may differ.

    Raises `ObjectExistsError` if something else is published there.
    """
    if (there.files, there.about) != (ours.files, ours.about):
        raise ObjectExistsError(f"something else is already published under {bucket}/{prefix}")
    return there


def _conclude(store: ObjectStore, bucket: str, prefix: str, manifest: Manifest) -> Manifest:
    data = f"{manifest.model_dump_json(indent=2)}\n".encode()
    try:
        store.put_bytes(bucket, join_key(prefix, MANIFEST_NAME), data, create_only=True)
    except ObjectExistsError:
        # Another writer was quicker, or this write succeeded and its answer was lost.
        return _same(read_manifest(store, bucket, prefix), manifest, bucket, prefix)
    return manifest


def _verify(path: Path, file: ManifestFile, uri: str) -> None:
    with open_regular(path) as content:
        size = path.stat().st_size
        if size != file.size_bytes:
            raise ChecksumMismatchError(f"{uri} has {size} bytes; {file.size_bytes} were published")
        if hashlib.file_digest(content, "sha256").hexdigest() != file.sha256:
            raise ChecksumMismatchError(f"{uri} does not have the SHA-256 it was published with, {file.sha256}")


NEXT_NAME = "manifest.next.json"
"""Name of the prepared new manifest while some published files are deleted."""


def thin(store: ObjectStore, bucket: str, prefix: str, keep: Callable[[str], bool]) -> None:
    """Deletes some of the published files under a prefix, and updates the manifest.

    Args:
        store: The object store.
        bucket: Name of the bucket.
        prefix: Beginning of the files' keys, before a slash; not empty.
        keep: Function that returns whether the file of a name is kept.

    Raises:
        ObjectNotFoundError: No files are published under this prefix.
        StorageError: An object cannot be deleted; a further call continues.
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
    """Completes an interrupted deletion of some published files (`thin`), if there is one.

    Args:
        store: The object store.
        bucket: Name of the bucket.
        prefix: The prefix of that call.

    Raises:
        StorageError: An object cannot be deleted; a further call continues.
    """
    if (after := _prepared(store, bucket, prefix)) is not None:
        _remove_rest(store, bucket, prefix, after)


def _remove_rest(store: ObjectStore, bucket: str, prefix: str, after: Manifest) -> None:
    """Deletes the objects of a folder that the new manifest does not list, and replaces the old manifest by it.

    The old manifest goes first, so that readers never take a thinned folder for whole.
    """
    store.delete(bucket, join_key(prefix, MANIFEST_NAME))
    stay = {join_key(prefix, name) for name in (NEXT_NAME, *(file.path for file in after.files))}
    gone = [info.key for info in store.list(bucket, join_key(prefix, "")) if info.key not in stay]
    run_all(lambda key: store.delete(bucket, key), gone)
    store.put_bytes(bucket, join_key(prefix, MANIFEST_NAME), _written(after))
    store.delete(bucket, join_key(prefix, NEXT_NAME))


def thinned(manifest: Manifest, keep: Callable[[str], bool]) -> Manifest:
    """Returns a manifest without the files that are not kept, with a count of these; unchanged if all are kept."""
    stay = [file for file in manifest.files if keep(file.path)]
    count, size = removed_before(manifest)
    gone = [file for file in manifest.files if not keep(file.path)]
    if not gone:
        return manifest
    removed = {"files": count + len(gone), "sizeBytes": size + sum(file.size_bytes for file in gone)}
    return manifest.model_copy(update={"files": stay, "about": {**manifest.about, "removed": removed}})


def removed_before(manifest: Manifest) -> tuple[int, int]:
    """Returns how many files of a manifest were deleted so far, and their bytes; zeros if it does not name any."""
    removed = manifest.about.get("removed")
    if not isinstance(removed, dict):
        return 0, 0
    count, size = removed.get("files"), removed.get("sizeBytes")
    return (count, size) if isinstance(count, int) and isinstance(size, int) else (0, 0)


def _prepared(store: ObjectStore, bucket: str, prefix: str) -> Manifest | None:
    """Returns the new manifest that an interrupted call of `thin` had prepared, or `None`."""
    try:
        return Manifest.model_validate_json(store.get_bytes(bucket, join_key(prefix, NEXT_NAME)))
    except ObjectNotFoundError:
        return None


def _written(manifest: Manifest) -> bytes:
    return f"{manifest.model_dump_json(indent=2)}\n".encode()
