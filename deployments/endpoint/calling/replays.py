"""Signatures that were used: a signed request that someone recorded is not carried out again."""

import threading
from collections.abc import Mapping
from datetime import datetime, timedelta
from typing import Any

from ....schemas.wire.errors import ThrottlingException
from ..messages import InvalidSignatureException

GRACE_S = 2.0
"""How long a client may send the same signature again: SDKs sign a retry in the same second alike."""

_REPEATABLE = ("Describe", "List", "Get", "Batch", "Cancel", "Delete", "Update", "Tag", "Untag", "Register", "Deregist")


def is_repeatable(operation: str, members: Mapping[str, Any]) -> bool:
    """Whether a call does nothing more when it comes twice: by what it is, or by its client token."""
    return operation.startswith(_REPEATABLE) or bool(members.get("clientRequestToken"))


class Replays:
    """Remembers the signatures that were accepted for as long as they are valid.

    Args:
        valid: how long a signature is valid after it was made.
    """

    def __init__(self, valid: timedelta) -> None:
        self._valid_s = valid.total_seconds()
        self._minutes: dict[int, dict[bytes, float]] = {}  # by the minute in which they cease to be valid
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return sum(map(len, self._minutes.values()))

    def check(self, signature: str, signed_at: datetime, now: datetime, *, repeatable: bool) -> None:
        """Uses a signature, which has been found right.

        Args:
            signature: its hexadecimal digits.
            signed_at: when it was made.
            now: the time.
            repeatable: whether a second call would do nothing more.

        Raises:
            InvalidSignatureException: it was used before.
            ThrottlingException: it was used a moment ago. A client that means it signs again when it tries again.
        """
        now_s = now.timestamp()
        minute = int((signed_at.timestamp() + self._valid_s) // 60)
        with self._lock:
            for past in [each for each in self._minutes if (each + 1) * 60 < now_s]:
                del self._minutes[past]
            used = self._minutes.setdefault(minute, {})
            key = bytes.fromhex(signature)[:16]
            if (first_s := used.get(key)) is None:
                used[key] = now_s
                return
        if repeatable and now_s - first_s <= GRACE_S:
            return
        if now_s - first_s <= GRACE_S:
            raise ThrottlingException("a request with this signature was served a moment ago; sign again in a second")
        raise InvalidSignatureException("a request with this signature was served already; sign each request anew")
