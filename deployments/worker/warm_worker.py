"""Job worker that runs jobs in its own process, with all modules imported beforehand."""

import importlib
import logging
import os
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import httpx
from prefect.client.orchestration import get_client
from prefect.exceptions import PrefectException

from ...schemas.settings import Settings
from ...schemas.wire.arns import ResourceArn
from ...schemas.wire.errors import ServiceError, ServiceUnavailableException
from ...tasks.execution.leases.held_leases import HELD
from ...tasks.machine.machine_slots import jobs_that_wait
from ...tasks.machine.slot_files import WaiterRecord
from ...tasks.service.service import Service
from .flow_runs import mark_crashed
from .job_pools import JobPool
from .prefect_watch import PrefectWatch
from .running_jobs import Jobs

_RENEW_S = 5.0
_TELL_PREFECT_S = 2.0
_FIRST_NEEDED = (
    "prefect.flow_engine",
    "prefect.task_engine",
    "prefect_robomaker.tasks.execution.prefect_artifacts",
    "prefect.task_runners",
    "prefect_robomaker.tasks.execution.batch_slots",
    "prefect_robomaker.tasks.execution.task_pool",
    "prefect_robomaker.tasks.worlds.export_packing",
    "prefect_robomaker.tasks.worlds.generation",
)

_logger = logging.getLogger(__name__)


class WarmWorker:
    """Job worker that is kept warm: finds waiting jobs and runs them.

    Args:
        service: The service, with its catalog and object store.
        pools: Kinds of jobs, and how many of each run at once.
        prefect: Watches the Prefect server; no job begins without it.
        look: Event that is set when a job may wait.
    """

    def __init__(
        self, service: Service, pools: Sequence[JobPool], prefect: PrefectWatch, look: threading.Event
    ) -> None:
        self._service = service
        self._pools = pools
        self._kinds = [pool.kind for pool in pools]
        self._prefect = prefect
        self._jobs = Jobs(service, changed=look.set, prefect=prefect)
        self._catalog_answers = True
        self._renewed_at = time.monotonic()

    def prepare(self) -> None:
        """Imports modules and starts processes, so that the first job starts fast; removes folders of runs taken over.

        That Prefect does not answer yet is only logged.
        """
        from ...flows.lookup import find_perform_flow
        from ...tasks.jobs.job_folders import remove_overtaken_runs
        from ...tasks.jobs.job_runs import launcher

        remove_overtaken_runs(self._service)
        launcher().start()
        for module in _FIRST_NEEDED:
            importlib.import_module(module)
        # Also what Prefect's client imports and opens only when it is first used.
        with _logged("Prefect does not answer yet"), get_client(sync_client=True) as client:
            for pool in self._pools:
                client.create_flow(find_perform_flow(pool.operation))

    @property
    def settings(self) -> Settings:
        """Settings of the data home whose jobs the worker runs."""
        return self._service.settings

    def look(self) -> None:
        """Starts the stored jobs that can run; called several times a second.

        If the catalog does not answer, that is noted in the worker's state, and the next call tries again.
        """
        try:
            if time.monotonic() - self._renewed_at > _RENEW_S:
                self._renewed_at = time.monotonic()
                self._jobs.renew_reservations()
                self._jobs.look_again()
            # Mostly one query to the catalog, instead of one for each pool.
            if self._prefect.answers and self._service.catalog.unfinished(
                self._kinds, limit=1, without=self._jobs.left
            ):
                for pool in self._pools:
                    self._jobs.begin_some(pool)
            self._note_catalog(None)
        except ServiceUnavailableException as error:
            self._note_catalog(error)

    @property
    def has_jobs(self) -> bool:
        """Whether the worker has running jobs."""
        return bool(self._jobs.counts())

    def status(self) -> dict[str, Any]:
        """Returns the job worker's status for the health page: state, Prefect's URL, jobs by pool, waiting, left."""
        counts, waits = self._jobs.counts(), self._waits()
        waiting = sum(record.batch is None for record in waits)
        state = "ready" if self._catalog_answers else "waiting for the catalog"
        return {
            "state": state if self._prefect.answers else "waiting for Prefect",
            "prefect": self._prefect.url,
            **{pool.kind: _in_words(pool, counts[pool.kind], waiting) for pool in self._pools},
            **({"waiting": [f"{record.name}: {record.why}" for record in waits]} if waits else {}),
            **({"left": dict(self._jobs.left)} if self._jobs.left else {}),
        }

    def _waits(self) -> list[WaiterRecord]:
        """Lists the jobs and batches of this process that wait for a slot, memory or disk, the longest wait first."""
        return jobs_that_wait(self._service.settings, os.getpid())

    def end(self) -> dict[str, int]:
        """Releases every job; the process has to end right after.

        Returns:
            Number of jobs of each kind that other workers can continue.
        """
        logging.disable(logging.CRITICAL)  # jobs that lose their lease complain
        arns = HELD.give_back_all(self._service.catalog)
        ids = [arn.rsplit("/", 1)[-1] for arn in arns]
        words = "robomaker serve was stopped; the next one goes on with the job"
        telling = threading.Thread(target=mark_crashed, args=(ids, words), daemon=True)
        telling.start()
        telling.join(_TELL_PREFECT_S)
        return dict(Counter(ResourceArn.parse(arn).kind for arn in arns))

    def _note_catalog(self, error: ServiceError | None) -> None:
        if error is not None and self._catalog_answers:
            _logger.warning("no jobs are begun: %s", error)
        elif error is None and not self._catalog_answers:
            _logger.info("the catalog answers again")
        self._catalog_answers = error is None


def _in_words(pool: JobPool, begun: int, waiting: int) -> str:
    """Describes the number of running jobs in a pool: `2 of at most 4 running, 1 waiting`.

    Args:
        pool: The pool.
        begun: Number of its jobs that have begun and not ended.
        waiting: Number of simulation jobs that wait for resources of this machine.
    """
    if pool.kind != "simulation-job" or not waiting:
        return f"{begun} of at most {pool.at_once} running"
    return f"{max(0, begun - waiting)} of at most {pool.at_once} running, {waiting} waiting"


@contextmanager
def _logged(what: str) -> Iterator[None]:
    """Logs errors in the block that occur because the Prefect server does not answer; they are not raised."""
    try:
        yield
    except (httpx.HTTPError, PrefectException) as error:
        _logger.warning("%s: %s", what, error)
