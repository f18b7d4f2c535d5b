"""Signed statements: DSSE envelopes, as bytes. A statement and a key always give the same bytes.

Only these bytes are taken: an envelope that says the same in other bytes is refused, so that its hash identifies it.
"""

import json
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from securesystemslib import exceptions
from securesystemslib.dsse import Envelope

from ....schemas.wire.errors import AttestationError
from .attestation_keys import AttestationKey, PublicKey
from .statements import Statement

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
    """Signs a statement."""
    envelope = Envelope(statement.to_bytes(), PAYLOAD_TYPE, {})
    envelope.sign(key)
    return _bytes_of(envelope)


def verified(content: bytes, key: PublicKey) -> Statement:
    """The statement of an envelope, which the key has signed.

    Args:
        content: the envelope.
        key: the public key that has to have signed it.

    Raises:
        AttestationError: it is no such envelope, or another key signed it, or it was changed.
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
