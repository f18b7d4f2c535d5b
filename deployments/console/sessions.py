"""Sessions of the console: of those who have logged in, and how long they last."""

import hmac
import secrets
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ..endpoint.calling.access_keys import AccessKey
from ..endpoint.protocol_errors import UnrecognizedClientException
from .failed_logins import FailedLogins

LIFETIME_S = 12 * 3600
"""Lifetime of a login session, in seconds."""

_MOST_SESSIONS = 10_000


@dataclass(frozen=True)
class Session:
    """A logged-in browser session of the web console."""

    key: AccessKey
    form_token: str
    """Secret token of the session's forms, which pages of other sites do not know."""

    ends_at_s: float


class Sessions:
    """All login sessions of a web console server.

    Args:
        access_keys: Access keys that may log in, by id.
        clock: Seconds that only grow.
        new_token: Makes what cannot be guessed.
    """

    def __init__(
        self,
        access_keys: Mapping[str, AccessKey],
        clock: Callable[[], float],
        new_token: Callable[[], str] = lambda: secrets.token_urlsafe(32),
    ) -> None:
        self._access_keys = access_keys
        self._clock = clock
        self._new_token = new_token
        self._sessions: dict[str, Session] = {}
        self._failed_logins = FailedLogins()
        self._lock = threading.Lock()

    def log_in(self, key_id: str, secret: str, client: str = "") -> str:
        """Checks an access key, starts a session, and returns its cookie token.

        Args:
            key_id: The id of an access key.
            secret: Secret of the access key.
            client: The visitor's IP address: failed logins are limited for each address.

        Raises:
            UnrecognizedClientException: Id and secret are not those of an access key.
            ThrottlingException: Too many logins failed within the last minute.
        """
        now = self._clock()
        with self._lock:
            self._failed_logins.check(client, now)
            key = self._access_keys.get(key_id)
            expected = key.secret if key else self._new_token()
            if not hmac.compare_digest(expected.encode(), secret.encode()) or key is None:
                self._failed_logins.note(client, now)
                raise UnrecognizedClientException("there is no access key with this id and this secret")
            self._forget_old(now)
            token = self._new_token()
            self._sessions[token] = Session(key, self._new_token(), now + LIFETIME_S)
        return token

    def find(self, token: str | None) -> Session | None:
        """Returns the session of a cookie token; `None` if there is none or it has expired."""
        with self._lock:
            session = self._sessions.get(token or "")
        return session if session is not None and session.ends_at_s > self._clock() else None

    def log_out(self, token: str | None) -> None:
        """Ends the login session of a cookie token; does nothing if there is none."""
        with self._lock:
            self._sessions.pop(token or "", None)

    def _forget_old(self, now: float) -> None:
        for token in [token for token, session in self._sessions.items() if session.ends_at_s <= now]:
            del self._sessions[token]
        while len(self._sessions) >= _MOST_SESSIONS:
            del self._sessions[next(iter(self._sessions))]
