"""When people are told that jobs wait: not of a moment, and not of the same thing all the time."""

from ...schemas.runs.machine_waits import Scarce
from .free_room import Wait

_AFTER_S = 2.0
_AGAIN_S = 600.0


class Notices:
    """Decides which waits of one batch, or of one job, are told."""

    def __init__(self) -> None:
        self._scarce: Scarce | None = None
        self._began_s = 0.0
        self._told_s: dict[Scarce, float] = {}
        self.lasting: Scarce | None = None
        """Scarce resource of the current wait, once the wait has lasted two seconds; None: no such wait."""

    def is_due(self, wait: Wait | None, now_s: float) -> bool:
        """Whether to tell of a wait now: it has lasted two seconds, and was not told in the last ten minutes.

        Args:
            wait: why there is waiting at this moment; None: there is nothing to tell.
            now_s: seconds on any clock.
        """
        scarce = wait.scarce if wait else None
        if scarce != self._scarce:
            self._scarce, self._began_s = scarce, now_s
        self.lasting = scarce if now_s - self._began_s >= _AFTER_S else None
        if self.lasting is None:
            return False
        if self.lasting in self._told_s and now_s - self._told_s[self.lasting] < _AGAIN_S:
            return False
        self._told_s[self.lasting] = now_s
        return True
