"""Verify that a deployment delivered what its required batch had passed with.

Exit code 0: verified; 1: refuted, and why; 3: nothing to verify. The attestation's signature is checked, and that it
is about the archives that robots got.
"""

import argparse
import sys
from pathlib import Path

from ....cli.arguments import add_output
from ....cli.inputs.options import open_service


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker fleet verify` to its parser."""
    parser.add_argument("deployment", metavar="DEPLOYMENT", help="ARN of a deployment job")
    key = "public key that has to have signed, in PEM (default: that of this data home)"
    parser.add_argument("--public-key", metavar="FILE", type=Path, help=key)
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker fleet verify`: checks that a deployment delivered what its attestation covers.

    Prints the answer, and returns its exit code.
    """
    from .....schemas.wire.arns import ResourceArn
    from .....tasks.fleet.attestations.envelopes import known_public_key, read_public_key
    from .....tasks.fleet.attestations.required_batches import EXIT_CODES, check_deployment
    from .....tasks.fleet.fleet_records import DEPLOYMENT

    ResourceArn.parse(arguments.deployment, DEPLOYMENT)
    service = open_service()
    job = service.catalog.get(arguments.deployment, kind=DEPLOYMENT)
    key = read_public_key(arguments.public_key) if arguments.public_key else known_public_key(service)
    check = check_deployment(job, key, service)
    text = check.model_dump_json(indent=2, exclude_none=True) if arguments.output == "json" else str(check)
    sys.stdout.write(f"{text}\n")
    return EXIT_CODES[check.answer]
