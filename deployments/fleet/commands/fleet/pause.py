"""Let no robot of a deployment begin until it is resumed.

Robots that have begun go on to their end. Orders that robots have not fetched are held back, and their time-outs
stand still; the 30 days of the whole do not. Any machine with the same catalog may say it.
"""

import argparse
import sys

from ....cli.inputs.options import open_service
from . import add_deployment, add_who


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker fleet pause` to its parser."""
    add_deployment(parser)
    add_who(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker fleet pause`: pauses a deployment."""
    from .....tasks.fleet.control.decisions import pause
    from ....cli.inputs.options import who

    service = open_service()
    pause(arguments.job, who(arguments.by), service)
    sys.stdout.write(f"{arguments.job}: paused; `robomaker fleet resume {arguments.job}` lets it go on\n")
    return 0
