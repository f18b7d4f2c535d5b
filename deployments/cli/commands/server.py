"""Start, stop or look at the local Prefect server.

start prints its API's URL.
"""

import argparse
import os
import sys


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    parser.add_argument("action", choices=("start", "stop", "status"))


def execute(arguments: argparse.Namespace) -> int:
    """Starts, stops or shows the server; `status` exits with 3 when none runs."""
    from ....schemas.settings import Settings
    from ...local_server import configured_api_url, server_status, stop_server
    from ..prefect_server import described, use_server

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
