"""Job workers on the machines of a cluster: one on each, as long as the batch runs.

A thread of its own speaks with the cluster, so that one which does not answer holds up nothing.
"""

import threading
import time
from collections.abc import Collection, Generator
from contextlib import contextmanager
from typing import Protocol

from .backend import BackendError
from .node import Ended
from .staffing import Staffing

_LOOK_S = 0.5
_LOOK_FOR_MACHINES_S = 2.0
_PATIENCE_S = 15.0  # a cluster that does not answer at the end is left
_NOT_STARTED = 1


class Started(Protocol):
    """A job worker that was started on a machine of a cluster."""

    def ended(self) -> Ended | None:
        """How it ended, also with its machine; `None`: it runs, or waits for its turn on the machine."""
        ...


class Cluster(Protocol):
    """Machines of one kind. Used from one thread."""

    @property
    def place(self) -> str:
        """The cluster, in words: `the Dask cluster tcp://10.0.0.7:8786`."""
        ...

    def machines(self) -> Collection[str]:
        """The machines that there are now.

        Raises:
            Exception: it does not answer.
        """
        ...

    def start(self, machine: str, batch: str) -> Started:
        """Starts a job worker on a machine.

        Raises:
            Exception: it does not answer, or the machine is not there any more.
        """
        ...

    def end_all(self, patience_s: float) -> None:
        """Tells all job workers that it has started to end, and waits for it."""
        ...


class ClusterWorkers:
    """The job workers of one batch on a cluster.

    Args:
        cluster: where they are started.
        batch: ARN of the batch.
        wanted: how many can be of use.
    """

    def __init__(self, cluster: Cluster, batch: str, wanted: int) -> None:
        self._cluster = cluster
        self._batch = batch
        self._staffing = Staffing(cluster.place, wanted)
        self._started: dict[str, Started] = {}
        self._machines: Collection[str] = ()
        self._looked_at: float | None = None
        self._words = f"connected to {cluster.place}"
        self._error: BackendError | None = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._follow, name="job workers", daemon=True)

    def look(self) -> str:
        """Returns the state of the job workers, in words.

        Raises:
            BackendError: no machine can run jobs.
        """
        if self._error is not None:
            raise self._error
        return self._words

    def begin(self) -> None:
        """Starts job workers, now and as machines come."""
        self._thread.start()

    def end(self) -> None:
        """Has all of them end."""
        self._over.set()
        self._thread.join(_PATIENCE_S)
        self._cluster.end_all(_PATIENCE_S)

    def _follow(self) -> None:
        while not self._over.is_set():
            try:
                self.step(time.monotonic())
            except BackendError as error:
                self._error = error
                return
            except Exception as error:  # libraries raise all kinds when a cluster goes away; it may come back
                self._words = f"{self._cluster.place} does not answer: {type(error).__name__}: {error}"
            self._over.wait(_LOOK_S)

    def step(self, now: float) -> None:
        """Notes what has ended and starts what is missing.

        Args:
            now: seconds of a clock that never goes back.
        """
        if self._looked_at is None or now - self._looked_at >= _LOOK_FOR_MACHINES_S:
            self._machines = self._cluster.machines()
            self._looked_at = now
        for machine, started in list(self._started.items()):
            if (ended := started.ended()) is not None:
                del self._started[machine]
                self._staffing.ended(machine, ended, now)
        for machine in self._staffing.to_start(self._machines, now):
            try:
                self._started[machine] = self._cluster.start(machine, self._batch)
            except Exception as error:
                self._staffing.ended(machine, Ended(machine, _NOT_STARTED, str(error)), now)
        self._words = self._staffing.words


@contextmanager
def cluster_workers(cluster: Cluster, batch: str, wanted: int) -> Generator[ClusterWorkers]:
    """Has job workers on a cluster inside the block.

    Args:
        cluster: connected.
        batch: ARN of the batch.
        wanted: how many can be of use.
    """
    workers = ClusterWorkers(cluster, batch, wanted)
    workers.begin()
    try:
        yield workers
    finally:
        workers.end()
