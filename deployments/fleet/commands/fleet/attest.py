"""Attest that a batch has passed, without a deployment.

The application and its version are those that the first job of the batch ran, unless --application-version names
another; each job has to have run an archive of this very version.
"""

import argparse
import sys
from pathlib import Path

from ....cli.inputs.options import open_service


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker fleet attest` to its parser."""
    parser.add_argument("batch", metavar="BATCH", help="ARN of a simulation job batch")
    parser.add_argument("--application-version", metavar="N", help="number of the version that it is attested of")
    parser.add_argument("--file", metavar="PATH", type=Path, help="where the envelope goes (default: standard output)")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker fleet attest`: writes the signed attestation that a simulation batch passed.

    It goes to a file if one is named, else to standard output. Raises DeploymentError if the batch has not ended, or
    its jobs did not all pass with this version.
    """
    from .....schemas.wire.arns import ResourceArn
    from .....schemas.wire.errors import DeploymentError
    from .....tasks.fleet.attestations.passed_batch import BATCH, RunningBatch, StoredBatch, application_of, judge
    from .....tasks.fleet.attestations.required_batches import signed
    from .....tasks.simulations.planning.applications import find_application

    ResourceArn.parse(arguments.batch, BATCH)
    service = open_service()
    stored = StoredBatch.of(arguments.batch, service)
    reference, version = application_of(stored)
    application = find_application(reference, "robot", arguments.application_version or version, service)
    judged = judge(stored, application)
    if isinstance(judged, RunningBatch):
        raise DeploymentError(f"{judged.why}; attest it when it has ended", "MissingRobotDeploymentResource")
    envelope = signed(judged, application, service)
    if arguments.file is None:
        sys.stdout.write(envelope.decode() + "\n")
    else:
        arguments.file.write_bytes(envelope)
    return 0
