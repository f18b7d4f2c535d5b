"""Poll the server, carry out its orders, keep the application running.

It ends at SIGTERM and SIGINT, and goes on from its journal when it is started again.
"""

import argparse


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker agent run` to its parser."""
    from .....tasks.fleet.agent.command_line import declare_run

    declare_run(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Runs the agent on a robot until it is stopped."""
    from .....schemas.wire.errors import ConfigurationError
    from .....tasks.fleet.agent import command_line
    from .....tasks.fleet.agent.errors import AgentError

    try:
        return command_line.run(arguments)
    except AgentError as error:
        raise ConfigurationError(str(error)) from error
