"""Jobs that others run: threads that wait for their ends, and one that looks for all of them."""

import threading
from collections.abc import Callable

from ...schemas.lifecycles import is_terminal
from ..catalog import Catalog
from .job_folders import KIND

_WAIT_S = 0.5


_LASTING_S = 3.0
"""A worker that has just ended a job takes the next one sooner."""


class AwaitedJobs:
    """The ends of a batch's jobs; safe to use from several threads.

    Args:
        catalog: where they are.
        batch: ARN of the batch.
    """

    def __init__(self, catalog: Catalog, batch: str) -> None:
        self._catalog = catalog
        self._batch = batch
        self._ended: frozenset[str] = frozenset()
        self._changed = threading.Condition()

    def look(self) -> None:
        """Asks once for all jobs which have ended.

        Raises:
            ServiceUnavailableException: the catalog does not answer.
        """
        standing = self._catalog.children_standing(self._batch, KIND)
        ended = frozenset(arn for arn, status in standing.items() if is_terminal(KIND, status))
        with self._changed:
            if ended != self._ended:
                self._ended = ended
                self._changed.notify_all()

    def wait(self, job: str, should_stop: Callable[[], bool]) -> None:
        """Waits until a look has found that a job has ended, or waiting is to end.

        Args:
            job: ARN of the job.
            should_stop: asked now and then; has to answer at once.
        """
        with self._changed:
            while job not in self._ended and not should_stop():
                self._changed.wait(_WAIT_S)


class WorkerWait:
    """Notices whether the jobs of a batch wait for a job worker: while one runs, there is a worker."""

    def __init__(self) -> None:
        self._since_s: float | None = None

    def lasts(self, pending: int, running: int, now_s: float) -> bool:
        """Notes how jobs stand, and says whether all wait for a worker, for longer than it takes to find one.

        Args:
            pending: jobs that no worker has begun.
            running: jobs that workers have begun and not ended.
            now_s: seconds of a clock that never goes back.
        """
        if not pending or running:
            self._since_s = None
            return False
        if self._since_s is None:
            self._since_s = now_s
        return now_s - self._since_s >= _LASTING_S
