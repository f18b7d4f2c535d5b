"""Signed statements as DSSE envelopes, and the key that signs them.

Equal statements and keys give equal bytes. Only these bytes are accepted: an envelope with the same content in other
bytes is refused, so that its hash identifies it.
"""

import json
from pathlib import Path
from typing import Any, TypeAlias

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
    load_pem_private_key,
    load_pem_public_key,
)
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from securesystemslib import exceptions
from securesystemslib.dsse import Envelope
from securesystemslib.signer import CryptoSigner, SSlibKey  # pyright: ignore[reportPrivateImportUsage]

from ....schemas.wire.errors import AttestationError, ConfigurationError
from ...service.service import Service
from ..artifacts import write_once
from .statements import Statement

AttestationKey: TypeAlias = CryptoSigner
"""Private key that signs attestations."""

PublicKey: TypeAlias = SSlibKey
"""Public key that verifies attestations."""


def public_key_path(service: Service) -> Path:
    """Returns the path of the public key (PEM) that verifies attestations."""
    return service.folder("robots") / "attestation-key.pub"


def attestation_key(service: Service) -> AttestationKey:
    """Returns the service's private key that signs attestations; it is created on first use.

    Raises:
        ConfigurationError: The key file does not hold such a key, or cannot be read or written.
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
    """Reads the public key that verifies this service's attestations; none is created.

    Raises:
        ConfigurationError: The service has no attestation key, or its key file does not hold one.
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
    """Reads a public key for attestations (ed25519, PEM) from a file.

    Raises:
        ConfigurationError: The file cannot be read, or is no public key of ed25519 in PEM.
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


PAYLOAD_TYPE = "application/vnd.in-toto+json"


class _Signature(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)

    keyid: str = Field(description="Id of the key that signed.")
    sig: str = Field(description="The signature, in base 64.")


class _Envelope(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)

    payload: str = Field(description="The statement, in base 64.")
    payloadType: str = Field(pattern=f"^{PAYLOAD_TYPE.replace('+', '[+]')}$", description="Media type of the payload.")  # noqa: N815 - DSSE's own name
    signatures: list[_Signature] = Field(min_length=1, max_length=1, description="One signature.")


def sign(statement: Statement, key: AttestationKey) -> bytes:
    """Signs an attestation's statement (that tests have passed) and returns the envelope with the signature."""
    envelope = Envelope(statement.to_bytes(), PAYLOAD_TYPE, {})
    envelope.sign(key)
    return _bytes_of(envelope)


def verified(content: bytes, key: PublicKey) -> Statement:
    """Verifies the signature of an attestation, and returns its statement.

    Args:
        content: The envelope.
        key: Public key of the expected signer.

    Raises:
        AttestationError: The content is not an attestation in a signed envelope, another key signed it, or it was
            changed after it was signed.
    """
    envelope = _envelope_of(content)
    keyid = next(iter(envelope.signatures))
    if keyid != key.keyid:
        raise AttestationError(f"the attestation is signed by the key {keyid}, not by {key.keyid}")
    try:
        envelope.verify([key], 1)
    except exceptions.Error:
        raise AttestationError("the attestation's signature is wrong: it was changed after it was signed") from None
    return Statement.of_bytes(envelope.payload)


def _envelope_of(content: bytes) -> Envelope:
    try:
        parts: dict[str, Any] = _Envelope.model_validate_json(content).model_dump()
        envelope = Envelope.from_dict(parts)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"])) or "all of it"
        raise AttestationError(f"the attestation is no envelope: {place}: {first['msg']}") from None
    except (ValueError, exceptions.Error) as error:
        raise AttestationError(f"the attestation is no envelope: {error}") from None
    if _bytes_of(envelope) != content:
        raise AttestationError("the attestation is not written as it is when it is signed")
    return envelope


def _bytes_of(envelope: Envelope) -> bytes:
    return json.dumps(envelope.to_dict(), sort_keys=True, separators=(",", ":")).encode()
