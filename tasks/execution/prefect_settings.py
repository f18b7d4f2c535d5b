"""Prefect's settings for threads of our own: they see those of the process, not those of the flow that starts them.

A flow's whole context would not do: the client in it belongs to the flow, and ends with it.
"""

from collections.abc import Callable
from typing import Any

from prefect.settings import PREFECT_API_AUTH_STRING, PREFECT_API_KEY, PREFECT_API_URL, temporary_settings

_OF_SERVER = (PREFECT_API_URL, PREFECT_API_KEY, PREFECT_API_AUTH_STRING)


def on_same_server(work: Callable[[], None]) -> Callable[[], None]:
    """Returns `work` as a thread's target that talks to the server of the caller."""
    chosen: dict[Any, Any] = {setting: setting.value() for setting in _OF_SERVER}

    def run() -> None:
        with temporary_settings(chosen):
            work()

    return run
