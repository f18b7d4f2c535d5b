"""Let a paused deployment go on.

Robots whose turn it is get their orders within a second, if a maintenance window is open.
"""

import argparse
import sys

from ....cli.inputs.options import open_service
from . import add_deployment


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker fleet resume` to its parser."""
    add_deployment(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker fleet resume`: resumes a paused deployment."""
    from .....tasks.fleet.control.deployment_decisions import resume

    service = open_service()
    resume(arguments.job, service)
    sys.stdout.write(f"{arguments.job}: not paused any more\n")
    return 0
