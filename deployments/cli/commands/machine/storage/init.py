"""Make buckets, and on S3 servers with an IAM interface users and policies, for the roles of ROBOMAKER_ROLES_FILE.

The access keys of new users are written into the file. It may be run again: only policies change then.
"""

import argparse
import os
import sys


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker storage init` to its parser."""
    parser.add_argument("--dry-run", action="store_true", help="say what would be made, and make nothing")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker storage init`: creates missing buckets and users on the object store."""
    from ......schemas.settings import Settings
    from ......tasks.storage import open_store
    from ......tasks.storage.roles.initialisation import initialise

    settings = Settings.from_environment(os.environ)
    store = open_store(settings, os.environ)
    beginning = "would make" if arguments.dry_run else "there is"
    for step in initialise(settings, store, os.environ, dry_run=arguments.dry_run):
        sys.stdout.write(f"{beginning} {step}\n")
        sys.stdout.flush()
    return 0
