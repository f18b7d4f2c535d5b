"""Approve a deployment that waits for it, so that it goes on.

A deployment with requiresApproval waits once its canaries have ended, or before its first robot where it has none;
it cannot be approved before.
"""

import argparse
import os
import sys

from ....arguments import add_deployment, add_who


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_deployment(parser)
    add_who(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Approves it."""
    from ......schemas.settings import Settings
    from ......tasks.fleet.control.decisions import approve
    from ......tasks.service.service import Service
    from ....inputs.people import who

    service = Service.open(Settings.from_environment(os.environ))
    approve(arguments.job, who(arguments.by), service)
    sys.stdout.write(f"{arguments.job}: approved\n")
    return 0
