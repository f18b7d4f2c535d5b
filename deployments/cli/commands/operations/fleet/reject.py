"""Cancel a deployment that waits for approval.

Robots that have the new version keep it; SyncDeploymentJob and a deployment of the earlier version are ways on.
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
    """Cancels it."""
    from ......schemas.settings import Settings
    from ......tasks.fleet.control.decisions import reject
    from ......tasks.service.service import Service
    from ....inputs.people import who

    service = Service.open(Settings.from_environment(os.environ))
    reject(arguments.job, who(arguments.by), service)
    sys.stdout.write(f"{arguments.job}: canceled, since it was not approved\n")
    return 0
