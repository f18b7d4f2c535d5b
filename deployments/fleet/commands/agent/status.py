"""Show what the agent does and runs."""

import argparse

from . import as_command


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker agent status` to its parser."""
    from .....tasks.fleet.agent.command_line import declare_status

    declare_status(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Prints what the agent on this robot is doing, and the installed version."""
    from .....tasks.fleet.agent.command_line import status

    return as_command(status, arguments)
