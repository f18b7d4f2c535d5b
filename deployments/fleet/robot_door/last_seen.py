"""Times at which robots were last seen by the door, gathered and handed on together."""

import asyncio
from collections.abc import Callable, Mapping


class LastSeen:
    """Collects the last poll times of robots, and passes them on regularly.

    Args:
        hand_on: Receives the collected times, in seconds since 1970, by robot; must not block.
        interval_s: Time for which they are collected, in seconds.
    """

    def __init__(self, hand_on: Callable[[Mapping[str, float]], object], interval_s: float) -> None:
        self._hand_on = hand_on
        self._interval_s = interval_s
        self._seen: dict[str, float] = {}

    def note(self, robot: str, at_s: float) -> None:
        """Records the time (s) at which a robot polled, to pass it on with others a little later."""
        if not self._seen:
            asyncio.get_running_loop().call_later(self._interval_s, self.flush)
        self._seen[robot] = at_s

    def flush(self) -> None:
        """Passes on the collected poll times of robots."""
        seen, self._seen = self._seen, {}
        if seen:
            self._hand_on(seen)
