"""Signed `.swu` files for robots with third-party updaters: each wraps one of the application's archives.

A file is made once for an archive, a version, a key and a folder on the robot. In the object store, `robots/` has the
files under their hashes, and under the hash of all that, as JSON, which file it is.
"""

import hashlib
import json
import tempfile
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

from pydantic import ValidationError

from ...schemas.documents.applications import ApplicationDocument, StoredSource
from ...schemas.rollouts.artifacts import Artifact
from ...schemas.wire.errors import (
    BucketNotFoundError,
    BundleError,
    DeploymentError,
    ObjectNotFoundError,
)
from ..catalog import Resource
from ..service.service import Service
from .signing_keys import signing_key
from .sources import FileHashes, fetch_source, place_of, sources_by_architecture
from .swu.description import Release
from .swu.signing import SigningKey
from .swu.wrapping import wrap

FILE_NAME = "application.swu"
"""Name of the file in orders; the object's key tells versions apart."""

_FOLDER = "robots"
_FORM = 2  # of the files: another number makes all of them anew
_ANY_HARDWARE = ("#RE:.*",)  # an application names architectures, and no revisions of boards


def prepare(application: Resource, architectures: Iterable[str], service: Service) -> dict[str, Artifact]:
    """Makes what robots download, and stores it; what is there already is left alone.

    Args:
        application: the application's version, as `find_application` finds it.
        architectures: those of the robots.
        service: where the archives are, and where the files go.

    Returns:
        The files by architecture; architectures that the application has no archive for are absent.

    Raises:
        DeploymentError: an archive is gone, may not be read, is not the one it was when the version was made, or cannot
            be wrapped; or the application has no archives at all.
        StorageError: the object store does not answer.
        ConfigurationError: the signing key cannot be used.
    """
    key = signing_key(service)
    return {
        architecture: _artifact(application, source, key, service)
        for architecture, source in sources_by_architecture(application, architectures).items()
    }


def _artifact(application: Resource, source: StoredSource, key: SigningKey, service: Service) -> Artifact:
    version = ApplicationDocument.of(application).version
    folder = f"{service.settings.robot_folder}/{application.name}/{version}"
    release = Release(application.name, version, folder, _ANY_HARDWARE)
    record = f"{_FOLDER}/{_hash_of(source, release, key)}.json"
    if (known := _known(record, service)) is not None:
        return known
    with tempfile.TemporaryDirectory(dir=service.folder("scratch")) as scratch:
        file = Path(scratch, FILE_NAME)
        artifact = _wrapped(source, release, key, file, service)
        service.store.ensure_bucket(artifact.bucket)
        service.store.put_file(artifact.bucket, artifact.key, file)
    service.store.put_bytes(artifact.bucket, record, json.dumps(artifact.to_json()).encode())
    return artifact


def _hash_of(source: StoredSource, release: Release, key: SigningKey) -> str:
    made_of = [_FORM, source.etag, release.name, release.version, release.folder, key.certificate_pem.decode()]
    return hashlib.sha256(json.dumps(made_of).encode()).hexdigest()


def _known(record: str, service: Service) -> Artifact | None:
    bucket = service.settings.bucket
    try:
        artifact = Artifact.model_validate_json(service.store.get_bytes(bucket, record))
        service.store.head(artifact.bucket, artifact.key)
    except (ObjectNotFoundError, BucketNotFoundError, ValidationError):
        return None
    return artifact


def _wrapped(source: StoredSource, release: Release, key: SigningKey, file: Path, service: Service) -> Artifact:
    archive = file.with_name("archive")
    fetch_source(source, release.version, archive, service)
    try:
        with archive.open("rb") as bundle, file.open("wb") as target:
            archive_sha256 = wrap(bundle, release, key, target)
    except BundleError as error:
        raise DeploymentError(f"{place_of(source)}: {error}", "ExtractingBundleFailure") from error
    hashes = FileHashes.of(file)
    return Artifact(
        bucket=service.settings.bucket,
        key=f"{_FOLDER}/{hashes.sha256}.swu",
        file_name=FILE_NAME,
        name=release.name,
        version=release.version,
        archive_sha256=archive_sha256,
        **asdict(hashes),
    )
