"""The key that signs attestations: ed25519, in the data home, made on first use. No other key signs them.

The public key lies beside it as `attestation-key.pub`, for who verifies elsewhere.
"""

from pathlib import Path
from typing import TypeAlias

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
    load_pem_private_key,
    load_pem_public_key,
)
from securesystemslib.signer import CryptoSigner, SSlibKey  # pyright: ignore[reportPrivateImportUsage]

from ....schemas.wire.errors import ConfigurationError
from ...service.service import Service
from ..signing_keys import write_once

AttestationKey: TypeAlias = CryptoSigner
"""Signs attestations."""

PublicKey: TypeAlias = SSlibKey
"""Verifies them."""


def public_key_path(service: Service) -> Path:
    """Path of the public key, in PEM."""
    return service.folder("robots") / "attestation-key.pub"


def attestation_key(service: Service) -> AttestationKey:
    """The service's key; of several processes that need the first one at once, one makes it.

    Raises:
        ConfigurationError: what lies there is no such key, or it cannot be read or written.
    """
    path = _private_path(service)
    try:
        if not path.exists():
            new = Ed25519PrivateKey.generate()
            write_once(path, new.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()), 0o600)
        private = _private(path)
        public = private.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)
        write_once(public_key_path(service), public, 0o644)
    except OSError as error:
        raise ConfigurationError(f"the attestation key {path} cannot be used: {error.strerror}") from error
    return AttestationKey(private)


def known_public_key(service: Service) -> PublicKey:
    """The public key of the service's key; this makes none.

    Raises:
        ConfigurationError: there is none, or what lies there is none.
    """
    path = _private_path(service)
    if not path.exists():
        raise ConfigurationError(
            f"there is no attestation key {path}; verify where attestations are signed, or give --public-key"
        )
    try:
        return PublicKey.from_crypto(_private(path).public_key())
    except OSError as error:
        raise ConfigurationError(f"the attestation key {path} cannot be used: {error.strerror}") from error


def read_public_key(path: Path) -> PublicKey:
    """Reads a public key, as `attestation-key.pub` is.

    Raises:
        ConfigurationError: the file cannot be read, or is no public key of ed25519 in PEM.
    """
    try:
        key = load_pem_public_key(path.read_bytes())
    except OSError as error:
        raise ConfigurationError(f"the public key {path} cannot be read: {error.strerror}") from error
    except ValueError:
        raise ConfigurationError(f"{path} is no public key in PEM") from None
    if not isinstance(key, Ed25519PublicKey):
        raise ConfigurationError(f"{path} is a public key of another kind; attestations are signed with ed25519")
    return PublicKey.from_crypto(key)


def _private_path(service: Service) -> Path:
    return service.folder("robots") / "attestation-key"


def _private(path: Path) -> Ed25519PrivateKey:
    try:
        key = load_pem_private_key(path.read_bytes(), None)
    except (ValueError, TypeError) as error:
        raise ConfigurationError(f"{path} is no private key in PEM without a password: {error}") from None
    if not isinstance(key, Ed25519PrivateKey):
        raise ConfigurationError(f"{path} is a key of another kind; attestations are signed with ed25519")
    return key
