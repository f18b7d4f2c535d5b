"""Poll the server, carry out its orders, keep the application running.

It ends at SIGTERM and SIGINT, and goes on from its journal when it is started again.
"""

import argparse

from . import as_command


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker agent run` to its parser."""
    from .....tasks.fleet.agent.command_line import declare_run

    declare_run(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Runs the agent on a robot until it is stopped."""
    from .....tasks.fleet.agent.command_line import run

    return as_command(run, arguments)
