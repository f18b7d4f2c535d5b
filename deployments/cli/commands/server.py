"""`robomaker server`: the local Prefect server."""

import argparse
import os
import sys

from ....schemas.settings import Settings
from ...local_server import ServerStatus, configured_api_url, server_status, stop_server
from ..prefect_server import use_server


def execute(arguments: argparse.Namespace) -> int:
    """Starts, stops or shows the server; `status` exits with 3 when none runs."""
    settings = Settings.from_environment(os.environ)
    if arguments.action == "start":
        ours = configured_api_url(os.environ) is None
        url = use_server(settings)
        sys.stdout.write(url + "\n")
        if ours and sys.stdout.isatty():
            sys.stderr.write(f"So that the prefect command finds it: export PREFECT_API_URL={url}\n")
        return 0
    if arguments.action == "stop":
        stopped = stop_server(settings)
        sys.stdout.write(
            "The local Prefect server has stopped.\n" if stopped else "No local Prefect server was running.\n"
        )
        return 0
    status = server_status(settings)
    sys.stdout.write(described(status) + "\n")
    return 0 if status.running else 3


def described(status: ServerStatus) -> str:
    """A server's state in a line."""
    where = "the one PREFECT_API_URL or the Prefect profile names" if status.configured_elsewhere else "local"
    if not status.running:
        known = f" at {status.api_url}" if status.configured_elsewhere else ""
        return f"not running ({where}{known})" + (
            "" if status.configured_elsewhere else "; `run` starts it when needed"
        )
    log = f", log {status.log}" if status.log else ""
    return f"running at {str(status.api_url).removesuffix('/api')} ({where}{log})"
