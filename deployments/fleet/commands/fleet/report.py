"""Write the report of a deployment, as it stands now, and print its path.

The page has what each robot did when, wave by wave, why robots failed, their versions before and after, and what was
deployed. It is written at the end of each deployment as well.
"""

import argparse
import os
import sys

from ....cli.arguments import add_open
from ....cli.inputs.options import output_file
from ....cli.output.answers import open_file


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker fleet report` to its parser."""
    text = "ARN of a deployment job; or name or ARN of a fleet, for its latest"
    parser.add_argument("deployment", metavar="DEPLOYMENT", help=text)
    parser.add_argument("--out", metavar="FILE", help="where to write it (default: deployments/ in ROBOMAKER_HOME)")
    add_open(parser, "show it in a browser")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker fleet report`: writes the HTML report of a deployment, and prints its path.

    An error is raised if there is no such deployment.
    """
    from .....schemas.settings import Settings

    out = output_file(arguments.out, "--out")
    settings = Settings.from_environment(os.environ)

    from .....tasks.fleet.views.deployment_report import write_report
    from .....tasks.fleet.views.fleet_standings import find_deployment
    from .....tasks.service.service import Service

    service = Service.open(settings)
    path = write_report(find_deployment(arguments.deployment, service), service, out)
    sys.stdout.write(f"{path}\n")
    if arguments.open:
        open_file(path)
    return 0
