"""Replace the key that signs for the applications; it needs no root key.

Robots follow at their next deployment.
"""

import argparse
import os
import sys


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds no arguments."""


def execute(arguments: argparse.Namespace) -> int:  # noqa: ARG001 - the signature of all commands
    """Replaces the key."""
    from .......schemas.settings import Settings
    from .......tasks.fleet.trust.ceremonies import rotate_applications
    from .......tasks.fleet.trust.publishing import publisher_of
    from .......tasks.service.service import Service

    rotate_applications(publisher_of(Service.open(Settings.from_environment(os.environ))))
    sys.stdout.write("The applications have a new key.\n")
    return 0
