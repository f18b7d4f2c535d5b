"""Runs a stored job to completion in this process, for the commands `perform` and `call --wait`."""

import logging
import sys
from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from ...schemas.documents.simulation_jobs import SimulationJobBatchDocument, SimulationJobDocument
from ...schemas.settings import Settings
from .output.answers import print_answer
from .signals import interrupted_by_signals

if TYPE_CHECKING:
    from ...tasks.nights.open_runs import OpenRun
    from ...tasks.service.service import Service

_logger = logging.getLogger(__name__)


def perform(operation: str, arn: str, settings: Settings, form: str) -> int:
    """Runs a stored job to its end, prints its final description, and returns the exit code.

    Returns:
        0 all well, 1 a simulation's verdict is fail, 3 something broke, 4 cancelled, 5 timed out.

    Raises:
        ResourceNotFoundException: The catalog has no such job.
    """
    from ...tasks.service.service import Service
    from .prefect_server import tell_after_outage, use_server, wait_for_server_once

    service = Service.open(settings)
    service.catalog.get(arn)  # before a server is started for a job that is not there
    api_url = use_server(settings, for_runs=True)
    from ...flows import lookup
    from ...schemas.reports.run_exit_codes import EXIT_CODES
    from ...tasks.nights.run_orders import tell_of_left
    from ...tasks.nights.taking_up import TakingUp
    from ...tasks.operations.registry import registry
    from ..dead_run_sweeper import close_dead_runs_once

    _warn_on_stderr()
    outage = wait_for_server_once(api_url, settings, _logger.warning)
    close_dead_runs_once(settings)
    run = _run_of(arn, service)
    TakingUp(settings, tell=tell_of_left).start()
    try:
        with interrupted_by_signals(), service.activated():
            answer, result = lookup.perform(operation, arn)
            if run is not None:
                _finish(run, settings)
    except KeyboardInterrupt:
        with suppress(OSError):  # the terminal that hung up is gone
            print_answer(registry()[operation].described(arn, service), form)
        raise
    tell_after_outage(outage, settings)
    print_answer(answer, form)
    return EXIT_CODES[result.state]


def _run_of(arn: str, service: "Service") -> "OpenRun | None":
    """Takes over the interrupted run that ordered a job, so that this process can resume it.

    Returns `None` if there is none.
    """
    from ...tasks.nights.broken_off import broken_off
    from ...tasks.nights.open_runs import OpenRun

    job = service.catalog.get(arn)
    documents = {"simulation-job": SimulationJobDocument, "simulation-job-batch": SimulationJobBatchDocument}
    run_id = documents[job.kind].of(job).spec_run if job.kind in documents else None
    folder = service.settings.home / "runs" / str(run_id)
    found = broken_off(folder, service.settings) if run_id else None
    return OpenRun.claim(folder) if found is not None and found.order.key_id is None else None


def _finish(run: "OpenRun", settings: Settings) -> None:
    """Carries an interrupted run to its end, and prints on standard error that it begins and how it ended."""
    from ...flows.pipelines import run_spec
    from ...schemas.reports.progress import Note
    from ...schemas.reports.run_states import shown_state
    from ...tasks.nights.run_orders import ordered_run

    sys.stderr.write(f"robomaker: the run {run.order.run_id} had broken off, and is finished now\n")
    record = run_spec(
        ordered_run(run),
        settings,
        lambda event: _logger.warning("%s", event.text) if isinstance(event, Note) else None,
    )
    sys.stderr.write(f"robomaker: the run {record.run_id}: {shown_state(record)}; report: {record.report_path}\n")


def order(operation: str, request: Mapping[str, Any], settings: Settings, form: str) -> int:
    """Submits a job, runs it to its end, prints its final description, and returns the exit code.

    Returns:
        Exit code, as of `perform`.

    Raises:
        ServiceError: The request is refused; nothing was stored.
    """
    from ...tasks.jobs.job_owners import OwnOrder
    from ...tasks.operations.registry import registry
    from ...tasks.service.service import Service

    service = Service.open(settings)
    with OwnOrder(service) as own:
        arn = registry()[operation].ordered(request, own.through, service)["arn"]
        own.keep(arn)
        return perform(operation, arn, settings, form)


def _warn_on_stderr() -> None:
    """Prints this package's warnings, such as of a dead Prefect server, on standard error and nowhere else."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("robomaker: %(message)s"))
    logger = logging.getLogger("prefect_robomaker")
    logger.handlers, logger.propagate = [handler], False
    logger.setLevel(logging.WARNING)
