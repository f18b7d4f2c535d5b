"""Sign again what would expire, as `robomaker serve` does every few minutes.

For machines that have the keys and run no server.
"""

import argparse
import sys

from .....cli.inputs.options import open_service


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds no arguments: `robomaker robots keys renew` has none."""


def execute(arguments: argparse.Namespace) -> int:  # noqa: ARG001 - the signature of all commands
    """Runs `robomaker robots keys renew`: renews signatures of the update repository that are due.

    Prints until when they are valid, or that there is nothing to sign.
    """
    from ......tasks.fleet.trust.publishing import publisher_of

    now = publisher_of(open_service()).keep_up()
    if now is None:
        sys.stdout.write("There is nothing to sign: no agent has been enrolled from here.\n")
    else:
        expires = now.timestamp.signed.expires
        sys.stdout.write(f"The timestamp is valid until {expires:%Y-%m-%d %H:%M} UTC.\n")
    return 0
