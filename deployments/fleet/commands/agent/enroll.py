"""Exchange a one-time token for the robot's own, and for the root of trust.

Run it on the robot; `robomaker robots enroll NAME --agent` prints the token.
"""

import argparse

from . import as_command


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker agent enroll` to its parser."""
    from .....tasks.fleet.agent.command_line import declare_enroll

    declare_enroll(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Runs the command that enrols a robot's agent at the service."""
    from .....tasks.fleet.agent.command_line import enroll

    return as_command(enroll, arguments)
