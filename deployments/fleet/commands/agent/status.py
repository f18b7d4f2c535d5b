"""Show what the agent does and runs."""

import argparse


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker agent status` to its parser."""
    from .....tasks.fleet.agent.command_line import declare_status

    declare_status(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Prints what the agent on this robot is doing, and the installed version."""
    from .....schemas.wire.errors import ConfigurationError
    from .....tasks.fleet.agent import command_line
    from .....tasks.fleet.agent.errors import AgentError

    try:
        return command_line.status(arguments)
    except AgentError as error:
        raise ConfigurationError(str(error)) from error
