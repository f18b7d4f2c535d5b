"""Closes flow runs and task runs of dead processes in Prefect, in a thread beside other work.

The local Prefect server does it all the time, the job worker of `robomaker serve` too, and each start of a run once:
so runs are closed also on a server that others keep. What only seems dead there, and has ended by the records of this
home, is shown as it ended; limits of batches that have ended are removed.
"""

import logging
import os
import threading
import time
from collections.abc import Callable
from functools import partial

from prefect.client.orchestration import PrefectClient, SyncPrefectClient, get_client
from prefect.settings import get_current_settings

from ..schemas.settings import Settings
from ..tasks.backends.backend import JOB_WORKER_FLOW
from ..tasks.execution.dead_flow_runs import (
    SILENCE_S,
    UNHEARD_S,
    close_unheard,
    ensure_automation,
    sweep,
    tell_ends,
    tell_of_dead,
)
from ..tasks.execution.prefect_settings import asking_once
from ..tasks.nights.broken_off import broken_off_runs
from ..tasks.operations.registry import flow_names, registry
from .leftover_limits import remove_leftover_limits
from .recorded_ends import RecordedEnds

SWEEP_S = 5.0
"""Time from one sweep to the next."""

_LIMITS_S = 60.0
"""Time from one look at the limits of batches to the next."""

_RETRY_S = 1.0

_logger = logging.getLogger(__name__)


def close_dead_runs(settings: Settings) -> None:
    """Starts a thread that sweeps again and again, on the server that Prefect's settings name.

    Args:
        settings: of the home that knows how its runs ended.
    """
    connect = partial(get_client, sync_client=True)
    threading.Thread(target=_close_until_end, args=(connect, settings), name="dead runs", daemon=True).start()


async def close_dead_runs_beside(client: PrefectClient) -> None:
    """Makes the automation that finds dead runs, and starts the thread, on our own server; see `beside`.

    Args:
        client: a client of the server in this process.
    """
    secret = get_current_settings().server.api.auth_string
    connect = partial(
        SyncPrefectClient, str(client.api_url), auth_string=secret.get_secret_value() if secret else None
    )  # fmt: skip
    settings = Settings.from_environment(os.environ)
    # Not a pool's thread, which would be waited for when the server ends.
    threading.Thread(target=_close_until_end, args=(connect, settings, True), name="dead runs", daemon=True).start()


def close_dead_runs_once(settings: Settings) -> None:
    """Starts a thread that sweeps once; Python waits for it at its end, see `run_watch`.

    Args:
        settings: of the home that knows how its runs ended.
    """
    threading.Thread(target=_sweep_once, args=(settings,), name="dead runs").start()


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
                answers_since, limits_at_s, looked_at_s = time.monotonic(), 0.0, time.time()
                while not pause.wait(SWEEP_S):
                    if time.time() - looked_at_s > UNHEARD_S - SILENCE_S:
                        answers_since = time.monotonic()  # it slept, and may have slept together with those it judges
                    looked_at_s = time.time()
                    tell_ends(client, _watched_flows(), ends.end_of)
                    sweep(client, flow_names())
                    if is_ours:
                        tell_of_broken_off(client, settings, told)
                    if time.monotonic() - answers_since > UNHEARD_S:
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
    """Says at flow runs of a home whose process died, before the run had ended, what finishes the run.

    Args:
        client: the server's client.
        settings: of the home.
        told: what was said before; gets what is said now.
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
    """The names of those flows that give signs of life: of what they carry out."""
    jobs = [entry for entry in registry().values() if entry.run_job]
    return {"RunPipeline", JOB_WORKER_FLOW, *(entry.perform_name for entry in jobs), *(entry.name for entry in jobs)}
