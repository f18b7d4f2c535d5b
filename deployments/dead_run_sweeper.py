"""Thread that closes flow runs of dead processes in Prefect by their records, and deletes limits of ended batches."""

import logging
import os
import threading
import time
from collections.abc import Callable, Collection
from contextlib import suppress
from contextvars import copy_context
from datetime import UTC, datetime
from functools import partial
from typing import Any
from uuid import UUID

from prefect.client.orchestration import PrefectClient, SyncPrefectClient, get_client
from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterName
from prefect.client.schemas.objects import FlowRun, State
from prefect.exceptions import ObjectNotFound
from prefect.settings import get_current_settings

from ..schemas.lifecycles import is_terminal
from ..schemas.reports.run_states import result_of
from ..schemas.settings import Settings
from ..schemas.wire.errors import RobomakerError
from ..tasks.backends.backend import JOB_WORKER_FLOW
from ..tasks.execution.batch_slots import batches_with_limits, limit_name
from ..tasks.execution.dead_flow_runs import (
    SILENCE_S,
    UNHEARD_S,
    close_unheard,
    ensure_automation,
    has_open_runs,
    sweep,
    tell_ends,
    tell_of_dead,
    was_silent,
)
from ..tasks.execution.flow_ends import end_state
from ..tasks.execution.prefect_settings import asking_once
from ..tasks.inspection.job_standings import job_result
from ..tasks.inspection.run_records import RECORD_NAME, read_record
from ..tasks.nights.broken_off import broken_off_runs
from ..tasks.operations.registry import flow_names, registry
from ..tasks.service.service import Service

_KIND = "simulation-job-batch"

_logger = logging.getLogger(__name__)


def leftover_limits(batches: Collection[str], service: Service) -> list[str]:
    """Lists Prefect concurrency limits that belong to finished batches.

    Args:
        batches: Ids of the batches.
        service: The service, with its catalog and object store.

    Returns:
        The names of their limits.
    """
    found = service.catalog.get_many([service.arn(_KIND, batch) for batch in batches])
    return [limit_name(batch.id) for batch in found.values() if is_terminal(batch.kind, batch.status)]


def remove_leftover_limits(client: SyncPrefectClient, settings: Settings) -> list[str]:
    """Deletes Prefect's concurrency limits of batches that have ended, logs that, and returns the deleted names.

    A limit that another process deleted meanwhile is not among them.
    """
    if not (batches := batches_with_limits(client)):
        return []
    with Service.opened(settings) as service:
        names = leftover_limits(batches, service)
    removed: list[str] = []
    for name in names:
        try:
            client.delete_global_concurrency_limit_by_name(name)
        except ObjectNotFound:
            continue  # somebody else was faster
        removed.append(name)
    if removed:
        _logger.info("removed the concurrency limits of batches that have ended: %s", ", ".join(removed))
    return removed


_FRESH_S = 60.0


class RecordedEnds:
    """Looks up in a data home how flow runs really ended, to correct Prefect's states.

    Args:
        settings: The data home's.
        client: Client of the server that shows the flow runs.
    """

    def __init__(self, settings: Settings, client: SyncPrefectClient) -> None:
        self._settings = settings
        self._client = client
        self._answers: dict[UUID, tuple[float, State[Any] | None]] = {}

    def end_of(self, run: FlowRun) -> State[Any] | None:
        """Returns the state in which a flow run really ended; `None` if unknown in this data home. Cached."""
        now_s = time.monotonic()
        self._answers = {each: (at_s, end) for each, (at_s, end) in self._answers.items() if now_s - at_s < _FRESH_S}
        if run.id not in self._answers:
            self._answers[run.id] = now_s, self._find_end(run)
        return self._answers[run.id][1]

    def _find_end(self, run: FlowRun) -> State[Any] | None:
        try:
            arn = run.parameters.get("arn")
            return self._end_of_run(run) if arn is None else self._end_of_job(run, str(arn))
        except (RobomakerError, OSError) as error:
            _logger.debug("how %s ended is not known: %s", run.name, error)
            return None

    def _end_of_run(self, run: FlowRun) -> State[Any] | None:
        """Returns the end state of a specification's flow run, from the record that it wrote; `None` if it has none."""
        began = run.start_time or run.created
        for path in (self._settings.home / "runs").glob(f"*/{RECORD_NAME}"):
            with suppress(OSError):
                if began is not None and datetime.fromtimestamp(path.stat().st_mtime, began.tzinfo) < began:
                    continue
                if str(run.id).encode() not in path.read_bytes():  # most are of others, and some are large
                    continue
            record = read_record(path)
            if record.flow_run == run.id:
                return end_state(result_of(record), None, verdict_fails_run=self._settings.verdict_fails_run)
        return None

    def _end_of_job(self, run: FlowRun, arn: str) -> State[Any] | None:
        """Returns the end state of a job, if this flow run, which was marked dead, is the last that ran it.

        Returns `None` for all others.
        """
        if not was_silent(run):
            return None  # somebody saw that it died
        with Service.opened(self._settings) as service:
            job = service.catalog.get_many([arn]).get(arn)
            if job is None or not is_terminal(job.kind, job.status) or not self._is_last(run):
                return None
            flow = self._client.read_flow(run.flow_id).name
            operation = next(each for each in registry().values() if each.run_job and each.perform_name == flow)
            result = job_result(operation.name, operation.described(arn, service), service)
            return end_state(result, None, verdict_fails_run=self._settings.verdict_fails_run)

    def _is_last(self, run: FlowRun) -> bool:
        """Whether no later flow run ran the same job, so that the job's end is this one's."""
        named = FlowRunFilter(name=FlowRunFilterName(any_=[run.name]))
        began = run.start_time or run.created
        return all(
            each.id == run.id or began is None or (each.start_time or each.created or began) < began
            for each in self._client.read_flow_runs(flow_run_filter=named)
        )


SWEEP_S = 5.0
"""Interval between two sweeps for dead flow runs while a flow run is open, in seconds."""

IDLE_SWEEP_S = 60.0
"""Interval between two sweeps after a minute without open flow runs, in seconds; they find only late reports."""

IDLE_LOOK_S = 20.0
"""Interval between two polls for open flow runs then, in seconds.

It is less than `SILENCE_S`, so that a run that dies is closed no later for it.
"""

_LIMITS_S = 60.0
"""Interval between two checks of the batches' concurrency limits, in seconds."""

_RETRY_S = 1.0

_CLOCKS_S = 10.0
"""Largest delay of a server machine's clock against this one's, in seconds, so that no end of a run is missed."""


def close_dead_runs(settings: Settings) -> None:
    """Starts a thread that regularly closes flow runs whose process died, on the Prefect server.

    Args:
        settings: Settings of the data home that knows how its runs ended.
    """
    connect = partial(get_client, sync_client=True)
    threading.Thread(target=_close_until_end, args=(connect, settings), name="dead runs", daemon=True).start()


async def close_dead_runs_beside(client: PrefectClient) -> None:
    """Starts the closing of dead flow runs inside this program's own Prefect server.

    Args:
        client: A client of the server in this process.
    """
    secret = get_current_settings().server.api.auth_string
    connect = partial(
        SyncPrefectClient, str(client.api_url), auth_string=secret.get_secret_value() if secret else None
    )  # fmt: skip
    settings = Settings.from_environment(os.environ)
    # Not a pool's thread, which would be waited for when the server ends.
    threading.Thread(target=_close_until_end, args=(connect, settings, True), name="dead runs", daemon=True).start()


def close_dead_runs_once(settings: Settings) -> None:
    """Starts a thread that closes dead flow runs once.

    Args:
        settings: Settings of the data home that knows how its runs ended.
    """
    # Prefect's settings of this block, which may name its server, are not those of a new thread.
    threading.Thread(target=copy_context().run, args=(_sweep_once, settings), name="dead runs").start()


class _Pace:
    """Decides when to sweep: often while a flow run is open and for a minute after that, else seldom."""

    def __init__(self) -> None:
        self._open_at_s = self._swept_at_s = self._answers_since_s = time.monotonic()
        self._looked_at_s = time.time()

    @property
    def pause_s(self) -> float:
        """Seconds to wait until the next poll for open flow runs."""
        return SWEEP_S if time.monotonic() - self._open_at_s < IDLE_SWEEP_S else IDLE_LOOK_S

    @property
    def last_look(self) -> datetime:
        """Time of the last poll for open flow runs, or slightly before it."""
        return datetime.fromtimestamp(self._looked_at_s - _CLOCKS_S, UTC)

    def is_due(self, is_open: bool) -> bool:
        """Returns whether dead flow runs are to be swept now; if so, the time is noted as that of the last sweep.

        After this machine has slept, the time since which the server answers begins anew.
        """
        now_s = time.monotonic()
        if time.time() - self._looked_at_s > UNHEARD_S - SILENCE_S:
            self._answers_since_s = now_s  # it slept, and may have slept together with those it judges
        self._looked_at_s = time.time()
        if is_open:
            self._open_at_s = now_s
        if now_s - self._open_at_s >= IDLE_SWEEP_S > now_s - self._swept_at_s:
            return False
        self._swept_at_s = now_s
        return True

    def has_heard_all(self) -> bool:
        """Whether the server has been up for as long as a flow run may be silent, so that silent runs are dead."""
        return time.monotonic() - self._answers_since_s > UNHEARD_S


def _close_until_end(
    connect: Callable[[], SyncPrefectClient], settings: Settings, make_automation: bool = False
) -> None:
    pause, is_told = threading.Event(), False
    told: set[tuple[str, int]] = set()
    is_ours = make_automation
    while True:
        try:
            with connect() as client:
                if make_automation:
                    ensure_automation(client)
                    make_automation = False
                ends = RecordedEnds(settings, client)
                limits_at_s, pace = 0.0, _Pace()
                while not pause.wait(pace.pause_s):
                    if not pace.is_due(has_open_runs(client, flow_names() | _watched_flows(), pace.last_look)):
                        continue
                    tell_ends(client, _watched_flows(), ends.end_of)
                    sweep(client, flow_names())
                    if is_ours:
                        tell_of_broken_off(client, settings, told)
                    if pace.has_heard_all():
                        close_unheard(client, _watched_flows(), end_of=ends.end_of)
                    if time.monotonic() - limits_at_s > _LIMITS_S:
                        limits_at_s = time.monotonic()
                        remove_leftover_limits(client, settings)
                    is_told = False
        except Exception as error:  # whatever breaks a sweep, runs die later too
            if not is_told:
                _logger.warning("dead runs are not closed: %s: %s", type(error).__name__, error)
                is_told = True
            pause.wait(_RETRY_S)


def tell_of_broken_off(client: SyncPrefectClient, settings: Settings, told: set[tuple[str, int]]) -> None:
    """Writes into the dead flow runs of interrupted runs how the run can be finished.

    Args:
        client: The server's client.
        settings: Settings of the data home.
        told: Run ids and counts of interruptions that were already reported; the new ones are added.
    """
    for run in broken_off_runs(settings):
        key = (run.run_id, len(run.order.interruptions))
        if run.order.flow_run is None or key in told:
            continue
        told.add(key)
        limits = f", and {'; '.join(run.limits)}" if run.limits else ""
        next_one = "robomaker serve or a Prefect worker finishes it as soon as one is there, or: "
        who = "this finishes it: " if run.limits else next_one
        words = f"its process died{limits}; {who}{run.place}{run.command}"
        tell_of_dead(run.order.flow_run, words, client)


def _sweep_once(settings: Settings) -> None:
    try:
        with asking_once() as client:
            tell_ends(client, _watched_flows(), RecordedEnds(settings, client).end_of)
            sweep(client, flow_names())
            remove_leftover_limits(client, settings)
    except Exception as error:  # what the user has begun has nothing to do with it
        _logger.debug("dead runs are not closed: %s", error)


def _watched_flows() -> set[str]:
    """Returns the names of the flows that send heartbeats."""
    jobs = [entry for entry in registry().values() if entry.run_job]
    return {"RunPipeline", JOB_WORKER_FLOW, *(entry.perform_name for entry in jobs), *(entry.name for entry in jobs)}
