"""Signed `.swu` installation files for robots with third-party updaters (SWUpdate), and the key that signs them.

Each contains an application's archive. A file is made once for an archive, version, key and folder on the robot. In the
object store, `robots/` has the files under their hashes, and a record under the hash of those four, as JSON, that names
the file.
"""

import hashlib
import json
import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from uuid import uuid4

from pydantic import ValidationError

from ...schemas.documents.applications import ApplicationDocument, StoredSource
from ...schemas.fleet.rollouts.rollout_plan import Artifact
from ...schemas.fleet.settings import FleetSettings
from ...schemas.wire.errors import (
    BucketNotFoundError,
    BundleError,
    ConfigurationError,
    DeploymentError,
    ObjectNotFoundError,
)
from ..catalog import Resource
from ..service.service import Service
from .application_archives import FileHashes, fetch_source, place_of, sources_by_architecture
from .swu import Release, SigningKey, load_signing_key, new_signing_key, wrap

VALID_DAYS = 20 * 365
"""Validity of the signing certificate, in days.

Robots refuse everything that an expired certificate signed, and nothing tells them of the next one.
"""

_CERTIFICATE = b"-----BEGIN CERTIFICATE-----"


def certificate_path(service: Service) -> Path:
    """Returns the path of the signing certificate (PEM) with which robots verify installation files."""
    return service.folder("robots") / "certificate.pem"


def signing_key(service: Service) -> SigningKey:
    """Returns the service's key that signs installation files for robots; it is created on first use.

    Raises:
        ConfigurationError: The file does not hold a key, or cannot be read or written.
    """
    path = service.folder("robots") / "signing-key.pem"
    try:
        if not path.exists():
            key = new_signing_key("robomaker", service.clock(), VALID_DAYS, service.chance.randbytes)
            write_once(path, key.private_pem + key.certificate_pem, 0o600)
        private_pem, separator, certificate_pem = path.read_bytes().partition(_CERTIFICATE)
        key = load_signing_key(private_pem, separator + certificate_pem)
        if not certificate_path(service).exists():
            write_once(certificate_path(service), key.certificate_pem, 0o644)
    except OSError as error:
        raise ConfigurationError(f"the signing key {path} cannot be used: {error.strerror}") from error
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from error
    return key


def write_once(path: Path, content: bytes, mode: int) -> None:
    """Writes a whole key file unless one exists: no key is ever overwritten.

    Args:
        path: The file; its folder exists.
        content: Content of the file.
        mode: Permissions of the file, as of `chmod`.

    Raises:
        OSError: The file cannot be written.
    """
    with written(path, content, mode) as part, suppress(FileExistsError):
        path.hardlink_to(part)


@contextmanager
def written(path: Path, content: bytes, mode: int) -> Iterator[Path]:
    """Yields a temporary file with the content, ready to be renamed to its final path; it is deleted afterwards.

    Args:
        path: Final path of the file; its folder exists.
        content: Content of the file.
        mode: Permissions of the file, as of `chmod`.

    Raises:
        OSError: The file cannot be written.
    """
    part = path.with_name(f".{uuid4().hex}.part")
    try:
        with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        yield part
    finally:
        part.unlink(missing_ok=True)


FILE_NAME = "application.swu"
"""File name of installation files in orders to robots; the object's key tells versions apart."""

_FOLDER = "robots"
_FORM = 2  # of the files: another number makes all of them anew
_ANY_HARDWARE = ("#RE:.*",)  # an application names architectures, and no revisions of boards


def prepare(application: Resource, architectures: Iterable[str], service: Service) -> dict[str, Artifact]:
    """Builds the installation files (`.swu`) that robots download for an application, and uploads them.

    Args:
        application: The application's version, as `find_application` finds it.
        architectures: CPU architectures of the robots.
        service: The service, with its catalog and object store.

    Returns:
        The files by architecture; architectures that the application has no archive for are absent.

    Raises:
        DeploymentError: An archive is gone, may not be read, is not the one it was when the version was made, or cannot
            be wrapped; or the application has no archives at all.
        StorageError: The object store does not answer.
        ConfigurationError: The signing key cannot be used.
    """
    key = signing_key(service)
    return {
        architecture: _artifact(application, source, key, service)
        for architecture, source in sources_by_architecture(application, architectures).items()
    }


def _artifact(application: Resource, source: StoredSource, key: SigningKey, service: Service) -> Artifact:
    version = ApplicationDocument.of(application).version
    folder = f"{FleetSettings.of(service.settings).robot_folder}/{application.name}/{version}"
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
