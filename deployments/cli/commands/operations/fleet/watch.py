"""Follow a deployment to its end: waves, robots with their steps, failures.

On a terminal one block is redrawn; elsewhere each change is a line. Ctrl-C ends the watching, not the deployment.
The exit code says how it ended: 0 succeeded, 3 failed, 4 canceled, 5 its time was up.
"""

import argparse
import os
import sys
import time


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    text = "name or ARN of a fleet, for its latest deployment; or ARN of one (default: the only one that goes on)"
    parser.add_argument("deployment", metavar="FLEET|DEPLOYMENT", nargs="?", help=text)


def execute(arguments: argparse.Namespace) -> int:
    """Shows each look; returns how it ended."""
    from ......schemas.settings import Settings
    from ......tasks.fleet.views.finding import find_deployment
    from ......tasks.fleet.views.following import follow
    from ......tasks.service.service import Service
    from ....output.fleet_watch import exit_code, fleet_watcher

    service = Service.open(Settings.from_environment(os.environ))
    job = find_deployment(arguments.deployment, service)
    with fleet_watcher(sys.stdout, os.environ) as show:
        for look in follow(job, service, time.sleep):
            show(look)
            job = look.job
    return exit_code(job)
