"""Let no robot of a deployment begin until it is resumed.

Robots that have begun go on to their end. Orders that robots have not fetched are held back, and their time-outs
stand still; the 30 days of the whole do not. Any machine with the same catalog may say it.
"""

import argparse

from . import add_decision, decided


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker fleet pause` to its parser."""
    add_decision(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker fleet pause`: pauses a deployment."""
    from .....tasks.fleet.control.deployment_decisions import pause

    return decided(pause, arguments, f"paused; `robomaker fleet resume {arguments.job}` lets it go on")
