"""The key with which a service signs what robots install; it lies in the data home, and is made on first use.

A key is one file that only its user reads. Its certificate, which robots get, lies beside it.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from uuid import uuid4

from ...schemas.wire.errors import ConfigurationError
from ..service.service import Service
from .swu.signing import SigningKey, load_signing_key, new_signing_key

VALID_DAYS = 20 * 365
"""Robots refuse all that an expired certificate signed, and nothing tells them of the next one."""

_CERTIFICATE = b"-----BEGIN CERTIFICATE-----"


def certificate_path(service: Service) -> Path:
    """Path of the certificate of `signing_key`, in PEM; robots verify signatures with it."""
    return service.folder("robots") / "certificate.pem"


def signing_key(service: Service) -> SigningKey:
    """The service's key; of several processes that need the first one at once, one makes it.

    Raises:
        ConfigurationError: what lies there is no key, or it cannot be read or written.
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
    """Writes a whole file, unless there is one: no key ever takes the place of another.

    Args:
        path: the file; its folder exists.
        content: what it holds.
        mode: who may read it, as `chmod` has it.

    Raises:
        OSError: it cannot be written.
    """
    with written(path, content, mode) as part, suppress(FileExistsError):
        path.hardlink_to(part)


@contextmanager
def written(path: Path, content: bytes, mode: int) -> Iterator[Path]:
    """A file beside another, whole and on the disk, to be given its name; gone when the block ends.

    Args:
        path: the other file; its folder exists.
        content: what it holds.
        mode: who may read it, as `chmod` has it.

    Raises:
        OSError: it cannot be written.
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
