"""Follow a deployment to its end: waves, robots with their steps, failures.

On a terminal one block is redrawn; elsewhere each change is a line. Ctrl-C ends the watching, not the deployment.
The exit code says how it ended: 0 succeeded, 3 failed, 4 canceled, 5 its time was up.
"""

import argparse
import os
import sys
import time
from typing import TYPE_CHECKING

from ....cli.inputs.options import open_service

if TYPE_CHECKING:
    from .....tasks.catalog import Resource


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker fleet watch` to its parser."""
    text = "name or ARN of a fleet, for its latest deployment; or ARN of one (default: the only one that goes on)"
    parser.add_argument("deployment", metavar="FLEET|DEPLOYMENT", nargs="?", help=text)


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker fleet watch`: shows a deployment's progress until it ends; the exit code tells how it ended."""
    from .....tasks.fleet.views.fleet_standings import find_deployment, follow
    from ...live_fleets import fleet_watcher

    service = open_service()
    job = find_deployment(arguments.deployment, service)
    with fleet_watcher(sys.stdout, os.environ) as show:
        for look in follow(job, service, time.sleep):
            show(look)
            job = look.job
    return _exit_code(job)


def _exit_code(job: "Resource") -> int:
    from .....schemas import exit_codes
    from .....schemas.fleet.documents import DeploymentJobDocument

    if job.status == "Failed":
        is_late = DeploymentJobDocument.of(job).failure_code == "FleetDeploymentTimeout"
        return exit_codes.TIMED_OUT if is_late else exit_codes.BROKE
    return exit_codes.CANCELED if job.status == "Canceled" else exit_codes.OK
