"""Flow runs that are the job workers of a batch in a Prefect work pool.

The module decides how many are needed, and creates and deletes them.
"""

import logging
import time
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from uuid import UUID

import httpx
from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterDeploymentId, FlowRunFilterTags
from prefect.client.schemas.objects import FlowRun, StateType, WorkerStatus
from prefect.client.schemas.objects import WorkPool as PrefectPool
from prefect.client.schemas.sorting import FlowRunSort
from prefect.exceptions import ObjectNotFound, PrefectException, PrefectHTTPStatusError
from prefect.states import Cancelled, Cancelling, Crashed

from ...schemas.wire.common import counted
from .backend import JOB_WORKER_FLOW, MISCONFIGURED, BackendError

_FIRST_PAUSE_S = 5.0
_LONGEST_PAUSE_S = 60.0
_LONG_LIFE_S = 60.0
"""Lifetime after which a job worker counts as healthy, in seconds; later restarts are delayed only shortly again."""


@dataclass
class Places:
    """Counts how many job workers of a batch a work pool should have, and delays restarts of those that end early."""

    _empty_until: list[float] = field(default_factory=list[float])
    _short_lives: int = 0

    def note_end(self, lived_s: float, now: float) -> None:
        """Records that a job worker ended before its batch.

        Args:
            lived_s: Lifetime of the job worker, in seconds.
            now: The time in seconds, of a clock that only goes forward.
        """
        self._short_lives = 0 if lived_s >= _LONG_LIFE_S else self._short_lives + 1
        pause_s = min(_LONGEST_PAUSE_S, _FIRST_PAUSE_S * 2.0 ** max(0, self._short_lives - 1))
        self._empty_until.append(now + pause_s)

    def missing(self, alive: int, room: int, now: float) -> int:
        """Returns how many job workers to start now; negative if there are too many.

        Args:
            alive: Number of job workers that are scheduled or running.
            room: Number of job workers that there should be.
            now: The time in seconds, of a clock that only goes forward.
        """
        self._empty_until = [until for until in self._empty_until if until > now]
        if alive > room:
            return room - alive
        return max(0, room - alive - len(self._empty_until))


_MOST_MISCONFIGURED = 3
_PAGE = 200  # the most that the server gives at once
_STUCK_S = 600.0
"""Time that a flow run may be Pending, in seconds: the longest pull of an image.

After that, the Prefect worker that began it has died.
"""

_AWAY = (httpx.HTTPError, PrefectException, RuntimeError)
"""Errors of Prefect's client when the server does not answer; `RuntimeError` when it cannot be reached."""

_logger = logging.getLogger(__name__)


@contextmanager
def opened_pool(pool: str, most: int | None, batch: str, wanted: int) -> Generator["PoolRuns"]:
    """Connects to the Prefect server and yields the flow runs that are a batch's job workers in a work pool.

    Args:
        pool: Name of the work pool.
        most: Limit of job workers; `None`: one for each machine.
        batch: ARN of the batch.
        wanted: Number of job workers that can be of use.

    Raises:
        BackendError: The pool or the deployment is missing, or the number.
    """
    with get_client(sync_client=True) as client:
        runs = PoolRuns(pool, most, batch, wanted, client)
        runs.check()
        yield runs


class PoolRuns:
    """Prefect flow runs that are the job workers of one batch in a work pool; used by one thread at a time.

    Args:
        pool: Name of the work pool.
        most: Limit of job workers; `None`: one for each machine.
        batch: ARN of the batch.
        wanted: Number of job workers that can be of use.
        client: Client of the Prefect server.
    """

    def __init__(self, pool: str, most: int | None, batch: str, wanted: int, client: SyncPrefectClient) -> None:
        self.pool = pool
        self.tag = batch.rpartition("/")[2]
        self._most = most
        self._batch = batch
        self._wanted = wanted
        self._client = client
        self._deployment: UUID | None = None
        self._places = Places()
        self._ended: set[UUID] | None = None
        self._misconfigured = 0
        self._last_end = ""

    def check(self) -> None:
        """Checks that the work pool can start job workers; a server that does not answer is logged, and asked later.

        Raises:
            BackendError: The work pool cannot start job workers.
        """
        try:
            self._room()
            self._deployment = self._found_deployment()
        except _AWAY as error:
            _logger.warning("the Prefect server does not answer; job workers start once it does: %s", error)

    def staffed(self) -> str:
        """Orders missing job workers as flow runs, and deletes waiting ones that are too many.

        Returns:
            Text for the user about the job workers.

        Raises:
            BackendError: No job worker can be started.
        """
        try:
            if self._deployment is None:
                self._deployment = self._found_deployment()
            room, trouble = self._room()
            alive = self._alive()
            running = sum(run.state_type == StateType.RUNNING for run in alive)
            if running == 0 and self._misconfigured >= _MOST_MISCONFIGURED:
                raise BackendError(f"no job worker of the work pool {self.pool!r} can run the batch: {self._last_end}")
            missing = self._places.missing(len(alive), room, time.monotonic())
            if missing < 0:
                self._take_back_some(alive, -missing)
            for _ in range(missing):
                self._start()
            return self._in_words(running, max(0, len(alive) + missing - running), trouble)
        except ObjectNotFound:  # somebody has deleted the deployment, or a run
            self._deployment = None
            return f"job workers in the work pool {self.pool} are looked for"
        except _AWAY as error:
            if isinstance(error, PrefectHTTPStatusError) and error.response.is_client_error:
                said = error.response.text[:300]
                raise BackendError(
                    f"the Prefect server refuses to start job workers in {self.pool!r}: {said}"
                ) from error
            _logger.debug("the Prefect server does not answer", exc_info=error)
            return f"the Prefect server does not answer; job workers in the work pool {self.pool} go on with their jobs"

    def take_back(self, *, also_running: bool) -> bool:
        """Deletes the job workers' flow runs that have not begun.

        Args:
            also_running: Whether those that run are cancelled, too.

        Returns:
            Whether the server answered.
        """
        try:
            for run in self._runs() if self._deployment else []:
                if _is_waiting(run):
                    self._delete(run)
                elif also_running and run.state_type in (StateType.PENDING, StateType.RUNNING):
                    words = "its batch is not carried out any more"
                    self._client.set_flow_run_state(run.id, Cancelling(message=words))
        except _AWAY as error:
            _logger.debug("job workers are not taken back", exc_info=error)
            return False
        return True

    def _found_deployment(self) -> UUID:
        try:
            found = self._client.read_deployment_by_name(f"{JOB_WORKER_FLOW}/{self.pool}")
        except ObjectNotFound as error:
            raise BackendError(
                f"the work pool {self.pool!r} has no deployment of the job worker; `robomaker deploy --job-worker "
                f"--pool {self.pool}` makes it"
            ) from error
        if found.work_pool_name != self.pool:
            raise BackendError(
                f"the deployment {JOB_WORKER_FLOW}/{self.pool} is in the work pool {found.work_pool_name!r}; "
                f"`robomaker deploy --job-worker --pool {self.pool}` puts it right"
            )
        return found.id

    def _room(self) -> tuple[int, str]:
        """Returns the number of job workers to run, and a note for the user about what limits it (empty: nothing).

        Raises `BackendError` if there is no such work pool, or its number of machines is not known.
        """
        try:
            pool = self._client.read_work_pool(self.pool)
            workers = self._client.read_workers_for_work_pool(self.pool, limit=_PAGE)
        except ObjectNotFound as error:
            raise BackendError(
                f"the Prefect server at {str(self._client.api_url).rstrip('/')} has no work pool {self.pool!r}; "
                f"`prefect work-pool create {self.pool} --type process` makes one"
            ) from error
        online = sum(worker.status == WorkerStatus.ONLINE for worker in workers)
        limits = [self._wanted, *(each for each in (self._most, pool.concurrency_limit) if each is not None)]
        if pool.type == "process":
            limits.append(online)
        elif len(limits) == 1:
            raise BackendError(
                f"the work pool {self.pool!r} is of type {pool.type}, which has no number of machines; "
                f"ROBOMAKER_BACKEND=workers:{self.pool}*4 would start four job workers, and so would a concurrency "
                "limit of the pool"
            )
        return min(limits), _trouble(pool, online)

    def _alive(self) -> list[FlowRun]:
        """Returns the job workers' flow runs that have not ended, and records those that ended since the last call.

        A run that has been pending too long is set to crashed, as the Prefect worker that took it has died; it is
        returned too.
        """
        runs = self._runs()
        ended = {run.id for run in runs if run.state is None or run.state.is_final()}
        if self._ended is not None:  # else they ended before this process was there
            for run in runs:
                if run.id in ended - self._ended:
                    self._note_end(run)
        self._ended = ended | (self._ended or set())
        alive = [run for run in runs if run.id not in ended]
        for run in alive:
            if run.state_type == StateType.PENDING and _age_s(run) > _STUCK_S:
                words = "it did not begin: the Prefect worker that took it has died"
                self._client.set_flow_run_state(run.id, Crashed(message=words), force=True)
        return alive

    def _note_end(self, run: FlowRun) -> None:
        self._places.note_end(_ran_s(run), time.monotonic())
        if run.state is not None and run.state.is_completed():
            return  # it has seen that no job is left
        name = run.state.name if run.state else "deleted"
        words = (run.state.message if run.state else None) or "without a reason"
        self._last_end = f"{name}: {words}"
        self._misconfigured = self._misconfigured + 1 if name == MISCONFIGURED else 0
        _logger.warning("the job worker %s of %s ended before its batch: %s", run.name, self.tag, self._last_end)

    def _runs(self) -> list[FlowRun]:
        """Returns the newest flow runs of the batch's job workers from the Prefect server, at most a page of them."""
        assert self._deployment is not None
        return self._client.read_flow_runs(
            flow_run_filter=FlowRunFilter(
                tags=FlowRunFilterTags(all_=[self.tag]),
                deployment_id=FlowRunFilterDeploymentId(any_=[self._deployment]),
            ),
            sort=FlowRunSort.EXPECTED_START_TIME_DESC,
            limit=_PAGE,
        )

    def _start(self) -> None:
        assert self._deployment is not None
        self._client.create_flow_run_from_deployment(
            self._deployment, parameters={"batch": self._batch}, tags=["robomaker", self.tag]
        )

    def _take_back_some(self, alive: list[FlowRun], count: int) -> None:
        """Deletes up to `count` of the job workers' flow runs that no Prefect worker has taken; the others continue."""
        for run in [run for run in alive if _is_waiting(run)][:count]:
            self._delete(run)

    def _delete(self, run: FlowRun) -> None:
        """Cancels and deletes a waiting flow run, so that no Prefect worker begins it; one just taken stays."""
        words = "the batch needs no further job worker"
        # Told first: a worker that has just taken it sees a state that it knows.
        answer = self._client.set_flow_run_state(run.id, Cancelled(message=words))
        if answer.state is not None and answer.state.is_cancelled():
            self._client.delete_flow_run(run.id)

    def _in_words(self, running: int, starting: int, trouble: str) -> str:
        there = f"{counted(running, 'job worker')} in the work pool {self.pool}"
        parts = [there + (f", {starting} starting" if starting else "")]
        if trouble:
            parts.append(trouble)
        if self._last_end and not running:
            parts.append(f"the last one ended as {self._last_end}")
        return "; ".join(parts)


def _trouble(pool: PrefectPool, online: int) -> str:
    if pool.is_paused:
        return f"the pool is paused (prefect work-pool resume {pool.name})"
    if not online:
        return f"none of its Prefect workers is online (prefect worker start --pool {pool.name} --limit 1)"
    return ""


def _is_waiting(run: FlowRun) -> bool:
    """Whether no Prefect worker has taken a flow run yet."""
    return run.state_type in (None, StateType.SCHEDULED)


def _ran_s(run: FlowRun) -> float:
    """Returns the time, in seconds, for which a flow run ran or has been running; 0 if it has not started."""
    if run.start_time is None:
        return 0.0
    return ((run.end_time or datetime.now(UTC)) - run.start_time).total_seconds()


def _age_s(run: FlowRun) -> float:
    """Returns the time, in seconds, for which a flow run has been in its present state; 0 if it has none."""
    return 0.0 if run.state is None else (datetime.now(UTC) - run.state.timestamp).total_seconds()
