"""Prefect server of a command's process: finds or starts it, waits for it, describes its state."""

import os
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ...schemas.settings import Settings
from ..prefect_server.local_server import (
    ServerStatus,
    client_variables,
    ensure_server,
    is_own_server,
    server_status,
)
from ..prefect_server.outage import health_of
from ..prefect_server.secret import login_link

if TYPE_CHECKING:
    from ..prefect_server.outage import Outage

SHELL_SETUP = 'eval "$(robomaker server env)"'
"""Shell command that makes the `prefect` command use the local server."""


def use_server(settings: Settings, *, for_runs: bool = False) -> str:
    """Finds or starts the Prefect server, and makes Prefect in this process use it.

    Call it before Prefect is imported, so that Prefect's log lines are hidden, too.

    Args:
        settings: The data home's.
        for_runs: Whether this process carries out runs; what that takes is imported while a new server starts.

    Returns:
        The URL of its API.

    Raises:
        LocalServerError: A local server did not start.
        ConfigurationError: The configured server does not answer.
    """
    status = server_status(settings)
    starting = not (status.running or status.busy or status.configured_elsewhere)
    began = time.monotonic()
    if starting:
        sys.stderr.write("Starting the local Prefect server; the first time takes about 15 s …\n")
        sys.stderr.flush()
    url = ensure_server(settings, meanwhile=lambda url: _import_runs(url, settings) if for_runs else None)
    if starting:
        sys.stderr.write(f"It runs at {url.removesuffix('/api')} and stays; `robomaker server stop` ends it.")
        sys.stderr.write(f" ({time.monotonic() - began:.0f} s)\n")
    _use(url, settings)
    return url


def _use(url: str, settings: Settings) -> None:
    os.environ.update(client_variables(url, settings))
    if "PREFECT_LOGGING_LEVEL" not in os.environ:
        # Our own progress tells what happens; Prefect's lines go to its server only.
        os.environ.setdefault("PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL", "CRITICAL")
        os.environ.setdefault("PREFECT_INTERNAL_LOGGING_LEVEL", "CRITICAL")
    if "prefect" in sys.modules:  # it reads the variables only when it is imported
        from prefect.context import refresh_global_settings_context

        refresh_global_settings_context()


def _import_runs(url: str, settings: Settings) -> None:
    """Sets the server's variables, and imports Prefect and the code that runs jobs while a new server starts."""
    _use(url, settings)
    from ...flows import pipelines

    del pipelines


def wait_for_server_once(api_url: str, settings: Settings, tell: Callable[[str], None]) -> "Outage":
    """Makes all requests to the Prefect server wait together while it is unreachable.

    Args:
        api_url: API URL of the Prefect server, from `use_server`.
        settings: The data home's.
        tell: Tells the user at once that the server is away, and when it is back; called from any thread.

    Returns:
        Tracker of the server's outages.
    """
    patience = waiting_for_server(api_url, settings, tell)
    _FOR_EVER.append(patience)  # Prefect still empties its queues after all else has ended
    return patience.__enter__()


@contextmanager
def waiting_for_server(api_url: str, settings: Settings, tell: Callable[[str], None]) -> Generator["Outage"]:
    """Makes all requests to the Prefect server wait together while it is unreachable, inside the `with` block.

    Args:
        api_url: API URL of the Prefect server, from `use_server`.
        settings: The data home's.
        tell: Tells the user at once that the server is away, and when it is back; called from any thread.
    """
    from ...tasks.execution.run_watch import WATCH
    from ..prefect_server.outage import Outage
    from ..prefect_server.patient_requests import patient_requests

    outage = Outage(api_url, lambda: health_of(api_url), tell, is_own_server(api_url, settings))
    told_before = WATCH.tells_of_silence
    with patient_requests(outage, api_url):
        WATCH.tells_of_silence = False
        try:
            yield outage
        finally:
            WATCH.tells_of_silence = told_before


def tell_after_outage(outage: "Outage", settings: Settings) -> None:
    """Reports to the Prefect server, at a run's end, the ends of flow runs that it missed during an outage.

    Args:
        outage: Outage tracker from `wait_for_server_once`.
        settings: Settings of the data home that knows how its runs ended.
    """
    from ..dead_run_sweeper import close_dead_runs_once

    if outage.has_been and not outage.is_on:
        close_dead_runs_once(settings)


_FOR_EVER: list[object] = []
"""Objects that stay alive until the process ends."""


def uses_local_server(settings: Settings) -> bool:
    """Whether `use_server` will use the data home's own Prefect server."""
    return not server_status(settings).configured_elsewhere


def pages(api_url: str, secret: str | None) -> str:
    """Returns the URL of the Prefect server's web pages, with a one-time login if needed.

    Args:
        api_url: API URL of the Prefect server, from `use_server`.
        secret: The auth string with which the server is used, if any.
    """
    # Only a server on this machine can be ours; nothing that logs in is sent anywhere else.
    link = login_link(api_url, secret) if secret and api_url.startswith("http://127.0.0.1:") else None
    return link or api_url.removesuffix("/api")


def described(status: ServerStatus) -> str:
    """Describes a Prefect server's state in a line: `running at http://127.0.0.1:4200 (local, log server.log)`."""
    where = "the one PREFECT_API_URL or the Prefect profile names" if status.configured_elsewhere else "local"
    if status.busy:
        return f"busy: it has not answered within some seconds, at {str(status.api_url).removesuffix('/api')} ({where})"
    if not status.running:
        known = f" at {status.api_url}" if status.configured_elsewhere else ""
        return f"not running ({where}{known})" + (
            "" if status.configured_elsewhere else "; `run` starts it when needed"
        )
    log = f", log {status.log}" if status.log else ""
    return f"running at {str(status.api_url).removesuffix('/api')} ({where}{log})"
