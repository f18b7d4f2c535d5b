"""Let a paused deployment go on.

Robots whose turn it is get their orders within a second, if a maintenance window is open.
"""

import argparse
import os
import sys

from ....arguments import add_deployment


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    add_deployment(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Resumes it."""
    from ......schemas.settings import Settings
    from ......tasks.fleet.control.decisions import resume
    from ......tasks.service.service import Service

    service = Service.open(Settings.from_environment(os.environ))
    resume(arguments.job, service)
    sys.stdout.write(f"{arguments.job}: not paused any more\n")
    return 0
