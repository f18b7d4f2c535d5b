"""Job workers on a Dask cluster: one task for each Dask worker, which starts a job worker there and waits for it.

Dask's own retries and stealing are off: which jobs run again is for the catalog to say. The task ends its job worker
once the cluster does not want it any more, for whatever reason: it was cancelled, or the client that asked is gone.
"""

import time
from collections.abc import Callable, Collection, Generator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from ...schemas.exit_codes import BAD_USAGE, BROKE
from .backend import Backend, BackendError, check_answer, check_place
from .cluster_workers import ClusterWorkers, cluster_workers
from .node import Ended

if TYPE_CHECKING:
    from distributed import Client, Future

_CONNECT_S = 10.0
_ANSWER_S = 10.0
_CLOSE_S = 2.0
_PAUSE_S = 0.2


def backend_at(place: str) -> Backend:
    """Creates the backend for a Dask cluster; it does not connect yet.

    Args:
        place: Address of its scheduler, such as `tcp://10.0.0.7:8786`.

    Raises:
        ConfigurationError: The address is not valid, or Dask is not installed.
    """
    wanted = "the address of a scheduler, such as tcp://10.0.0.7:8786"
    check_place("dask", place, library="distributed", wanted=wanted)
    return _DaskBackend(place)


class _DaskBackend:
    def __init__(self, address: str) -> None:
        self._address = address
        self._place = f"the Dask cluster {address}"

    def check(self) -> None:
        """Raises `BackendError` if the scheduler of the Dask cluster does not answer."""
        check_answer(self._place, self._address, "dask scheduler")

    @contextmanager
    def job_workers(self, batch: str, wanted: int) -> Generator[ClusterWorkers]:
        """Starts job workers for a batch on the Dask cluster inside the `with` block, and ends them after it.

        Raises `BackendError` if the cluster cannot be used.
        """
        from distributed import Client

        self.check()
        try:
            client = Client(self._address, timeout=_CONNECT_S, set_as_default=False, name="robomaker")
        except (OSError, ValueError) as error:
            raise BackendError(f"{self._place} cannot be used: {error}") from error
        try:
            with cluster_workers(DaskCluster(client, self._place), batch, wanted) as workers:
                yield workers
        finally:
            client.close(timeout=_CLOSE_S)


class DaskCluster:
    """A Dask cluster, on whose Dask workers job workers of a batch are started.

    Args:
        client: Connected client of the cluster.
        place: Description of the cluster, for messages.
    """

    def __init__(self, client: "Client", place: str) -> None:
        self.place = place
        self.addresses: dict[str, str] = {}
        self._client = client
        self._tasks: list[_Task] = []

    def machines(self) -> Collection[str]:
        """Returns the addresses of the Dask workers (of the nanny, which survives a restart, if there is one)."""
        scheduler: Any = self._client.scheduler  # `Client.scheduler_info` answers also when no scheduler does
        answer: Any = self._client.sync(scheduler.identity, n_workers=-1, callback_timeout=_ANSWER_S)
        workers = answer["workers"]
        self.addresses = {facts.get("nanny") or address: address for address, facts in workers.items()}
        return self.addresses.keys()

    def start(self, machine: str, batch: str) -> "_Task":
        """Starts a job worker for a batch on a Dask worker, and returns an object that tells when it has ended.

        Args:
            machine: Name of the Dask worker, as in `machines`.
            batch: ARN of the batch.
        """
        address = self.addresses[machine]
        future = self._client.submit(
            _task(), batch, workers=[address], allow_other_workers=False, pure=False, retries=0, key=None
        )
        task = _Task(self, machine, address, future)
        self._tasks = [*(task for task in self._tasks if not task.future.done()), task]
        return task

    def end_all(self, patience_s: float) -> None:
        """Cancels the job workers' Dask tasks, and waits until no Dask worker runs one, at most `patience_s` seconds.

        Errors of the cluster are ignored.
        """
        with suppress(OSError, TimeoutError):
            keys = {task.future.key for task in self._tasks}
            self._client.cancel([task.future for task in self._tasks], reason="the batch is over")
            deadline = time.monotonic() + patience_s
            while time.monotonic() < deadline and self._any_has(keys):
                time.sleep(_PAUSE_S)

    def _any_has(self, keys: Collection[Any]) -> bool:
        answers: Any = self._client.run(_has(keys), on_error="ignore")
        return any(answers.values())


class _Task:
    """Job worker that was started as a task on a Dask worker, with the means to see whether it has ended."""

    def __init__(self, cluster: DaskCluster, machine: str, address: str, future: "Future") -> None:
        self.future = future
        self._cluster = cluster
        self._machine = machine
        self._address = address

    def ended(self) -> Ended | None:
        """Returns how the job worker, or its Dask worker, ended; `None` if it has not.

        A task that waits for a Dask worker that is gone is cancelled.
        """
        if self.future.status == "finished":
            return Ended(*self.future.result())
        if self.future.status == "error":
            error = self.future.exception()
            # What cannot be imported there is not there, or too old.
            code = BAD_USAGE if isinstance(error, ImportError | AttributeError) else BROKE
            return Ended(self._machine, code, f"{type(error).__name__}: {error}")
        if self.future.cancelled():  # the scheduler was away, and knows nothing of it any more
            return Ended(self._machine, BROKE, "the scheduler has lost its task")
        if self._cluster.addresses.get(self._machine) != self._address:
            self.future.cancel()  # else it would wait for a worker with that address
            return Ended(self._machine, BROKE, f"the Dask worker {self._address} is gone")
        return None


def _task() -> Callable[[str], tuple[str, int, str]]:
    """Returns the function that Dask runs as a task.

    A function inside a function is sent to the cluster as a whole, so its scheduler does not need this package.
    """

    def work(batch: str) -> tuple[str, int, str]:
        from distributed import get_worker

        from .node import run_job_worker

        worker = get_worker()
        key = worker.get_current_task()

        def is_unwanted() -> bool:
            task = worker.state.tasks.get(key)
            return task is None or task.state == "cancelled"

        host, exit_code, last_words = run_job_worker(batch, should_stop=is_unwanted)
        return host, exit_code, last_words

    return work


def _has(keys: Collection[Any]) -> Callable[[Any], bool]:
    """Returns a function, to be sent to each Dask worker, that tells whether the worker has one of these tasks."""
    wanted = set(keys)

    def has(dask_worker: Any) -> bool:
        return not wanted.isdisjoint(dask_worker.state.tasks)

    return has
