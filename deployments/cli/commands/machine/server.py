"""Start, stop or look at the local Prefect server, or let other programs use it.

start prints its API's URL. stop asks, in a terminal, if runs or Prefect workers still use it. status prints, besides, a
link that logs a browser in, once, within ten minutes. env starts the server if needed and prints the variables with
which the prefect command, Prefect workers and programs of one's own use it:

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
_MOST_NAMED = 3
_PAGES = "Its pages, for one login within ten minutes: "


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker server` to its parser."""
    parser.add_argument("action", choices=("start", "stop", "status", "env"))


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker server`: starts, stops or shows the local Prefect server; `status` exits with 3 if none runs.

    `stop` asks first if the server is in use and a person is at the terminal, and exits with 0 also if it was not
    stopped.
    """
    from .....schemas.settings import Settings
    from ....prefect_server.local_server import stop_server

    settings = Settings.from_environment(os.environ)
    if arguments.action == "start":
        return _start(settings)
    if arguments.action == "env":
        return _env(settings)
    if arguments.action == "status":
        return _status(settings)
    if not _may_stop(settings):
        sys.stderr.write("It was not stopped.\n")
        return 0
    stopped = stop_server(settings)
    sys.stdout.write("The local Prefect server has stopped.\n" if stopped else "No local Prefect server was running.\n")
    return 0


def _may_stop(settings: "Settings") -> bool:
    """Whether the local Prefect server may be stopped; prints its users, and then asks if a person is at the terminal.

    It may be if it has no users, or if there is no terminal to ask at.
    """
    users = _users(settings)
    if not users:
        return True
    sys.stderr.write(f"The local Prefect server is in use: {', '.join(users)}.\n")
    if not sys.stdin.isatty():
        return True
    sys.stderr.write(
        "What runs goes on, and is not shown; Prefect workers begin nothing until it is back. Stop it? [y/N] "
    )
    sys.stderr.flush()
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def _users(settings: "Settings") -> list[str]:
    """Lists the users of the local server as text; empty if it does not run or does not answer."""
    from ....prefect_server.local_server import client_variables, server_status

    without_profile = {"PREFECT_PROFILES_PATH": os.devnull}
    status = server_status(settings, without_profile)
    if not status.running:
        return []
    import httpx
    from prefect.client.orchestration import SyncPrefectClient
    from prefect.client.schemas import filters
    from prefect.client.schemas.objects import StateType
    from prefect.exceptions import PrefectException

    from .....schemas.wire.common import counted

    secret = client_variables(str(status.api_url), settings, without_profile).get(_SECRET)
    running = filters.FlowRunFilterState(type=filters.FlowRunFilterStateType(any_=[StateType.RUNNING]))
    top = filters.FlowRunFilterParentTaskRunId(is_null_=True)
    try:
        with SyncPrefectClient(str(status.api_url), auth_string=secret) as client:
            runs = client.read_flow_runs(flow_run_filter=filters.FlowRunFilter(state=running, parent_task_run_id=top))
            pools = [pool.name for pool in client.read_work_pools()]
            workers = [each for pool in pools for each in client.read_workers_for_work_pool(pool)]
    except (httpx.HTTPError, PrefectException):
        return []
    online = [each.name for each in workers if each.status == "ONLINE"]
    names = [f"the run {run.name}" for run in runs[:_MOST_NAMED]]
    names += [counted(len(runs) - _MOST_NAMED, "more run")] if len(runs) > _MOST_NAMED else []
    return [*names, *(f"the Prefect worker {name}" for name in online)]


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
