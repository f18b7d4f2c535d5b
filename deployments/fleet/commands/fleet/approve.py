"""Approve a deployment that waits for it, so that it goes on.

A deployment with requiresApproval waits once its canaries have ended, or before its first robot where it has none;
it cannot be approved before.
"""

import argparse
import sys

from ....cli.inputs.options import open_service
from . import add_deployment, add_who


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker fleet approve` to its parser."""
    add_deployment(parser)
    add_who(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker fleet approve`: approves a deployment that waits for approval."""
    from .....tasks.fleet.control.decisions import approve
    from ....cli.inputs.options import who

    service = open_service()
    approve(arguments.job, who(arguments.by), service)
    sys.stdout.write(f"{arguments.job}: approved\n")
    return 0
