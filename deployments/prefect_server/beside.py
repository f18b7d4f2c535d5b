"""Code of ours that runs in the server's process, once the server answers.

A job gets a client of the server and may run as long as it likes; it ends, cancelled, with the server.
"""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Sequence
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from prefect.client.orchestration import PrefectClient

    Job = Callable[[PrefectClient], Awaitable[None]]

_logger = logging.getLogger(__name__)


@asynccontextmanager
async def beside(jobs: "Sequence[Job]", api_url: str, auth_string: str) -> "AsyncIterator[None]":
    """Runs jobs until the block ends. One that fails is logged; the others and the server go on.

    Args:
        jobs: what to run.
        api_url: API of the server, which answers.
        auth_string: `user:secret`, as the server wants it.
    """
    tasks = [asyncio.create_task(_run(job, api_url, auth_string)) for job in jobs]
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _run(job: "Job", api_url: str, auth_string: str) -> None:
    from prefect.client.orchestration import PrefectClient

    try:
        async with PrefectClient(api_url, auth_string=auth_string) as client:
            await job(client)
    except Exception:
        _logger.exception("%s beside the Prefect server failed", getattr(job, "__qualname__", job))
