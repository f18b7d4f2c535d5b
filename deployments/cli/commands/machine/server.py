"""Start, stop or look at the local Prefect server, or let other programs use it.

start prints its API's URL. stop refuses while runs, Prefect workers or `robomaker serve` use it, unless --force is
given. status prints, besides, a link that logs a browser in, once, within ten minutes. env starts the server if needed
and prints the variables with which the prefect command, Prefect workers and programs of one's own use it:

  eval "$(robomaker server env)"
"""

import argparse
import os
import shlex
import sys
from datetime import UTC, datetime
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from prefect.client.schemas.objects import Worker

    from .....schemas.settings import Settings
    from .....schemas.wire.errors import ConfigurationError

_SECRET = "PREFECT_API_AUTH_STRING"  # noqa: S105 - a name
_MOST_NAMED = 3
_PAGES = "Its pages, for one login within ten minutes: "


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker server` to its parser."""
    parser.add_argument("action", choices=("start", "stop", "status", "env"))
    parser.add_argument(
        "--force", action="store_true", help="stop: also while runs, Prefect workers or robomaker serve use it"
    )


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker server`: starts, stops or shows the local Prefect server; `status` exits with 3 if none runs.

    Raises ConfigurationError if `--force` is given to another action than `stop`, or `stop` would take the server from
    runs or workers that use it.
    """
    from .....schemas.settings import Settings
    from .....schemas.wire.errors import ConfigurationError
    from ....prefect_server.local_server import stop_server

    if arguments.force and arguments.action != "stop":
        raise ConfigurationError(f"--force is for stop; {arguments.action} takes no options")
    settings = Settings.from_environment(os.environ)
    if arguments.action == "start":
        return _start(settings)
    if arguments.action == "env":
        return _env(settings)
    if arguments.action == "status":
        return _status(settings)
    if not arguments.force and (users := _users(settings)):
        raise ConfigurationError(
            f"the local Prefect server was not stopped, as it is in use: {', '.join(users)}; wait for the runs and "
            "end the others, or add --force: runs go on and are not shown; Prefect workers and `serve` begin nothing "
            "until it is back"
        )
    stopped = stop_server(settings)
    sys.stdout.write("The local Prefect server has stopped.\n" if stopped else "No local Prefect server was running.\n")
    return 0


def _users(settings: "Settings") -> list[str]:
    """Lists the users of the local server as text; empty if it does not run.

    Raises:
        ConfigurationError: It does not say who uses it, such as while runs keep it busy.
    """
    from ....prefect_server.local_server import client_variables, server_status

    without_profile = {"PREFECT_PROFILES_PATH": os.devnull}
    status = server_status(settings, without_profile)
    if status.busy:
        raise _silent()
    if not status.running:
        return []
    import httpx
    from prefect.client.orchestration import SyncPrefectClient
    from prefect.client.schemas import filters
    from prefect.client.schemas.objects import StateType
    from prefect.exceptions import PrefectException

    from .....schemas.wire.common import counted
    from .....tasks.reporting.console_pages import served_with

    secret = client_variables(str(status.api_url), settings, without_profile).get(_SECRET)
    running = filters.FlowRunFilterState(type=filters.FlowRunFilterStateType(any_=[StateType.RUNNING]))
    top = filters.FlowRunFilterParentTaskRunId(is_null_=True)
    try:
        with SyncPrefectClient(str(status.api_url), auth_string=secret) as client:
            runs = client.read_flow_runs(flow_run_filter=filters.FlowRunFilter(state=running, parent_task_run_id=top))
            pools = [pool.name for pool in client.read_work_pools()]
            workers = [each for pool in pools for each in client.read_workers_for_work_pool(pool)]
    except (httpx.HTTPError, PrefectException) as error:
        raise _silent() from error
    online = [each for each in workers if each.status == "ONLINE"]
    names = [f"the run {run.name}" for run in runs[:_MOST_NAMED]]
    names += [counted(len(runs) - _MOST_NAMED, "more run")] if len(runs) > _MOST_NAMED else []
    names += [f"the Prefect worker {each.name}{_heard_of(each)}" for each in online]
    served = served_with(settings.home, str(status.api_url).removesuffix("/api"))
    return [*names, served] if served else names


def _heard_of(worker: "Worker") -> str:
    """Returns when a worker was heard of last: one that has died counts as there for about a minute and a half."""
    if worker.last_heartbeat_time is None:
        return ""
    past_s = (datetime.now(UTC) - worker.last_heartbeat_time).total_seconds()
    return f" (last heard of {max(past_s, 0.0):.0f} s ago)"


def _silent() -> "ConfigurationError":
    from .....schemas.wire.errors import ConfigurationError

    return ConfigurationError(
        "the local Prefect server was not stopped: it does not say who uses it, as it is busy or cannot be asked; try "
        "again in a while, or add --force"
    )


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
