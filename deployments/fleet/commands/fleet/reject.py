"""Cancel a deployment that waits for approval.

Robots that have the new version keep it; SyncDeploymentJob and a deployment of the earlier version are ways on.
"""

import argparse
import sys

from ....cli.inputs.options import open_service
from . import add_deployment, add_who


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker fleet reject` to its parser."""
    add_deployment(parser)
    add_who(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker fleet reject`: cancels a deployment that waits for approval."""
    from .....tasks.fleet.control.decisions import reject
    from ....cli.inputs.options import who

    service = open_service()
    reject(arguments.job, who(arguments.by), service)
    sys.stdout.write(f"{arguments.job}: canceled, since it was not approved\n")
    return 0
