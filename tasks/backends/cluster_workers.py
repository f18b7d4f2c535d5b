"""Starts and watches the job workers of a batch on a Dask or Ray cluster, one on each machine."""

import threading
import time
from collections.abc import Collection, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

from ...schemas.exit_codes import BAD_USAGE, INTERRUPTED, OK
from ...schemas.wire.common import counted
from .backend import BackendError
from .node import Ended

FIRST_PAUSE_S = 1.0
LONGEST_PAUSE_S = 60.0
"""Longest pause before a machine's job worker is restarted, in seconds; pauses double with each end in a row."""

STEADY_S = 60.0
"""Lifetime after which a job worker counts as healthy, in seconds; pauses then start short again."""

_MOST_REASONS = 3  # more make a message that is not read


@dataclass
class _Machine:
    started_at: float | None = None
    """Start time of the machine's job worker; `None`: none is running there."""

    ends_in_a_row: int = 0
    not_before: float = 0.0
    refuses: bool = False
    """Whether the machine's last job worker could not use its settings."""

    reason: str = ""
    """Reason why a machine's last job worker ended; empty if it ended well."""

    @property
    def runs(self) -> bool:
        return self.started_at is not None


class Staffing:
    """Decides which machines of a cluster get a job worker of a batch, and when one that ended is restarted.

    Args:
        place: Description of the cluster, for messages: `the Dask cluster tcp://10.0.0.7:8786`.
        wanted: Number of job workers that can be of use.
    """

    def __init__(self, place: str, wanted: int) -> None:
        self._place = place
        self._wanted = wanted
        self._machines: dict[str, _Machine] = {}
        self._present: tuple[str, ...] = ()
        self._proven = False

    def to_start(self, present: Collection[str], now: float) -> list[str]:
        """Returns the machines that get a job worker now; from then on they count as having one.

        Args:
            present: The machines that there are; those named first are taken first.
            now: Seconds of a clock that never goes back.

        Returns:
            The machines.

        Raises:
            BackendError: The settings of every machine are wrong, and none has done any work.
        """
        self._present = tuple(present)
        self._check()
        room = self._wanted - sum(machine.runs for machine in self._machines.values())
        chosen: list[str] = []
        for name in self._present:
            machine = self._machines.setdefault(name, _Machine())
            if len(chosen) < room and not machine.runs and now >= machine.not_before:
                machine.started_at = now
                chosen.append(name)
        return chosen

    def ended(self, name: str, ended: Ended, now: float) -> None:
        """Records that the job worker of a machine has ended, though its batch has not.

        Args:
            name: The machine.
            ended: Report of its end.
            now: Seconds of a clock that never goes back.
        """
        machine = self._machines[name]
        assert machine.started_at is not None
        machine.refuses = ended.exit_code == BAD_USAGE
        steady = not machine.refuses and now - machine.started_at >= STEADY_S
        self._proven = self._proven or steady or ended.exit_code in (OK, INTERRUPTED)
        machine.ends_in_a_row = 1 if steady else machine.ends_in_a_row + 1
        pause_s = FIRST_PAUSE_S * 2 ** min(machine.ends_in_a_row - 1, 10)
        machine.not_before = now + min(pause_s, LONGEST_PAUSE_S)
        machine.reason = "" if ended.exit_code == OK else ended.reason
        machine.started_at = None

    @property
    def words(self) -> str:
        """Number and place of the batch's job workers as text for the user, with the reasons why there are no more.

        An example is `2 job workers on the Dask cluster tcp://10.0.0.7:8786`.
        """
        count = sum(machine.runs for machine in self._machines.values())
        if count:
            text = f"{counted(count, 'job worker')} on {self._place}"
        elif self._present:
            text = f"no job worker runs on {self._place} now"
        else:
            text = f"{self._place} has no machine yet"
        return "; ".join([text, *self._reasons()])

    def _check(self) -> None:
        machines = [self._machines.get(name) for name in self._present]
        all_refuse = bool(machines) and all(machine and machine.refuses for machine in machines)
        if all_refuse and not self._proven and not any(machine.runs for machine in self._machines.values()):
            raise BackendError(f"no machine of {self._place} can run jobs: {'; '.join(self._reasons())}")

    def _reasons(self) -> list[str]:
        """Returns the reasons why machines of the cluster have no job worker, each once, and the number of more."""
        idle = [self._machines[name] for name in self._present if name in self._machines]
        reasons = list(dict.fromkeys(machine.reason for machine in idle if machine.reason and not machine.runs))
        more = len(reasons) - _MOST_REASONS
        return reasons[:_MOST_REASONS] + ([f"and {more} more like these"] if more > 0 else [])


_LOOK_S = 0.5
_LOOK_FOR_MACHINES_S = 2.0
_PATIENCE_S = 15.0  # a cluster that does not answer at the end is left
_NOT_STARTED = 1


class Started(Protocol):
    """Interface of a job worker that was started on a machine of a cluster."""

    def ended(self) -> Ended | None:
        """Returns how the job worker (or its machine) ended; `None` if it runs or waits for its turn on the machine."""
        ...


class Cluster(Protocol):
    """Interface of a cluster (Dask or Ray) on whose machines job workers can be started. Used from one thread."""

    @property
    def place(self) -> str:
        """Name and address of the cluster as text: `the Dask cluster tcp://10.0.0.7:8786`."""
        ...

    def machines(self) -> Collection[str]:
        """Returns the names of the machines that are in the cluster now.

        Raises:
            Exception: The cluster does not answer.
        """
        ...

    def start(self, machine: str, batch: str) -> Started:
        """Starts a job worker for a batch on a machine of the cluster, and returns an object that tells its end.

        Raises:
            Exception: The cluster does not answer, or the machine has left it.
        """
        ...

    def end_all(self, patience_s: float) -> None:
        """Stops all job workers that were started here, and waits for their end, at most `patience_s` seconds."""
        ...


class ClusterWorkers:
    """Job workers of one batch on a cluster, started and watched by a thread.

    Args:
        cluster: The cluster that they are started on.
        batch: ARN of the batch.
        wanted: Number of job workers that can be of use.
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
        """Returns the state of the job workers as text for the user.

        Raises:
            BackendError: No machine can run jobs.
        """
        if self._error is not None:
            raise self._error
        return self._words

    def begin(self) -> None:
        """Starts the thread that starts job workers, now and whenever machines join the cluster."""
        self._thread.start()

    def end(self) -> None:
        """Ends the thread and all job workers of the batch on the cluster, waiting a limited time for each."""
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
        """Records job workers that have ended, and starts missing ones.

        Args:
            now: Seconds of a clock that never goes back.
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
    """Runs job workers for a batch on a cluster while the `with` block is active.

    Args:
        cluster: The connected cluster.
        batch: ARN of the batch.
        wanted: Number of job workers that can be of use.
    """
    workers = ClusterWorkers(cluster, batch, wanted)
    workers.begin()
    try:
        yield workers
    finally:
        workers.end()
