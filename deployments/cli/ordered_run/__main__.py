"""Child process of an ordered run.

`python -m prefect_robomaker.deployments.cli.ordered_run LOCK`, with the order on standard input.

The lock on the file LOCK is held for as long as this process lives, which shows others that the run goes on. A second
word says that the run was interrupted before, and is resumed now.
"""

import logging
import os
import signal
import sys
import threading
import time
from pathlib import Path

from ....schemas.reports.progress import Note, ProgressEvent, ProgressListener, StepEnded
from ....schemas.reports.run_record import Order
from ....schemas.settings import Settings
from ....schemas.wire.errors import ConfigurationError, RobomakerError, SpecError
from ....tasks.inspection.run_records import RECORD_NAME
from ....tasks.nights.open_runs import CANCEL, OpenRun
from ...endpoint.calling.access_keys import AccessKey, read_access_keys
from ...endpoint.calling.audit_log import AuditLog
from ...spec_runs.spec_runs import StandingFile, read_standing
from ..prefect_server import use_server, wait_for_server_once
from ..signals import interrupted_by_signals

NICENESS = 5
"""Niceness of an ordered run's process, as of job workers, so that the server has priority."""

_LOOK_S = 0.5

_logger = logging.getLogger("prefect_robomaker.deployments.cli.ordered_run")


def main() -> None:
    """Carries out an ordered run in this process; its lock is the first argument, and its order standard input.

    It lowers its priority, and writes progress and problems into the run's folder if there is a file for them, else
    into the log. It stops when the run's cancel file appears.
    """
    lock = int(sys.argv[1])
    os.set_inheritable(lock, False)
    os.nice(NICENESS)
    order = Order.model_validate_json(sys.stdin.buffer.read())
    settings = Settings.from_environment(os.environ)
    folder = settings.home / "runs" / order.run_id
    run = OpenRun.inherited(folder, order, lock)
    standing = read_standing(folder)
    listener = StandingFile(folder, standing) if standing is not None else None
    told = listener or _log
    problem = ""
    try:
        with interrupted_by_signals():
            if not run.is_cancelled:  # else the run sees so itself, and tells how its jobs ended
                threading.Thread(target=_watch, args=(folder / CANCEL,), daemon=True).start()
            _carry_out(run, settings, told)
    except RobomakerError as error:
        problem = "\n".join(map(str, error.problems)) if isinstance(error, SpecError) else str(error)
        if listener is not None and not order.interruptions and not (folder / RECORD_NAME).is_file():
            _finish_refused(order, error, settings, listener)
    except KeyboardInterrupt:
        problem = "it was cancelled"  # of one that had begun there is a record, which says so, too
    finally:
        if listener is not None:
            if problem:
                listener.broke(problem)
            listener.write()
        elif problem:
            _logger.error("%s", problem)
        # A night that could not be finished now, as its Prefect server does not answer, is tried again.
        if listener is not None or run.is_cancelled:
            run.end()


def _finish_refused(order: Order, error: RobomakerError, settings: Settings, listener: ProgressListener) -> None:
    # Imported when something is refused: it takes the report's modules.
    from ....tasks.nights.refused_runs import finish_refused_order

    finish_refused_order(order, error, settings, listener)


def _carry_out(run: OpenRun, settings: Settings, listener: ProgressListener) -> None:
    api_url = use_server(settings, for_runs=True)
    # Imported when it is known which server of Prefect's is used.
    from ....flows.pipelines import run_spec
    from ....tasks.nights.run_orders import ordered_run
    from ....tasks.service.service import Service
    from ...spec_runs.rights import Permits

    order = run.order
    wait_for_server_once(api_url, settings, lambda text: listener(Note(text)))
    service = Service.open(settings)
    audit_log = AuditLog(order.audit_log, service.clock) if order.audit_log else None
    permit = Permits(_key(order, settings), order.address, audit_log, service)
    run_spec(ordered_run(run, permit), settings, listener)


def _log(event: ProgressEvent) -> None:
    """Logs the end of a step, or a note, to the file with the process's output; other events are ignored."""
    if isinstance(event, StepEnded):
        _logger.warning("step %s: %s %s", event.step, event.status, event.detail)
    elif isinstance(event, Note):
        _logger.warning("%s", event.text)


def _key(order: Order, settings: Settings) -> AccessKey | None:
    """Returns the visitor's access key with its current rights; `None` if no login is required.

    Raises:
        ConfigurationError: The access key was deleted.
    """
    if order.key_id is None:
        return None
    keys = read_access_keys(settings.access_keys_file) if settings.access_keys_file else {}
    if order.key_id not in keys:
        raise ConfigurationError("the access key that ordered this run is not there any more")
    return keys[order.key_id]


def _watch(cancel: Path) -> None:
    """Waits until a file exists, and then sends this process SIGTERM: the server that made the file cancels the run."""
    while not cancel.exists():
        time.sleep(_LOOK_S)
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    main()
