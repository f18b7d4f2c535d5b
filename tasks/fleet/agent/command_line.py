"""Command line of the robot agent: `robomaker-agent enroll`, `run` and `status`; `robomaker agent` has the same.

Nothing else of the agent is imported before a command runs.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from .errors import AgentError

SUMMARIES = {
    "enroll": "exchange a one-time token for the robot's own, and for the root of trust",
    "run": "poll the server, carry out its orders, keep the application running",
    "status": "show what the agent does and runs",
}


def declare_enroll(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker-agent enroll` to its parser."""
    parser.add_argument("token", metavar="TOKEN", help="as `robomaker robots enroll NAME --agent` printed it")
    parser.add_argument("--url", required=True, help="where the robot reaches `robomaker serve`")
    parser.add_argument("--name", required=True, help="name of the robot, as in CreateRobot")
    parser.add_argument("--tenant", default="DEFAULT", help="first part of the server's paths (default: DEFAULT)")
    parser.add_argument("--again", action="store_true", help="forget the server that it is enrolled with")
    _add_home(parser)


def declare_run(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker-agent run` to its parser."""
    parser.add_argument("--user", help="user that applications and scripts run as; only root can say so")
    parser.add_argument("--sandbox", default="auto", help="auto, bwrap, setpriv or none (default: auto)")
    parser.add_argument("--architecture", help="X86_64, ARM64 or ARMHF (default: the machine's)")
    parser.add_argument(
        "--health-s", type=float, default=10.0, help="how long a new version has to stay up (default: 10)"
    )
    parser.add_argument("--health-command", help="shell command; its exit code 0 says that a new version is healthy")
    parser.add_argument("--script-timeout-s", type=float, default=600.0, help="of each script (default: 600)")
    parser.add_argument(
        "--stop-s", type=float, default=10.0, help="how long an application may take to end (default: 10)"
    )
    parser.add_argument(
        "--longest-wait-s", type=float, default=300.0, help="between polls while the server is away (default: 300)"
    )
    _add_home(parser)


def declare_status(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker-agent status` to its parser."""
    parser.add_argument("-o", "--output", choices=("text", "json"), default="text", help="form of the answer")
    _add_home(parser)


def enroll(arguments: argparse.Namespace) -> int:
    """Runs `robomaker-agent enroll`: enrols this robot at the service.

    Raises:
        AgentError: The robot cannot be enrolled.
    """
    from .enrolment import enrol
    from .settings import Home, checked_connection

    connection = checked_connection(arguments.url, arguments.tenant, arguments.name, "")
    enrol(Home(_home(arguments)), connection, arguments.token, os.urandom, again=arguments.again)
    sys.stdout.write(f"{arguments.name} is enrolled at {connection.url}; `run` begins.\n")
    return 0


def run(arguments: argparse.Namespace) -> int:
    """Runs `robomaker-agent run`: runs the agent until it is stopped.

    Raises:
        AgentError: The agent cannot run.
    """
    from .running import run as run_agent
    from .settings import Home, Options

    names = Options.__dataclass_fields__
    run_agent(Home(_home(arguments)), Options(**{name: getattr(arguments, name) for name in names}))
    return 0


def status(arguments: argparse.Namespace) -> int:
    """Runs `robomaker-agent status`: prints what the agent is doing and the installed version.

    Raises:
        AgentError: The robot is not enrolled.
    """
    from .running import status_of
    from .settings import Home

    found = status_of(Home(_home(arguments)))
    if arguments.output == "json":
        sys.stdout.write(json.dumps({"schema_version": 1, **found}, indent=2) + "\n")
    else:
        rows = [f"{name.replace('_', ' ') + ':':<14}{'-' if value is None else value}" for name, value in found.items()]
        sys.stdout.write("\n".join(rows) + "\n")
    return 0


COMMANDS = {"enroll": (declare_enroll, enroll), "run": (declare_run, run), "status": (declare_status, status)}


def main(words: Sequence[str] | None = None) -> int:
    """Runs the command `robomaker-agent` with the words, those of the command line by default; returns its exit code.

    After an error the code is 1, and the error is on standard error.
    """
    parser = argparse.ArgumentParser("robomaker-agent", description="Installs and runs applications on a robot.")
    chosen = parser.add_subparsers(dest="command", required=True)
    for name, (declare, execute) in COMMANDS.items():
        each = chosen.add_parser(name, help=SUMMARIES[name], description=SUMMARIES[name])
        declare(each)
        each.set_defaults(execute=execute)
    arguments = parser.parse_args(words)
    try:
        code: int = arguments.execute(arguments)
    except (AgentError, OSError) as error:
        sys.stderr.write(f"robomaker-agent: {error}\n")
        return 1
    return code


def _add_home(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--home",
        metavar="FOLDER",
        help="where the agent keeps everything (default: systemd's $STATE_DIRECTORY, or /var/lib/robomaker-agent)",
    )


def _home(arguments: argparse.Namespace) -> Path:
    from .settings import DEFAULT_HOME

    return Path(arguments.home or os.environ.get("STATE_DIRECTORY") or DEFAULT_HOME)
