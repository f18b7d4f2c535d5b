"""Resumes interrupted runs of the data home while a Prefect worker is running.

Prefect loads this package in each of its workers (`prefect.collections`). The run of a deployment is ordered from that
deployment again, so that its Prefect worker carries it out with the deployment's variables, and shows it; any other run
gets a process of its own, if this worker has what it needs.
"""

import logging
import os
import threading
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

_START = ["worker", "start"]
_POOL = ("-p", "--pool")

_logger = logging.getLogger(__name__)


def is_prefect_worker(words: Sequence[str]) -> bool:
    """Whether a command line starts a Prefect worker.

    Args:
        words: `sys.argv`.
    """
    program = Path(words[0]) if words else Path()
    is_prefect = program.name == "prefect" or (program.name == "__main__.py" and program.parent.name == "prefect")
    return is_prefect and list(words[1:3]) == _START


def pools_of(words: Sequence[str]) -> list[str]:
    """Returns the work pools on a Prefect worker's command line."""
    after = [second for first, second in pairwise(words) if first in _POOL]
    return after + [word.partition("=")[2] for word in words if word.startswith("--pool=")]


def finish_runs_beside(words: Sequence[str]) -> None:
    """Starts a thread that resumes interrupted runs, if this process is a Prefect worker.

    Args:
        words: `sys.argv`.
    """
    if is_prefect_worker(words):
        # A thread: what it imports takes seconds, and Prefect waits for this package.
        threading.Thread(target=_start, args=(pools_of(words),), name="broken-off runs", daemon=True).start()


def _start(pools: Sequence[str]) -> None:
    from ...schemas.settings import Settings
    from ...schemas.wire.errors import ConfigurationError
    from ...tasks.nights.run_orders import tell_of_left
    from ...tasks.nights.taking_up import TakingUp
    from ..missed_nights import look_for_missed_nights
    from .continued_runs import Continuing

    try:
        settings = Settings.from_environment(os.environ)
    except ConfigurationError as error:
        _logger.warning("runs that broke off are not looked for: %s", error)
        return
    TakingUp(
        settings,
        order_flow_run=Continuing(pools).order,
        tell=tell_of_left,
        look_for_missed=lambda: look_for_missed_nights(settings),
    ).start()
