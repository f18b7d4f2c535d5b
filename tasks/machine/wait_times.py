"""How long one batch, or one job, has waited for its machine, by what it waited for; pure."""

from collections.abc import Mapping

from ...schemas.runs.machine_waits import Scarce


class WaitTimes:
    """Adds up waits from what is seen several times a second."""

    def __init__(self) -> None:
        self._total_s: dict[Scarce, float] = {}
        self._scarce: Scarce | None = None
        self._seen_s = 0.0

    def see(self, scarce: Scarce | None, now_s: float) -> None:
        """Notes what is waited for at this moment.

        Args:
            scarce: what; None: there is no wait.
            now_s: seconds on any clock.
        """
        if self._scarce is not None:
            self._total_s[self._scarce] = self._total_s.get(self._scarce, 0.0) + max(0.0, now_s - self._seen_s)
        self._scarce, self._seen_s = scarce, now_s

    def total_s(self, before_s: Mapping[Scarce, float]) -> dict[Scarce, float]:
        """How long all waits took together, in seconds, by what was waited for.

        Args:
            before_s: the totals of an earlier moment, which are left out.
        """
        return {scarce: total_s - before_s.get(scarce, 0.0) for scarce, total_s in self._total_s.items()}
