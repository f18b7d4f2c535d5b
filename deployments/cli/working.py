"""Runs this process as a job worker of a batch (`robomaker work`)."""

import logging
import os
import signal
import sys
import threading

from ...schemas.settings import Settings
from ...tasks.jobs.batch_workers import BatchWorker
from ...tasks.nights.taking_up import TakingUp
from ...tasks.service.catalog_wait import once_catalog_answers
from ...tasks.service.service import Service
from ..log_lines import log_formatter
from .signals import interrupted_by_signals


def work(batch: str, *, end_with_input: bool) -> int:
    """Runs a job worker for a batch until no jobs are left; implements `robomaker work`.

    Args:
        batch: ARN of the batch.
        end_with_input: Whether the process ends when its standard input closes.

    Raises:
        ConfigurationError: The catalog of this machine does not have the batch.
    """
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(log_formatter(os.environ, "%(asctime)s %(message)s", "%H:%M:%S"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
    settings = Settings.from_environment(os.environ)
    TakingUp(settings).start()
    if end_with_input:
        threading.Thread(target=_interrupt_at_end_of_input, daemon=True).start()
    try:
        with interrupted_by_signals():
            service = once_catalog_answers(lambda: Service.open(settings))
            count = BatchWorker(batch, service).run()
    except KeyboardInterrupt:
        sys.stderr.write("robomaker: interrupted; other job workers go on with the jobs\n")
        sys.stderr.flush()
        os._exit(130)  # its jobs are released: nothing of them may go on here
    sys.stderr.write(f"robomaker: ran {count} {'job' if count == 1 else 'jobs'} of {batch}\n")
    return 0


def _interrupt_at_end_of_input() -> None:
    while os.read(sys.stdin.fileno(), 1):  # not by `sys.stdin`, whose lock this thread would hold when Python ends
        pass
    signal.raise_signal(signal.SIGINT)
