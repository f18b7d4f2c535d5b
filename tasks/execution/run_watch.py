"""Thread that sends heartbeats of all flow runs of this process, and notices when they are cancelled in Prefect.

Prefect's own heartbeats make every flow wait a second at its end, and come every 30 s at most. These cost nothing, and
have a name of their own, so that the automation that closes dead runs (`dead_flow_runs`) ignores flows of others. A run
that no Prefect worker started cannot be stopped by one: this thread sees that it was cancelled, and stops it. A process
that slept, or was stopped, for so long that its runs were closed as dead sets them back to running.
"""

import logging
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager, nullcontext
from contextvars import ContextVar
from dataclasses import dataclass, field
from uuid import UUID

import httpx
from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.filters import FlowRunFilter
from prefect.client.schemas.objects import StateType
from prefect.context import FlowRunContext
from prefect.events import emit_event
from prefect.exceptions import PrefectException
from prefect.settings import PREFECT_API_URL

from ...schemas.wire.errors import ServiceUnavailableException
from ..catalog import Catalog
from .dead_flow_runs import HEARTBEAT, closed_as_dead, take_back
from .flow_ends import started_by_worker
from .leases.held_leases import HELD
from .orphans import end_orphan, watching_parent
from .prefect_settings import asking_once, on_same_server

BEAT_S = 10.0
"""Interval between two heartbeats of a flow run, in seconds."""

_LOOK_S = 2.0
"""Interval between two polls of the server for cancelled runs, in seconds."""

_MOST_MISSES = 3
"""Limit of consecutive polls that the server may leave unanswered, as it may only be busy."""

_watched_around: ContextVar[UUID | None] = ContextVar("robomaker_watched_run", default=None)
_logger = logging.getLogger(__name__)


@dataclass
class _Watched:
    name: str
    cancel: Callable[[], None]
    goes_on: Callable[[], bool]
    """Function that returns whether this process still does the watched run's work."""

    parts: set[UUID] = field(default_factory=set[UUID])
    """Ids of subflow runs in a watched flow run that have not ended."""

    beat_at: float = 0.0
    is_told: bool = False
    """Whether the flow run's callback `cancel` was called."""


@dataclass
class RunWatch:
    """Thread that watches the flow runs of this process for cancellation in Prefect, and sends their heartbeats."""

    _runs: dict[UUID, _Watched] = field(default_factory=dict[UUID, _Watched])
    _changed: threading.Condition = field(default_factory=threading.Condition)
    _taking_back: threading.Lock = field(default_factory=threading.Lock)
    """Lock held while a run is set to `Running` again: a run's end meanwhile is told to Prefect only after that."""

    _is_running: bool = False
    _misses: int = 0
    tells_of_silence: bool = True
    """Whether the watcher logs that the server does not answer; false if another component does."""

    @contextmanager
    def watching(
        self, run: UUID, name: str, cancel: Callable[[], None], goes_on: Callable[[], bool] = lambda: True
    ) -> Generator[None]:
        """Watches a flow run inside the `with` block.

        Args:
            run: The flow run's id.
            name: Name of the flow run.
            cancel: Called from another thread when it is cancelled in Prefect; again while the catalog does not answer.
            goes_on: Called from another thread when it was closed as dead: says whether this process still does its
                work, so that it takes the run back.
        """
        with self._changed:
            self._runs[run] = _Watched(name, cancel, goes_on)
            if not self._is_running:
                self._is_running = True
                # Python waits for it at its end: a daemon that is in Prefect's client then aborts the process, since
                # pydantic's Rust code does not let a thread be unwound.
                threading.Thread(target=on_same_server(self._watch), name="runs").start()
            self._changed.notify()
        try:
            yield
        finally:
            with self._taking_back, self._changed:
                self._runs.pop(run, None)
                self._changed.notify()

    @contextmanager
    def part(self, outer: UUID, run: UUID) -> Generator[None]:
        """Counts a subflow run as part of a watched flow run, inside the `with` block.

        Does nothing if the outer run is not watched.
        """
        parts = watched.parts if (watched := self._runs.get(outer)) else set[UUID]()
        parts.add(run)
        try:
            yield
        finally:
            with self._taking_back:
                parts.discard(run)

    def _watch(self) -> None:
        while runs := self._to_watch():
            try:
                # Kept while the server answers: to make a client takes 40 ms of CPU, and one look does not.
                with asking_once() as client:
                    while runs:
                        self._look(runs, client)
                        self._note_answer(None)
                        self._wait(runs)
                        runs = self._to_watch()
            except (httpx.HTTPError, PrefectException, RuntimeError) as error:
                self._note_answer(error)  # Prefect's client raises RuntimeError when it cannot reach the server
                self._wait(runs)
            except Exception:  # whatever breaks here, the runs go on and want to be watched
                _logger.warning("flow runs cannot be watched", exc_info=True)
                self._wait(runs)

    def _to_watch(self) -> dict[UUID, _Watched]:
        """Returns the watched flow runs; empty, which ends the thread, if none is left or the main thread has ended."""
        with self._changed:
            runs = dict(self._runs) if threading.main_thread().is_alive() else {}
            self._is_running = bool(runs)
            return runs

    def _look(self, runs: dict[UUID, _Watched], client: SyncPrefectClient) -> None:
        if self._beat(runs):
            self._take_back(runs, client)
        if not started_by_worker():
            self._pass_on_cancellations(runs, client)

    def _wait(self, known: dict[UUID, _Watched]) -> None:
        """Waits for the poll interval; returns early if a flow run is added to the watch, or the last one ends.

        Args:
            known: The flow runs of the last poll, by id.
        """
        with self._changed:
            self._changed.wait_for(lambda: not self._runs or self._runs.keys() - known.keys(), _LOOK_S)

    def _note_answer(self, error: Exception | None) -> None:
        """Counts the looks without an answer of the Prefect server, and logs once that it does not answer.

        An answer (`None` as the error) sets the count to 0. Prefect's own client tries for a minute before it logs
        that.
        """
        self._misses = 0 if error is None else self._misses + 1
        if self._misses == _MOST_MISSES and self.tells_of_silence:
            url = PREFECT_API_URL.value()
            _logger.warning("the Prefect server at %s does not answer; what runs goes on, and is not shown there", url)

    @staticmethod
    def _beat(runs: dict[UUID, _Watched]) -> bool:
        """Sends the heartbeats that are due; returns whether any was not a run's first."""
        due = {run: watched for run, watched in runs.items() if time.monotonic() - watched.beat_at >= BEAT_S}
        was_given = any(watched.beat_at for watched in due.values())
        for run, watched in due.items():
            watched.beat_at = time.monotonic()
            resource = {"prefect.resource.id": f"prefect.flow-run.{run}", "prefect.resource.name": watched.name}
            emit_event(HEARTBEAT, resource=resource)
        return was_given

    def _take_back(self, runs: dict[UUID, _Watched], client: SyncPrefectClient) -> None:
        """Sets runs back to `Running` that were closed as dead while this process slept, was stopped, or was not heard.

        Only leases decide which process does the work: a run whose job another worker has taken meanwhile stays closed.
        So does one that has ended since `runs` was looked up: it sets its own end state. Each job whose runs are taken
        back is logged.
        """
        for run, watched in runs.items():
            closed = closed_as_dead(client, {run, *watched.parts})
            if not closed or not watched.goes_on():
                continue
            with self._taking_back:
                still_open = {run, *watched.parts} if run in self._runs else set[UUID]()
                if going_on := [each for each in closed if each in still_open]:
                    take_back(client, going_on)
                    _logger.warning("%s was closed as dead in Prefect, and is taken back: it goes on", watched.name)

    @staticmethod
    def _pass_on_cancellations(runs: dict[UUID, _Watched], client: SyncPrefectClient) -> None:
        open_runs = [run for run, watched in runs.items() if not watched.is_told]
        if not open_runs:
            return
        cancelled = {"type": {"any_": [StateType.CANCELLING, StateType.CANCELLED]}}
        chosen = FlowRunFilter.model_validate({"id": {"any_": open_runs}, "state": cancelled})
        for run in client.read_flow_runs(flow_run_filter=chosen):
            try:
                runs[run.id].cancel()
            except ServiceUnavailableException as error:
                _logger.warning("the cancellation of %s is passed on later: %s", runs[run.id].name, error)
            else:
                runs[run.id].is_told = True


WATCH = RunWatch()
"""Watcher of this process's flow runs."""


@contextmanager
def beginning_run() -> Generator[None]:
    """Sends heartbeats of the running flow inside the `with` block, while it waits before its start.

    Nothing is cancelled from here: what it will run is not known yet, and a Prefect worker ends the process. Does
    nothing outside a flow, or in a flow that is watched already.
    """
    context = FlowRunContext.get()
    if context is None or context.flow_run is None or _watched_around.get() is not None:
        yield
        return
    with WATCH.watching(context.flow_run.id, context.flow_run.name, lambda: None):
        yield


@contextmanager
def watched_run(catalog: Catalog, cancel: Callable[[], None]) -> Generator[None]:
    """Watches the running flow inside the `with` block, unless its parent flow is watched already.

    A flow below a watched one counts as its part. Does nothing outside a flow.

    Args:
        catalog: The catalog of its jobs; their leases are released if the process has to end as an orphan.
        cancel: Called from another thread when the run is cancelled in Prefect; again while the catalog does not
            answer.
    """
    context = FlowRunContext.get()
    if context is None or context.flow_run is None:
        yield
        return
    run = context.flow_run.id
    if (outer := _watched_around.get()) is not None:
        with WATCH.part(outer, run):
            yield
        return
    orphaned = on_same_server(lambda: end_orphan(catalog, run))
    token = _watched_around.set(run)
    try:
        with (
            watching_parent(orphaned) if started_by_worker() else nullcontext(),
            WATCH.watching(run, context.flow_run.name, cancel, lambda: HELD.are_ours(catalog)),
        ):
            yield
    finally:
        _watched_around.reset(token)
