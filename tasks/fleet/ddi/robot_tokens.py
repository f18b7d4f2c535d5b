"""Tokens of robots: made, hashed for storage, compared, and found in a request."""

import hashlib
import hmac
from collections.abc import Callable

_BYTES = 32
_MAX_CHARACTERS = 128
_SCHEME = b"targettoken"


def new_token(random_bytes: Callable[[int], bytes]) -> str:
    """Makes a secret token with which one robot logs in: 64 hexadecimal digits.

    Args:
        random_bytes: Function that returns that many unpredictable bytes, such as `secrets.token_bytes`.
    """
    return random_bytes(_BYTES).hex()


def hash_token(token: str) -> bytes:
    """Returns the hash under which a robot's token is stored: 32 bytes."""
    return hashlib.sha256(token.encode()).digest()


def is_token(token: bytes, expected: bytes) -> bool:
    """Whether a token has the expected hash, compared in constant time."""
    return hmac.compare_digest(hashlib.sha256(token).digest(), expected)


def token_in(authorization: bytes | None) -> bytes | None:
    """Returns the token in a request header `Authorization: TargetToken …`; `None` if it has none or it is too long."""
    scheme, _, token = (authorization or b"").partition(b" ")
    token = token.strip()
    if scheme.lower() != _SCHEME or not token or len(token) > _MAX_CHARACTERS:
        return None
    return token
