"""Gives new threads the Prefect settings of the process, and not those of the flow that starts them.

A copy of the flow's whole context would not work: the client in it belongs to the flow, and ends with it.
"""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any

from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.settings import (
    PREFECT_API_AUTH_STRING,
    PREFECT_API_KEY,
    PREFECT_API_URL,
    PREFECT_CLIENT_MAX_RETRIES,
    temporary_settings,
)

_ANSWER_S = 5.0
"""Time limit for the Prefect server's answers to these threads, in seconds."""

_OF_SERVER = (PREFECT_API_URL, PREFECT_API_KEY, PREFECT_API_AUTH_STRING)


def on_same_server(work: Callable[[], None]) -> Callable[[], None]:
    """Returns a function for a new thread that calls another one with the Prefect server of the present thread."""
    chosen: dict[Any, Any] = {setting: setting.value() for setting in _OF_SERVER}

    def run() -> None:
        with temporary_settings(chosen):
            work()

    return run


@contextmanager
def asking_once() -> Generator[SyncPrefectClient]:
    """Yields a Prefect client without retries, for callers that ask again later anyway."""
    with (
        temporary_settings({PREFECT_CLIENT_MAX_RETRIES: 0}),
        get_client(sync_client=True, httpx_settings={"timeout": _ANSWER_S}) as client,
    ):
        yield client
