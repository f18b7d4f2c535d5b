"""Limit of failed logins to the console, for each IP address: access keys cannot be guessed by trying many."""

from collections import deque

from ...schemas.wire.errors import ThrottlingException

_MOST_FAILURES = 10
_FAILURES_WITHIN_S = 60.0
_MOST_ADDRESSES = 10_000
"""Limit of addresses that are known; the one with the oldest failure is forgotten, so that memory is bounded."""


class FailedLogins:
    """Times of the latest failed logins of each IP address; not safe to use from several threads at once."""

    def __init__(self) -> None:
        self._failures: dict[str, deque[float]] = {}
        """Times of the latest failed logins, by IP address."""

    def check(self, client: str, now_s: float) -> None:
        """Raises an error if an address may not try to log in yet.

        Args:
            client: IP address of the visitor.
            now_s: Time in seconds, of a clock that only grows.

        Raises:
            ThrottlingException: Too many logins failed within the last minute.
        """
        failures = self._failures.get(client, ())
        if len(failures) == _MOST_FAILURES and now_s - failures[0] < _FAILURES_WITHIN_S:
            raise ThrottlingException(f"{_MOST_FAILURES} logins failed within a minute; try again in a minute")

    def note(self, client: str, now_s: float) -> None:
        """Records that a login from an address has failed.

        Args:
            client: IP address of the visitor.
            now_s: Time in seconds, of the clock that `check` is given.
        """
        times = self._failures.pop(client, None) or deque(maxlen=_MOST_FAILURES)
        times.append(now_s)
        self._failures[client] = times
        while len(self._failures) > _MOST_ADDRESSES:
            del self._failures[next(iter(self._failures))]
