"""Job workers that somebody else starts: `robomaker work BATCH`, on any machine."""

from collections.abc import Iterator
from contextlib import contextmanager


class ByHandBackend:
    """Starts none, and says how one is started."""

    def check(self) -> None:
        """Finds nothing: machines may come at any time."""

    @contextmanager
    def job_workers(self, batch: str, wanted: int) -> Iterator["ByHandWorkers"]:
        """Starts none."""
        yield ByHandWorkers(batch, wanted)


class ByHandWorkers:
    """Job workers that are not known here.

    Args:
        batch: ARN of the batch.
        wanted: how many can be of use.
    """

    def __init__(self, batch: str, wanted: int) -> None:
        self._words = f"up to {wanted} jobs at once; on each machine: robomaker work {batch}"

    def look(self) -> str:
        """Says how one is started."""
        return self._words
