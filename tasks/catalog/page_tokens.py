"""Page tokens: opaque to callers, good only for the list they came from."""

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence

from ...schemas.wire.errors import InvalidParameterException

Filters = Mapping[str, Sequence[str]]


def encode_page_token(kind: str, filters: Filters, sequence: int) -> str:
    """Makes the token of the page that follows an entry.

    Args:
        kind: what is listed.
        filters: with which conditions.
        sequence: the entry's place in the order of creation.
    """
    return base64.urlsafe_b64encode(f"{sequence}.{_fingerprint(kind, filters)}".encode()).decode()


def decode_page_token(kind: str, filters: Filters, token: str) -> int:
    """Reads a token.

    Returns:
        The place of the entry that the page follows.

    Raises:
        InvalidParameterException: it is no token, or one of another list.
    """
    try:
        sequence = int(base64.urlsafe_b64decode(token).decode("ascii").partition(".")[0])
    except ValueError as error:
        raise InvalidParameterException(f"nextToken is {token!r}; it has to come from the page before") from error
    if token != encode_page_token(kind, filters, sequence):
        raise InvalidParameterException(
            "nextToken came from another list or other filters; repeat the call it came from, with the token added"
        )
    return sequence


def _fingerprint(kind: str, filters: Filters) -> str:
    canonical = json.dumps([kind, {name: sorted(values) for name, values in filters.items()}], sort_keys=True)
    return hashlib.sha256(canonical.encode()).hexdigest()[:16]
