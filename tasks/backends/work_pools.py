"""Backend that runs job workers as flow runs of a Prefect work pool, on machines with `prefect worker start`.

A process pool has one machine for each worker that is online, and one flow run is kept for each: a machine that joins
gets one, the run of one that leaves is deleted. A pool of another type starts a container for each run:
`workers:POOL*4` says how many, or the pool's concurrency limit. There are never more than the batch can use.

The server is polled every few seconds, in a thread; if it does not answer, new workers are delayed, but no job is
affected. A job worker that ends before its batch is replaced, after growing pauses.
"""

import logging
import re
import threading
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .backend import BackendError

if TYPE_CHECKING:
    from .pool_runs import PoolRuns

_LOOK_S = 3.0
_END_S = 20.0
"""Longest wait, when the `with` block ends, for a request to the server that is in progress, in seconds."""

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class WorkPool:
    """Backend that starts job workers as Prefect flow runs in a work pool.

    Args:
        name: Name of the pool.
        most: Limit of job workers; absent: as many as the pool has machines.
        look_s: Seconds between two polls of the server.
    """

    name: str
    most: int | None = None
    look_s: float = _LOOK_S

    def check(self) -> None:
        """Raises `BackendError` if the Prefect server has no such work pool, or no deployment of the job worker."""
        from .pool_runs import opened_pool

        with opened_pool(self.name, self.most, batch="", wanted=1):
            pass  # it is checked when it is opened

    @contextmanager
    def job_workers(self, batch: str, wanted: int) -> Generator["PoolWorkers"]:
        """Starts job workers for a batch in the work pool inside a `with` block.

        Those of a process that has died are taken over.

        Raises:
            BackendError: The work pool does not exist, has no deployment of the job worker, or has no concurrency
                limit.
        """
        from .pool_runs import opened_pool

        with opened_pool(self.name, self.most, batch, wanted) as runs:
            workers = PoolWorkers(runs, self.look_s)
            try:
                workers.begin()
                yield workers
            except BaseException:
                workers.end(also_running=True)
                raise
            workers.end(also_running=False)


def backend_at(place: str) -> WorkPool:
    """Creates the backend for the setting `workers:PLACE`, a Prefect work pool; it does not connect yet.

    Args:
        place: Name of a work pool, with `*4` after it for four job workers at most.
    """
    name, star, number = place.rpartition("*")
    if star and name and re.fullmatch(r"[1-9][0-9]{0,3}", number):
        return WorkPool(name, int(number))
    return WorkPool(place)


class PoolWorkers:
    """Job workers of one batch in a Prefect work pool, started and watched by a thread.

    Args:
        runs: Flow runs of the job workers.
        look_s: Seconds between two polls of the server.
    """

    def __init__(self, runs: "PoolRuns", look_s: float) -> None:
        self._runs = runs
        self._look_s = look_s
        self._over = threading.Event()
        self._standing = f"job workers in the work pool {runs.pool} are being started"
        self._broken: Exception | None = None
        self._keeper = threading.Thread(target=self._keep, name=f"work pool {runs.pool}", daemon=True)

    def look(self) -> str:
        """Returns the last known state of the job workers as text for the user.

        Raises:
            BackendError: No job worker can be started.
        """
        if self._broken is not None:
            raise self._broken
        return self._standing

    def begin(self) -> None:
        """Starts the thread that starts and watches a batch's job workers in the work pool."""
        self._keeper.start()

    def end(self, *, also_running: bool) -> None:
        """Deletes flow runs of job workers that have not begun; running ones end by themselves as the batch is over.

        If the Prefect server does not answer, that is logged, and flow runs may be left.

        Args:
            also_running: Whether the batch is not over, so that running ones have to be cancelled.
        """
        self._over.set()
        self._keeper.join(_END_S)
        if self._keeper.is_alive() or not self._runs.take_back(also_running=also_running):
            _logger.warning(
                "the Prefect server does not answer; flow runs of job workers with the tag %s may be left there, and "
                "end as soon as they begin",
                self._runs.tag,
            )

    def _keep(self) -> None:
        while not self._over.is_set():
            try:
                self._standing = self._runs.staffed()
            except Exception as error:  # it is raised where the batch is carried out
                self._broken = error if isinstance(error, BackendError) else _unknown(error)
                return
            self._over.wait(self._look_s)


def _unknown(error: Exception) -> BackendError:
    made = BackendError(f"job workers cannot be looked after: {type(error).__name__}: {error}")
    made.__cause__ = error
    return made
