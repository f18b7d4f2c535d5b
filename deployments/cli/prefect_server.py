"""The Prefect server of this process: chooses it, starts it if needed, and reports its state in a line."""

import os
import sys
import time

from ...schemas.settings import Settings
from ..prefect_server.local_server import ServerStatus, client_variables, ensure_server, server_status
from ..prefect_server.login_link import login_link

SHELL_SETUP = 'eval "$(robomaker server env)"'
"""What makes the `prefect` command of a shell use the local server."""


def use_server(settings: Settings) -> str:
    """Finds or starts the Prefect server; must come before Prefect is imported.

    Returns:
        The URL of its API.

    Raises:
        LocalServerError: a local server did not start.
        ConfigurationError: the configured server does not answer.
    """
    status = server_status(settings)
    starting = not (status.running or status.busy or status.configured_elsewhere)
    began = time.monotonic()
    if starting:
        sys.stderr.write("Starting the local Prefect server; the first time takes about 20 s …\n")
        sys.stderr.flush()
    url = ensure_server(settings)
    if starting:
        sys.stderr.write(f"It runs at {url.removesuffix('/api')} and stays; `robomaker server stop` ends it.")
        sys.stderr.write(f" ({time.monotonic() - began:.0f} s)\n")
    os.environ.update(client_variables(url, settings))
    if "PREFECT_LOGGING_LEVEL" not in os.environ:
        # Our own progress tells what happens; Prefect's lines go to its server only.
        os.environ.setdefault("PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL", "CRITICAL")
    return url


def uses_local_server(settings: Settings) -> bool:
    """Whether `use_server`, which has not been called yet, will use this home's own server."""
    return not server_status(settings).configured_elsewhere


def pages(api_url: str, secret: str | None) -> str:
    """The address of a server's pages: a link that logs a browser in once, where the server gives one.

    Args:
        api_url: what `use_server` returned.
        secret: the auth string with which the server is used, if any.
    """
    # Only a server on this machine can be ours; nothing that logs in is sent anywhere else.
    link = login_link(api_url, secret) if secret and api_url.startswith("http://127.0.0.1:") else None
    return link or api_url.removesuffix("/api")


def described(status: ServerStatus) -> str:
    """A server's state in a line."""
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
