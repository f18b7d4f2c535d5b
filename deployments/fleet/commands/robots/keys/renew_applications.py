"""Replace the key that signs for the applications; it needs no root key.

Robots follow at their next deployment.
"""

import argparse
import sys

from .....cli.inputs.options import open_service


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds no arguments: `robomaker robots keys renew-applications` has none."""


def execute(arguments: argparse.Namespace) -> int:  # noqa: ARG001 - the signature of all commands
    """Runs `robomaker robots keys renew-applications`: replaces the key that signs applications."""
    from ......tasks.fleet.trust.ceremonies import rotate_applications
    from ......tasks.fleet.trust.publishing import publisher_of

    rotate_applications(publisher_of(open_service()))
    sys.stdout.write("The applications have a new key.\n")
    return 0
