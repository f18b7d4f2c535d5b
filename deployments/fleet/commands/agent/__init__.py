"""The agent of a robot: enroll, run, status."""

import argparse
from collections.abc import Callable


def as_command(run: Callable[[argparse.Namespace], int], arguments: argparse.Namespace) -> int:
    """Runs a command of the agent, whose errors are then those of any command here.

    Raises:
        ConfigurationError: the agent cannot do it; its error says why.
    """
    from .....schemas.wire.errors import ConfigurationError
    from .....tasks.fleet.agent.errors import AgentError

    try:
        return run(arguments)
    except AgentError as error:
        raise ConfigurationError(str(error)) from error
