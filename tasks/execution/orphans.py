"""Ends flow processes in order while jobs still run in their threads.

A process whose Prefect worker was killed lives on, and cannot be cancelled any more. The death of its worker frees no
job, as leases in the catalog say which process runs a job. So the orphan releases its leases, and ends as if it had
been killed; simulations and world builders die with it. The same is done in a job worker's process that is cancelled or
told to end.
"""

import logging
import os
import threading
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from uuid import UUID

import httpx
from prefect.client.orchestration import get_client
from prefect.exceptions import PrefectException
from prefect.states import Cancelled, Crashed

from ...schemas.job_owners import NeededEnvironment
from ..catalog import Catalog
from .leases.held_leases import HELD
from .prefect_settings import on_same_server

_LOOK_S = 1.0
_TELL_PREFECT_S = 5.0

_logger = logging.getLogger(__name__)


@contextmanager
def watching_parent(orphaned: Callable[[], None]) -> Generator[None]:
    """Watches, in a thread inside the `with` block, whether the parent process dies, and calls `orphaned` if it does.

    Args:
        orphaned: Called when it has died; has to end this process.
    """
    ended = threading.Event()
    threading.Thread(target=_watch, args=(os.getppid(), ended, orphaned), name="parent", daemon=True).start()
    try:
        yield
    finally:
        ended.set()  # what has come to its end is not said to have crashed


def end_orphan(catalog: Catalog, flow_run: UUID) -> None:
    """Ends this process after its parent died: releases its jobs, and marks its flow run as crashed in Prefect.

    Args:
        catalog: The catalog of the jobs.
        flow_run: The flow run that this process was started for.
    """
    with _ended(1):
        arns = HELD.give_back_all(catalog)
        words = words_of_end(catalog, arns)
        _tell_prefect(lambda: _say_crashed(flow_run, words))


def end_job_worker(catalog: Catalog, flow_run: UUID) -> None:
    """Ends a job worker's process when its Prefect worker asks for it; its jobs are released.

    Args:
        catalog: Catalog of the jobs; their leases are released, so that other job workers take them at once.
        flow_run: The flow run that this process was started for.
    """
    with _ended(0):  # another exit code would make a cancelled run a crashed one
        HELD.give_back_all(catalog)
        _tell_prefect(lambda: _say_interrupted(flow_run))


_ending = threading.Event()
"""Event that is set once this process ends itself."""


def wait_if_ending() -> None:
    """Blocks this thread until the process is gone, if it is ending itself; returns at once otherwise.

    A run whose leases were released fails or is interrupted in its own thread, while Prefect is informed for some
    seconds. The run itself has not ended, as another process finishes it, so nothing may be recorded.
    """
    if _ending.is_set():
        threading.Event().wait()


@contextmanager
def _ended(exit_code: int) -> Generator[None]:
    """Ends this process with an exit code after the `with` block, whatever fails in it; errors are logged.

    Threads that still run are not waited for, and no clean-up code of the program runs.
    """
    _ending.set()
    try:
        yield
    except Exception:
        _logger.exception("the end of a process is not told; its leases run out by themselves")
    finally:
        os._exit(exit_code)


def words_of_end(catalog: Catalog, arns: Sequence[str]) -> str:
    """Makes the message of a process that ended because its parent died: how to continue the jobs it held.

    Args:
        catalog: The catalog of its jobs.
        arns: The jobs that it held, those of batches before the batches.
    """
    words = "its Prefect worker has died, so that it ended itself"
    if not arns:
        return words
    ownership = catalog.ownerships(arns[-1:]).get(arns[-1])
    command = f"robomaker perform {arns[-1]}"
    if ownership is not None and ownership.needed_environment is not None:
        command = NeededEnvironment.of_stored(ownership.needed_environment).command(arns[-1])
    return f"{words}; `{command}` goes on with what it ran"


def _tell_prefect(tell: Callable[[], None]) -> None:
    telling = threading.Thread(target=on_same_server(tell), daemon=True)
    telling.start()
    telling.join(_TELL_PREFECT_S)


def _watch(parent: int, ended: threading.Event, orphaned: Callable[[], None]) -> None:
    while not ended.wait(_LOOK_S):
        if os.getppid() != parent:  # another process adopts orphans
            orphaned()
            return


def _say_crashed(flow_run: UUID, words: str) -> None:
    try:
        with get_client(sync_client=True) as client:
            client.set_flow_run_state(flow_run, Crashed(message=words), force=True)
    except (httpx.HTTPError, PrefectException) as error:
        _logger.warning("Prefect is not told that the flow run has ended: %s", error)


def _say_interrupted(flow_run: UUID) -> None:
    """Sets a flow run's state: `Cancelled` if it is being cancelled, `Crashed` if its Prefect worker was stopped.

    A Prefect server that does not answer is logged, and raises nothing.
    """
    others = "other job workers go on with its jobs"
    try:
        with get_client(sync_client=True) as client:
            state = client.read_flow_run(flow_run).state
            is_cancelled = state is not None and (state.is_cancelling() or state.is_cancelled())
            end = (
                Cancelled(message=f"cancelled in Prefect; {others}")
                if is_cancelled
                else Crashed(message=f"its Prefect worker was stopped; {others}")
            )
            client.set_flow_run_state(flow_run, end, force=True)
    except (httpx.HTTPError, PrefectException) as error:
        _logger.warning("Prefect is not told that the flow run has ended: %s", error)
