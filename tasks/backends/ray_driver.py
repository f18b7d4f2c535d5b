"""Child process that is connected to a Ray cluster: `python -m … ray_driver ADDRESS BATCH WANTED`.

It has one task on each node, which starts a job worker there and waits for it. It says on standard output, a JSON
object a line, its result (`words`) or why there is none (`error`), and ends when standard input closes. When it
dies, Ray ends its tasks, and the job workers end with them. Ray's own retries are off: which jobs run again is for
the catalog to say.
"""

import json
import logging
import os
import sys
import threading
from collections.abc import Callable, Collection
from typing import Any

from ...schemas.exit_codes import BAD_USAGE, BROKE
from .backend import BackendError
from .cluster_workers import cluster_workers
from .node import Ended

_LOOK_S = 0.25
_MISSING = (ImportError, AttributeError)  # what cannot be imported there is not there, or too old

Task = Callable[[str], tuple[str, int, str]]


class RayCluster:
    """The Ray cluster that this process is connected to, on whose nodes job workers are started.

    Args:
        address: Address of the cluster.
    """

    def __init__(self, address: str) -> None:
        import ray

        self.place = f"the Ray cluster {address}"
        self._ray: Any = ray
        self._run = ray.remote(max_retries=0, num_cpus=1)(_task())
        self._nodes: dict[str, Any] = {}
        self._started: list[_Started] = []

    def machines(self) -> Collection[str]:
        """Returns the ids of the Ray nodes that are alive and have CPUs (a head node often has none)."""
        nodes = {node["NodeID"]: node for node in self._ray.nodes() if node["Alive"]}
        self._nodes = {name: node for name, node in nodes.items() if node["Resources"].get("CPU", 0) >= 1}
        return self._nodes.keys()

    def start(self, machine: str, batch: str) -> "_Started":
        """Starts a job worker for a batch on a Ray node, and returns an object that tells when it has ended.

        Args:
            machine: Id of the Ray node.
            batch: ARN of the batch.
        """
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        node = self._nodes[machine]
        there = NodeAffinitySchedulingStrategy(node_id=machine, soft=False)
        task = self._run.options(scheduling_strategy=there, name="robomaker work")
        started = _Started(self._ray, node["NodeManagerAddress"], task.remote(batch))
        self._started = [*(started for started in self._started if not started.over), started]
        return started

    def end_all(self, patience_s: float) -> None:
        """Interrupts the job workers' Ray tasks, and kills those that do not end in time."""
        left = [started.reference for started in self._started if not started.over]
        for reference in left:
            self._ray.cancel(reference)
        if left:
            _, left = self._ray.wait(left, num_returns=len(left), timeout=patience_s)
        for reference in left:
            self._ray.cancel(reference, force=True)


class _Started:
    """Job worker that was started as a task on a Ray node, with the means to see whether it has ended."""

    def __init__(self, ray: Any, host: str, reference: Any) -> None:
        self.reference = reference
        self.over = False
        self._ray = ray
        self._host = host

    def ended(self) -> Ended | None:
        """Returns how the job worker, or its Ray node, ended; `None` if it has not ended."""
        ready, _ = self._ray.wait([self.reference], timeout=0)
        if not ready:
            return None
        self.over = True
        try:
            return Ended(*self._ray.get(self.reference))
        except self._ray.exceptions.RayError as error:
            cause = getattr(error, "cause", None) or error
            code = BAD_USAGE if isinstance(cause, _MISSING) else BROKE
            return Ended(self._host, code, f"{type(cause).__name__}: {str(cause).strip().splitlines()[0]}")


def _task() -> Task:
    """Returns the function that Ray runs as a task.

    A function inside a function is sent to the cluster as a whole, so that a missing package raises this program's own
    error.
    """

    def work(batch: str) -> tuple[str, int, str]:
        from .node import run_job_worker

        host, exit_code, last_words = run_job_worker(batch)
        return host, exit_code, last_words

    return work


def main(address: str, batch: str, wanted: str) -> None:
    """Runs job workers for a batch on a Ray cluster until standard input is closed; entry point of a child process.

    Writes JSON lines to standard output: the state of the job workers as `words` when it changes, and a final `error`.

    Args:
        address: Address of the Ray cluster.
        batch: ARN of the batch.
        wanted: Number of job workers that can be of use, as text.
    """
    output = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # what Ray prints is not meant for who reads us
    os.environ["RAY_ENABLE_AUTO_CONNECT"] = "0"  # else it starts a cluster here once the other is gone

    def say(**facts: str) -> None:
        output.write(json.dumps(facts) + "\n")

    over = threading.Event()
    threading.Thread(target=_await_end_of_input, args=(over,), daemon=True).start()

    import ray

    ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
    words = ""
    with cluster_workers(RayCluster(address), batch, int(wanted)) as workers:
        while not over.wait(_LOOK_S):
            try:
                seen = workers.look()
            except BackendError as error:
                say(error=str(error))
                break
            if seen != words:
                say(words=seen)
                words = seen
    ray.shutdown()


def _await_end_of_input(over: threading.Event) -> None:
    while os.read(0, 1):
        pass
    over.set()


if __name__ == "__main__":
    main(*sys.argv[1:])
