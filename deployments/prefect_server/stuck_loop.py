"""Says in the server's log where it is stuck, when it answers nothing for a while."""

import asyncio
import faulthandler
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from prefect.client.orchestration import PrefectClient

_SILENT_S = 15.0
"""After how long the stacks of all threads are written: three times as long as clients wait for a sign of life."""

_TICK_S = 3.0


async def tell_when_stuck(_: "PrefectClient") -> None:
    """Runs until it is cancelled; the stacks are written by a thread that needs nothing of Python's."""
    try:
        while True:
            faulthandler.dump_traceback_later(_SILENT_S)
            await asyncio.sleep(_TICK_S)
    finally:
        faulthandler.cancel_dump_traceback_later()
