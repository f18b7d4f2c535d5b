"""The agent of a robot: enroll, run, status."""

import argparse
from collections.abc import Callable


def as_command(run: Callable[[argparse.Namespace], int], arguments: argparse.Namespace) -> int:
    """Runs a command of the robot agent, and converts its errors to those of other commands.

    Raises:
        ConfigurationError: The agent cannot do it; its error says why.
    """
    from .....schemas.wire.errors import ConfigurationError
    from .....tasks.fleet.agent.errors import AgentError

    try:
        return run(arguments)
    except AgentError as error:
        raise ConfigurationError(str(error)) from error
