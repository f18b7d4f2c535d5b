"""Print the job template of a work pool for these flows.

It is Prefect's own template of the type, with the variables that the flows need: write it to a file, and
`prefect work-pool create NAME --type TYPE --base-job-template FILE` makes the pool.
"""

import argparse
import json
import os
import sys


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker pool-template` to its parser."""
    parser.add_argument("type", metavar="TYPE", choices=("process", "docker", "kubernetes"), help="type of the pool")
    parser.add_argument("--image", help="container image of its runs, which has prefect-robomaker")
    parser.add_argument(
        "--env", action="append", default=[], metavar="NAME=VALUE", help="variable for its runs; may be repeated"
    )


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker pool-template`: prints the job template (JSON) for a Prefect work pool.

    Uses a Prefect server unless the pool's type is `process`. An image or a variable that does not do is an error.
    """
    from .....schemas.settings import Settings
    from ....deploying.job_variables import check_image, environment_of_words
    from ...prefect_server import use_server

    check_image(arguments.type, arguments.image)
    environment = environment_of_words(arguments.env)
    if arguments.type != "process":  # Prefect's server has the templates of the other types
        use_server(Settings.from_environment(os.environ))
    from ....deploying.job_variables import pool_template

    template = pool_template(arguments.type, image=arguments.image, environment=environment)
    sys.stdout.write(json.dumps(template, indent=2) + "\n")
    return 0
