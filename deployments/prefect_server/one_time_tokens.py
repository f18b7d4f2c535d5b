"""Tokens that work once, for a short time."""

import secrets
import threading
import time
from collections.abc import Callable

LIFE_S = 600.0
"""How long a token works: ten minutes."""

_MOST = 100
_TOKEN_BYTES = 24


class OneTimeTokens:
    """Issues tokens and redeems each of them once.

    Args:
        life_s: how long a token works.
        clock: seconds that only grow.
        make: makes a token that cannot be guessed.
    """

    def __init__(
        self,
        life_s: float = LIFE_S,
        clock: Callable[[], float] = time.monotonic,
        make: Callable[[], str] = lambda: secrets.token_urlsafe(_TOKEN_BYTES),
    ) -> None:
        self._life_s = life_s
        self._clock = clock
        self._make = make
        self._expiries: dict[str, float] = {}
        self._lock = threading.Lock()

    def issue(self) -> str:
        """Makes a token; beyond a hundred unused ones the oldest stops working."""
        with self._lock:
            while len(self._expiries) >= _MOST:
                del self._expiries[next(iter(self._expiries))]
            token = self._make()
            self._expiries[token] = self._clock() + self._life_s
            return token

    def redeem(self, token: str) -> bool:
        """Says whether a token works, and makes it stop working."""
        with self._lock:
            expiry = self._expiries.pop(token, None)
            return expiry is not None and self._clock() < expiry
