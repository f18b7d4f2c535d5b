"""Tokens by which robots prove who they are; the server keeps only their hashes.

Tokens are 256 random bits, so a plain hash of one does not lead back to it, and checks stay cheap.
"""

import hashlib
import hmac
from collections.abc import Callable

_BYTES = 32
_MAX_CHARACTERS = 128
_SCHEME = b"targettoken"


def new_token(random_bytes: Callable[[int], bytes]) -> str:
    """Makes a token for one robot: 64 hexadecimal digits.

    Args:
        random_bytes: gives that many bytes that others cannot guess, such as `secrets.token_bytes`.
    """
    return random_bytes(_BYTES).hex()


def hash_token(token: str) -> bytes:
    """The hash under which a token is kept: 32 bytes."""
    return hashlib.sha256(token.encode()).digest()


def is_token(token: bytes, expected: bytes) -> bool:
    """Whether a token has the expected hash, in a time that does not depend on the hash."""
    return hmac.compare_digest(hashlib.sha256(token).digest(), expected)


def token_in(authorization: bytes | None) -> bytes | None:
    """The token in a request's header `Authorization: TargetToken …`; `None`: there is none, or it is too long."""
    scheme, _, token = (authorization or b"").partition(b" ")
    token = token.strip()
    if scheme.lower() != _SCHEME or not token or len(token) > _MAX_CHARACTERS:
        return None
    return token
