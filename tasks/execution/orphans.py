"""A flow process whose Prefect worker was killed: it lives on, cannot be cancelled any more, and has to end.

The death of its worker frees no job: leases in the catalog say whose a job is. So the orphan releases its leases, and
ends as if it had been killed; simulations and world builders die with it.
"""

import logging
import os
import threading
import time
from collections.abc import Callable
from uuid import UUID

import httpx
from prefect.client.orchestration import get_client
from prefect.exceptions import PrefectException
from prefect.states import Crashed

from ..catalog import Catalog
from .held_leases import HELD
from .prefect_settings import on_same_server

_LOOK_S = 1.0
_TELL_PREFECT_S = 5.0

_logger = logging.getLogger(__name__)


def watch_parent(orphaned: Callable[[], None]) -> None:
    """Watches in a thread for the death of the process that started this one.

    Args:
        orphaned: called when it has died; has to end this process.
    """
    thread = threading.Thread(target=_watch, args=(os.getppid(), orphaned), name="parent", daemon=True)
    thread.start()


def end_orphan(catalog: Catalog, flow_run: UUID) -> None:
    """Releases all leases of this process, tells Prefect that its flow run has crashed, and ends the process.

    Args:
        catalog: where the jobs are.
        flow_run: the flow run that this process was started for.
    """
    arns = HELD.give_back_all(catalog)
    words = "its Prefect worker has died, so that it ended itself"
    if arns:
        words += f"; `robomaker perform {arns[-1]}` goes on with what it ran"
    telling = threading.Thread(target=on_same_server(lambda: _say_crashed(flow_run, words)), daemon=True)
    telling.start()
    telling.join(_TELL_PREFECT_S)
    os._exit(1)


def _watch(parent: int, orphaned: Callable[[], None]) -> None:
    while os.getppid() == parent:  # another process adopts orphans
        time.sleep(_LOOK_S)
    orphaned()


def _say_crashed(flow_run: UUID, words: str) -> None:
    try:
        with get_client(sync_client=True) as client:
            client.set_flow_run_state(flow_run, Crashed(message=words), force=True)
    except (httpx.HTTPError, PrefectException) as error:
        _logger.warning("Prefect is not told that the flow run has ended: %s", error)
