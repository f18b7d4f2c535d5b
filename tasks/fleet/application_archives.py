"""Archives of an application version: selects one for each processor architecture, and checks that it is unchanged."""

import hashlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from ...schemas.documents.applications import ApplicationDocument, StoredSource
from ...schemas.wire.errors import (
    BucketNotFoundError,
    DeploymentError,
    ObjectNotFoundError,
    StorageAccessDeniedError,
)
from ..catalog import Resource
from ..service.service import Service

_PART_BYTES = 1024 * 1024


@dataclass(frozen=True)
class FileHashes:
    """Length in bytes and hexadecimal hashes of a file."""

    size_bytes: int
    sha256: str
    sha1: str
    md5: str

    @classmethod
    def of(cls, path: Path) -> "FileHashes":
        """Computes the length and hashes of a file."""
        # Updaters ask for the last two; neither protects anything, the signatures do.
        digests = [hashlib.sha256(), hashlib.sha1(usedforsecurity=False), hashlib.md5(usedforsecurity=False)]
        size_bytes = 0
        with path.open("rb") as file:
            while part := file.read(_PART_BYTES):
                size_bytes += len(part)
                for digest in digests:
                    digest.update(part)
        return cls(size_bytes, *(digest.hexdigest() for digest in digests))


def sources_by_architecture(application: Resource, architectures: Iterable[str]) -> dict[str, StoredSource]:
    """Returns an application's archive for each processor architecture; missing ones are left out.

    Raises:
        DeploymentError: The application has no archives at all.
    """
    sources = ApplicationDocument.of(application).sources
    if not sources:
        raise DeploymentError(
            f"{application.arn} has no archives that robots could download; give its version sources",
            "MissingRobotDeploymentResource",
        )
    known = {source.architecture: source for source in sources}
    found = {each: known.get(each) or known.get(None) for each in sorted(set(architectures))}
    return {architecture: source for architecture, source in found.items() if source is not None}


def place_of(source: StoredSource) -> str:
    """Returns the address of an archive, `s3://bucket/key`."""
    return f"s3://{source.s3_bucket}/{source.s3_key}"


def fetch_source(source: StoredSource, version: str, path: Path, service: Service) -> None:
    """Downloads an application archive, and checks that it is unchanged since the version was created.

    Args:
        source: The archive.
        version: The application's.
        path: Path of the local file.
        service: The service, with its catalog and object store.

    Raises:
        DeploymentError: The archive was deleted, may not be read, or was changed since the version was created.
        StorageError: The object store does not answer.
    """
    place, store = place_of(source), service.store
    found = _named(place, lambda: store.get_file(source.s3_bucket, source.s3_key, path).etag)
    if found != source.etag:
        raise DeploymentError(
            f"{place} has changed since version {version} was made: ETag {source.etag}, then {found}", "EtagMismatch"
        )


def fetch_condition(bucket: str, key: str, etag: str | None, path: Path, service: Service) -> None:
    """Downloads a deployment's condition file, a program that robots run before they download.

    Args:
        bucket: Bucket of the file.
        key: Key of the file.
        etag: ETag of the file when the deployment was created; `None`: not recorded.
        path: Path of the local file.
        service: The service, with its catalog and object store.

    Raises:
        DeploymentError: The condition file was deleted, may not be read, or was changed.
        StorageError: The object store does not answer.
    """
    place = f"s3://{bucket}/{key}"
    found = _named(place, lambda: service.store.get_file(bucket, key, path).etag)
    if etag is not None and found != etag:
        raise DeploymentError(
            f"downloadConditionFile: {place} has changed since the deployment was created: ETag {etag}, then {found}",
            "EtagMismatch",
        )


def _named(place: str, fetch: Callable[[], str]) -> str:
    try:
        return fetch()
    except (ObjectNotFoundError, BucketNotFoundError) as error:
        raise DeploymentError(f"{place} is gone: {error}", "ResourceNotFound") from error
    except StorageAccessDeniedError as error:
        raise DeploymentError(f"{place} may not be read: {error}", "BadPermissionError") from error
