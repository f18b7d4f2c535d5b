"""Stack traces of a Prefect server whose event loop hangs."""

import asyncio
import faulthandler
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from prefect.client.orchestration import PrefectClient

_SILENT_S = 15.0
"""Time without a sign of life after which the stacks of all threads are logged, in seconds.

It is three times the timeout of clients.
"""

_TICK_S = 3.0


async def tell_when_stuck(_: "PrefectClient") -> None:
    """Writes stack traces to standard error when the server's event loop hangs; runs until it is cancelled."""
    try:
        while True:
            faulthandler.dump_traceback_later(_SILENT_S)
            await asyncio.sleep(_TICK_S)
    finally:
        faulthandler.cancel_dump_traceback_later()
