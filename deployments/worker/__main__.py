"""Entry point of the job worker's process: `python -m prefect_robomaker.deployments.worker FD`.

It sends its status through the pipe FD. It ends when it is told to, when it gets SIGTERM or SIGINT, and when the
pipe's other end closes, so that it never outlives the process that started it.
"""

import gc
import logging
import os
import signal
import sys
import threading
import time
from typing import TYPE_CHECKING, Any

from ...schemas.settings import Settings
from ...schemas.wire.errors import RobomakerError
from ...tasks.service.catalog_wait import once_catalog_answers
from ...tasks.service.service import Service
from ..dead_run_sweeper import close_dead_runs
from ..log_lines import log_formatter
from .channel import STOP, Channel
from .job_pools import job_pools
from .prefect_watch import PrefectWatch

if TYPE_CHECKING:
    from .warm_worker import WarmWorker

POLL_S = 0.25
"""Seconds between two polls of the catalog without a wake-up, while the worker has jobs."""

IDLE_POLL_S = 1.0
"""Seconds between two polls without jobs. The endpoint wakes it for a new job, so only other processes' jobs wait."""

END_S = 5.0
"""Time limit for shutting down the job worker's process, in seconds."""

NICENESS = 5
"""Niceness of the process: the endpoint has priority, and simulations get the remaining processor time, nearly all."""

_STATUS_S = 1.0


def main() -> None:
    """Runs stored jobs in the job worker's process until a signal or message to stop; it ends the process itself.

    It lowers its priority, and tells its state through the inherited channel. The exit code is 0, or 2 if it could
    not begin.
    """
    channel = Channel.inherited(int(sys.argv[1]))
    os.nice(NICENESS)
    # What is imported stays. Looking through it for rubbish again and again takes a seventh of the time to import it.
    gc.disable()
    _log_to_stderr()
    look, stop = threading.Event(), threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: _request_stop(look, stop))
    threading.Thread(target=_listen, args=(channel, look, stop), daemon=True).start()
    try:
        worker = _make(look)
        worker.prepare()
        gc.freeze()
        gc.enable()
        # Our own server does it itself, but for the home and catalog of the command that started it.
        close_dead_runs(worker.settings)
    except RobomakerError as error:
        channel.send({"state": "failed", "error": str(error)})
        os._exit(2)
    _serve(worker, channel, look, stop)
    channel.send({"state": "ended", "interrupted": worker.end()})
    os._exit(0)  # closes every pipe, which is what simulations and world builders end with


def _make(look: threading.Event) -> "WarmWorker":
    settings = Settings.from_environment(os.environ)
    service, prefect = once_catalog_answers(lambda: Service.open(settings)), PrefectWatch(settings)
    prefect.start()
    # Imported late: it imports Prefect's engine, while the watch already looks for the server.
    from .warm_worker import WarmWorker

    return WarmWorker(service, job_pools(settings.max_jobs), prefect, look)


def _serve(worker: "WarmWorker", channel: Channel, look: threading.Event, stop: threading.Event) -> None:
    told: dict[str, Any] = {}
    told_at = 0.0
    while not stop.is_set():
        worker.look()
        status = worker.status()
        # What the health page shows need not be fresher than a second.
        if status != told and time.monotonic() - told_at > (_STATUS_S if told else 0.0):
            told, told_at = status, time.monotonic()
            channel.send(status)
        look.wait(POLL_S if worker.has_jobs else IDLE_POLL_S)
        look.clear()


def _listen(channel: Channel, look: threading.Event, stop: threading.Event) -> None:
    """Receives messages of the endpoint's process, each of which wakes the worker, until it says stop or dies.

    The worker is told to stop then.
    """
    while (message := channel.receive()) is not None and message != STOP:
        look.set()
    _request_stop(look, stop)


def _request_stop(look: threading.Event, stop: threading.Event) -> None:
    if not stop.is_set():
        stop.set()
        look.set()
        last_resort = threading.Timer(END_S, os._exit, (1,))
        last_resort.daemon = True
        last_resort.start()


def _log_to_stderr() -> None:
    """Logs one line per event to standard error, like the endpoint."""
    logging.raiseExceptions = False  # the reader of standard error may be gone
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(log_formatter(os.environ, "%(asctime)s %(message)s", "%H:%M:%S"))
    logger = logging.getLogger("prefect_robomaker")
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    logger.propagate = False


if __name__ == "__main__":
    main()
