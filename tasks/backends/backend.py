"""Interface of backends: job workers on machines for as long as a batch runs."""

from contextlib import AbstractContextManager
from typing import Protocol

from ...schemas.wire.errors import RobomakerError

JOB_WORKER_FLOW = "RunJobWorker"
"""The flow of a job worker in a work pool; its deployment is named after the pool."""

MISCONFIGURED = "Misconfigured"
"""Name of the state in which that flow ends where the machine's settings lead to another catalog than the batch's."""


class BackendError(RobomakerError):
    """The job workers of a batch cannot be started, and waiting does not help; the message says why."""


class JobWorkers(Protocol):
    """The job workers of one batch."""

    def look(self) -> str:
        """Starts job workers on machines that have come, and again where one has ended before the batch did.

        Called several times a second, from one thread; returns at once.

        Returns:
            What there is, in words that a user reads while the batch runs: `2 job workers on tcp://10.0.0.7:8786`.

        Raises:
            BackendError: none can be started.
        """
        ...


class Backend(Protocol):
    """Starts job workers on machines."""

    def check(self) -> None:
        """Finds out, before a run begins, whether there is such a cluster or pool.

        Raises:
            BackendError: there is none.
        """
        ...

    def job_workers(self, batch: str, wanted: int) -> AbstractContextManager[JobWorkers]:
        """Has job workers for a batch inside the block; at its end those that are left are told to end.

        Args:
            batch: ARN of the batch.
            wanted: how many can be of use.

        Raises:
            BackendError: there is no such cluster or pool.
        """
        ...
