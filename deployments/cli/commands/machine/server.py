"""Start, stop or look at the local Prefect server, or let other programs use it.

start prints its API's URL. status prints, besides, a link that logs a browser in, once, within ten minutes. env starts
the server if needed and prints the variables with which the prefect command, Prefect workers and programs of one's own
use it:

  eval "$(robomaker server env)"
"""

import argparse
import os
import shlex
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .....schemas.settings import Settings

_SECRET = "PREFECT_API_AUTH_STRING"  # noqa: S105 - a name
_PAGES = "Its pages, for one login within ten minutes: "


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    parser.add_argument("action", choices=("start", "stop", "status", "env"))


def execute(arguments: argparse.Namespace) -> int:
    """Starts, stops or shows the server; `status` exits with 3 when none runs."""
    from .....schemas.settings import Settings
    from ....prefect_server.local_server import stop_server

    settings = Settings.from_environment(os.environ)
    if arguments.action == "start":
        return _start(settings)
    if arguments.action == "env":
        return _env(settings)
    if arguments.action == "status":
        return _status(settings)
    stopped = stop_server(settings)
    sys.stdout.write("The local Prefect server has stopped.\n" if stopped else "No local Prefect server was running.\n")
    return 0


def _start(settings: "Settings") -> int:
    from ....prefect_server.local_server import client_variables
    from ...prefect_server import pages, use_server

    given = dict(os.environ)
    url = use_server(settings)
    sys.stdout.write(url + "\n")
    if secret := client_variables(url, settings, given).get(_SECRET):
        sys.stderr.write(f"{_PAGES}{pages(url, secret)}\n")
        sys.stderr.write('So that the prefect command finds it: eval "$(robomaker server env)"\n')
    return 0


def _env(settings: "Settings") -> int:
    from ....prefect_server.local_server import client_variables
    from ...prefect_server import use_server

    given = dict(os.environ)
    variables = client_variables(use_server(settings), settings, given)
    for name, value in variables.items():
        sys.stdout.write(f"export {name}={shlex.quote(value)}\n")
    return 0


def _status(settings: "Settings") -> int:
    from ....prefect_server.local_server import client_variables, server_status
    from ...prefect_server import described, pages

    status = server_status(settings)
    sys.stdout.write(described(status) + "\n")
    if not status.running:
        return 3
    if secret := client_variables(str(status.api_url), settings).get(_SECRET):
        sys.stdout.write(f"{_PAGES}{pages(str(status.api_url), secret)}\n")
    return 0
